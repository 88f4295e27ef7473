"""Writes a robot description as a URDF that every reader understands alike, for the simulation.

Meshes are convex hulls in metres at absolute paths; axes have length 1; every link has a mass and every moving joint an
effort; joints that do not move are fixed. The files are kept in the user's cache, under a hash of their content.
"""

import hashlib
import os
import tempfile
import threading
from collections.abc import Collection
from functools import cache
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from scipy.spatial import ConvexHull

from hmap_core.compile_cache import cache_root
from hmap_core.exceptions import InputError
from hmap_core.mesh_files import read_hull, read_mesh
from hmap_core.robot_description.description import Link, RobotDescription
from hmap_core.robot_description.node import LINE
from hmap_core.robot_description.tree import Joint
from hmap_core.robot_description.uris import find_file
from hmap_core.transforms import IDENTITY, euler_angles, from_matrix, to_matrix
from hmap_core.types import Shape, ShapeKind

ASSUMED_EFFORT = {"revolute": 300.0, "continuous": 300.0, "prismatic": 1000.0}  # N m, N: of a joint without effort
DIGITS = 12  # significant digits of a number
DRAWN = (".obj", ".stl", ".dae")  # formats of visual meshes that PyBullet reads
KEPT = ("contact", "visual")  # children of a link that are copied
UNLIMITED = 1e6  # m, limit of a sliding joint that has none


def cleaned_urdf(description: RobotDescription, fixed: Collection[str] = ()) -> Path:
    """Writes the cleaned URDF of a valid robot description.

    Args:
        description: the description.
        fixed: names of joints to fix where they are if nothing moves them.

    Returns:
        The path of the file.

    Raises:
        InputError: the cache cannot be written.
    """
    robot = Element("robot", name=description.name or "robot")
    originals = {} if description.element is None else _by_name(description.element)
    for name in originals.get("material", ()):
        robot.append(_copy(originals["material"][name]))
    for link in description.links.values():
        robot.append(_link(description, link, originals.get("link", {}).get(link.name)))
    for joint in description.joints.values():
        robot.append(_joint(description, joint, joint.name in fixed, originals.get("joint", {}).get(joint.name)))
    ElementTree.indent(robot)  # Bullet's reader breaks long lines, also within a number
    return _kept(ElementTree.tostring(robot), ".urdf")


def _by_name(robot: Element) -> dict[str, dict[str, Element]]:
    """The children of the root by tag and name; the first of each name."""
    found: dict[str, dict[str, Element]] = {}
    for child in robot:
        found.setdefault(child.tag, {}).setdefault(child.get("name", "").strip(), child)
    return found


def _copy(element: Element) -> Element:
    """A copy without line numbers."""
    copy = Element(element.tag, {key: value for key, value in element.items() if key != LINE})
    copy.extend(_copy(child) for child in element)
    copy.text = element.text
    return copy


def _link(description: RobotDescription, link: Link, original: Element | None) -> Element:
    element = Element("link", name=link.name)
    inertial = SubElement(element, "inertial")
    # the base does not move, and PyBullet places it by its centre of mass
    _origin(inertial, IDENTITY if link.name == description.root else link.inertial.T_link_com)
    SubElement(inertial, "mass", value=_text(link.inertial.mass))
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = link.inertial.inertia.tolist()
    moments = {"ixx": xx, "ixy": xy, "ixz": xz, "iyy": yy, "iyz": yz, "izz": zz}
    SubElement(inertial, "inertia", {key: _text(value) for key, value in moments.items()})
    for child in () if original is None else original:
        if child.tag in KEPT:
            copy = _copy(child)
            if child.tag != "visual" or _resolve(description, copy):
                element.append(copy)
    for shape in link.shapes:
        collision = SubElement(element, "collision")
        _origin(collision, shape.pose)
        _geometry(SubElement(collision, "geometry"), shape)
    return element


def _resolve(description: RobotDescription, visual: Element) -> bool:
    """Names the mesh of a visual element by its absolute path; whether it can be drawn."""
    mesh = visual.find("geometry/mesh")
    if mesh is None:
        return visual.find("geometry") is not None
    path, _ = find_file(mesh.get("filename", ""), description.file, description.packages)
    if path is None:
        return False
    try:
        if path.suffix.lower() not in DRAWN:
            surface = read_mesh(path)
            path = _kept(_obj(np.asarray(surface.vertices), np.asarray(surface.faces)), ".obj")
    except InputError:
        return False
    mesh.set("filename", str(path.absolute()))
    return True


def _geometry(parent: Element, shape: Shape) -> None:
    if shape.mesh is not None:
        SubElement(parent, "mesh", filename=str(hull_file(shape)))
    elif shape.kind is ShapeKind.BOX:
        SubElement(parent, "box", size=_text(*shape.size))
    elif shape.kind is ShapeKind.SPHERE:
        SubElement(parent, "sphere", radius=_text(*shape.size))
    else:
        SubElement(parent, str(shape.kind), radius=_text(shape.size[0]), length=_text(shape.size[1]))


def hull_file(shape: Shape) -> Path:
    """An OBJ file with the convex hull of a mesh shape, scaled, in metres and in the shape's frame.

    Raises:
        ValueError: the shape is no mesh.
        InputError: the cache cannot be written.
    """
    if shape.mesh is None:
        raise ValueError(f"a {shape.kind} has no mesh file")
    vertices = read_hull(shape.mesh).vertices * np.array(shape.size)
    return _kept(_obj(vertices, ConvexHull(vertices).simplices), ".obj")


def _obj(vertices: np.ndarray, faces: np.ndarray) -> bytes:
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (faces + 1).tolist()]
    return "\n".join((*lines, "")).encode()


def _joint(description: RobotDescription, joint: Joint, fixed: bool, original: Element | None) -> Element:
    moves = joint.moves and not fixed
    kind = joint.kind if moves else "fixed"
    if kind == "revolute" and np.isinf([joint.lower, joint.upper]).all():
        kind = "continuous"
    element = Element("joint", name=joint.name, type=kind)
    SubElement(element, "parent", link=joint.parent)
    SubElement(element, "child", link=joint.child)
    T = joint.T_parent_joint
    if fixed and joint.moves:
        T = from_matrix(to_matrix(T) @ joint.motion(description.tree.value(joint.name, {})))
    _origin(element, T)
    if not moves:
        return element
    SubElement(element, "axis", xyz=_text(*joint.axis))
    limits = {"effort": _text(ASSUMED_EFFORT[joint.kind] if joint.effort is None else joint.effort)}
    if np.isfinite(joint.velocity):
        limits["velocity"] = _text(joint.velocity)
    if kind != "continuous":
        lower, upper = np.clip([joint.lower, joint.upper], -UNLIMITED, UNLIMITED)
        limits |= {"lower": _text(lower), "upper": _text(upper)}
    SubElement(element, "limit", limits)
    dynamics = None if original is None else original.find("dynamics")
    if dynamics is not None:
        element.append(_copy(dynamics))
    if joint.mimic is not None:
        driver, multiplier, offset = joint.mimic
        SubElement(element, "mimic", joint=driver, multiplier=_text(multiplier), offset=_text(offset))
    return element


def _origin(parent: Element, T: np.ndarray) -> None:
    SubElement(parent, "origin", xyz=_text(*T[:3]), rpy=_text(*euler_angles(T)))


def _text(*numbers: float) -> str:
    return " ".join(f"{float(number) + 0.0:.{DIGITS}g}" for number in numbers)


def _kept(content: bytes, suffix: str) -> Path:
    """A file in the cache with this content."""
    path = _folder() / f"{hashlib.sha256(content).hexdigest()[:24]}{suffix}"
    if not path.is_file():
        draft = path.with_suffix(f".{os.getpid()}.{threading.get_ident()}")
        try:
            draft.write_bytes(content)
            os.replace(draft, path)  # at once, so that another process never sees half of it
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error
    return path


@cache
def _folder() -> Path:
    """The folder of the cache; one of this process if the user's cannot be written."""
    folder = cache_root().parent / "robots"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if os.access(folder, os.W_OK):
            return folder
    except OSError:
        pass
    return Path(tempfile.mkdtemp(prefix="hmap_robots_"))
