"""Kinematics and collision shapes of a robot from its URDF, with the standard library and NumPy only."""

import os
from collections import Counter
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from urllib.parse import unquote
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.validation import rigid
from hmap_core.validation.files import invalid_plan, locate, mesh_points
from hmap_core.validation.geometry import Solid, hull, solid

MOVING = ("revolute", "continuous", "prismatic")
SHORTEST_AXIS = 1e-6  # shorter ones have no direction


@dataclass(frozen=True)
class Joint:
    """A joint of the URDF.

    Attributes:
        name, kind, parent, child: as in the URDF.
        origin_R, origin_p: (3, 3) and (3,) frame of the child link in the parent link at value zero, m.
        axis: (3,) unit vector in the joint frame.
        lower, upper, velocity: limits, rad or m, and per s; infinite if the URDF has none.
        mimic: driving joint, multiplier and offset; None for an independent joint.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin_R: np.ndarray
    origin_p: np.ndarray
    axis: np.ndarray
    lower: float
    upper: float
    velocity: float
    mimic: tuple[str, float, float] | None


@dataclass(frozen=True)
class LinkShape:
    """A convex collision shape with its fixed rotation R (3, 3) and position p (3,) in the link frame."""

    link: str
    solid: Solid
    R: np.ndarray
    p: np.ndarray


@dataclass(frozen=True)
class Urdf:
    """A kinematic tree.

    Attributes:
        root: name of the base link.
        links: names of all links.
        joints: in an order in which parents precede their children.
        shapes: the collision shapes of all links.
    """

    root: str
    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    shapes: tuple[LinkShape, ...]

    @cached_property
    def chains(self) -> dict[str, tuple[Joint, ...]]:
        """For each link, the joints from the base to it."""
        chains: dict[str, tuple[Joint, ...]] = {self.root: ()}
        for joint in self.joints:
            chains[joint.child] = (*chains[joint.parent], joint)
        return chains

    @cached_property
    def moving(self) -> dict[str, tuple[Joint, ...]]:
        """For each link, the moving joints from the base to it."""
        return {link: tuple(joint for joint in chain if joint.kind in MOVING) for link, chain in self.chains.items()}

    @cached_property
    def shaped(self) -> frozenset[str]:
        """The links that have collision shapes."""
        return frozenset(shape.link for shape in self.shapes)

    def joint_to(self, link: str) -> Joint | None:
        """The joint whose child a link is; None for the base."""
        return self.chains[link][-1] if self.chains[link] else None


def _numbers(text: str | None, default: tuple[float, ...], infinite: bool = False) -> np.ndarray:
    """Numbers, as many as the default has; limits may be infinite."""
    if text is None:
        return np.array(default, float)
    found = np.array(text.split(), float)
    if "_" in text or len(found) != len(default) or np.isnan(found).any() or (np.isinf(found).any() and not infinite):
        raise ValueError(f"'{text}' is not {len(default)} finite numbers")
    return found


def _number(element: Element, key: str, default: float, infinite: bool = False) -> float:
    return float(_numbers(element.get(key), (default,), infinite)[0])


def _attribute(element: Element, key: str) -> str:
    value = element.get(key)
    if value is None:
        raise ValueError(f"a <{element.tag}> has no attribute '{key}'")
    return value.strip()


def _child(element: Element, tag: str) -> Element:
    found = element.find(tag)
    if found is None:
        raise ValueError(f"a <{element.tag}> has no <{tag}>")
    return found


def _origin(element: Element) -> tuple[np.ndarray, np.ndarray]:
    origin = element.find("origin")
    if origin is None:
        return np.eye(3), np.zeros(3)
    if origin.get("quat_xyzw") is not None:
        raise ValueError("an <origin> has a quaternion; its angles are needed")
    return rigid.from_rpy(_numbers(origin.get("rpy"), (0, 0, 0))), _numbers(origin.get("xyz"), (0, 0, 0))


def _joint(element: Element) -> Joint:
    axis_element, limit, mimic = element.find("axis"), element.find("limit"), element.find("mimic")
    axis = _numbers(axis_element.get("xyz") if axis_element is not None else None, (1, 0, 0))
    kind = _attribute(element, "type")
    if kind in MOVING:
        length = np.linalg.norm(axis)
        if length < SHORTEST_AXIS:
            raise ValueError(f"the axis {axis} has no direction")
        axis = axis / length
    bounds = limit if kind in ("revolute", "prismatic") else None
    soft = element.find("safety_controller") if bounds is not None else None
    lower, upper = -np.inf, np.inf
    if bounds is not None:
        lower, upper = (_number(bounds, key, 0.0, infinite=True) for key in ("lower", "upper"))
    if soft is not None:
        narrow = _number(soft, "soft_lower_limit", -np.inf, True), _number(soft, "soft_upper_limit", np.inf, True)
        if narrow != (0.0, 0.0):
            lower, upper = max(lower, narrow[0]), min(upper, narrow[1])
    R, p = _origin(element)
    return Joint(
        name=_attribute(element, "name"),
        kind=kind,
        parent=_attribute(_child(element, "parent"), "link"),
        child=_attribute(_child(element, "child"), "link"),
        origin_R=R,
        origin_p=p,
        axis=axis,
        lower=lower,
        upper=upper,
        velocity=_number(limit, "velocity", np.inf, infinite=True) if limit is not None else np.inf,
        mimic=None
        if mimic is None
        else (_attribute(mimic, "joint"), _number(mimic, "multiplier", 1.0), _number(mimic, "offset", 0.0)),
    )


def _candidates(name: str, urdf: Path) -> list[Path]:
    """Where a mesh may be: beside the URDF or in any folder above it; for ``package://`` also in ROS' index."""
    scheme, separator, rest = name.partition("://")
    relative = rest if separator else name
    folders = [urdf.parent, *urdf.parents]
    found = [folder / relative for folder in folders]
    if scheme == "package" and separator:
        package, _, inside = relative.partition("/")
        index = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
        found += [Path(prefix) / "share" / relative for prefix in index if prefix]
        for source in filter(None, os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)):
            found.append(Path(source) / relative)
            if Path(source).name == package:
                found.append(Path(source) / inside)
        found += [folder / inside for folder in folders if inside]  # the package's folder has another name
    return found


def _mesh_file(name: str, urdf: Path) -> Path:
    """Path of a mesh."""
    scheme, separator, _ = name.partition("://")
    if separator and scheme not in ("package", "file"):
        return locate(name)
    for spelling in (name, unquote(name), name.replace("\\", "/")):
        for candidate in _candidates(spelling, urdf):
            if candidate.is_file():
                return candidate
    raise invalid_plan(f"{urdf}: no mesh {name!r} in its folder or those above it")


def _collision_solid(geometry: Element, urdf: Path) -> Solid:
    child = geometry[0]
    if child.tag == "mesh":
        name = _attribute(child, "filename")
        return hull(mesh_points(_mesh_file(name, urdf)) * _numbers(child.get("scale"), (1, 1, 1)), name)
    if child.tag == "box":
        return _primitive(child, _numbers(_attribute(child, "size"), (0, 0, 0)))
    if child.tag in ("sphere", "cylinder", "capsule"):
        keys = ("radius",) if child.tag == "sphere" else ("radius", "length")
        return _primitive(child, np.array([float(_attribute(child, key)) for key in keys]))
    raise invalid_plan(
        f"{urdf}: unknown collision geometry {child.tag!r}; allowed: mesh, box, sphere, cylinder, capsule"
    )


def _primitive(element: Element, size: np.ndarray) -> Solid:
    if not (np.isfinite(size).all() and size.min() > 0.0):
        raise ValueError(f"a <{element.tag}> of size {size}")
    return solid(element.tag, tuple(size.tolist()))


def _link_shapes(element: Element, urdf: Path) -> list[LinkShape]:
    shapes = []
    for collision in element.findall("collision"):
        R, p = _origin(collision)
        shape = _collision_solid(_child(collision, "geometry"), urdf)
        shapes.append(LinkShape(_attribute(element, "name"), shape, R, p))
    return shapes


def _ordered(joints: list[Joint], root: str) -> tuple[Joint, ...]:
    below: dict[str, list[Joint]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint)
    ordered, frontier = [], [root]
    for link in frontier:
        ordered += below.get(link, [])
        frontier += [joint.child for joint in below.get(link, [])]
    return tuple(ordered)


def _tree(path: Path, links: list[str], joints: list[Joint]) -> tuple[str, tuple[Joint, ...]]:
    """Name of the base link, and the joints in order; they have to form one tree of links that exist."""
    children = [joint.child for joint in joints]
    for kind, names in (("link", links), ("joint", [joint.name for joint in joints]), ("child link", children)):
        twice = {name for name, count in Counter(names).items() if count > 1}
        if twice:
            raise invalid_plan(f"{path}: the {kind} {', '.join(sorted(twice))} is there twice")
    missing = {link for joint in joints for link in (joint.parent, joint.child)} - set(links)
    if missing:
        raise invalid_plan(f"{path}: joints name the links {', '.join(sorted(missing))}, which are missing")
    roots = set(links).difference(children)
    if len(roots) != 1:
        raise invalid_plan(f"{path}: {len(roots)} links without a parent; a robot has exactly one")
    root = roots.pop()
    ordered = _ordered(joints, root)
    if len(ordered) != len(joints):
        loop = {joint.name for joint in joints} - {joint.name for joint in ordered}
        raise invalid_plan(f"{path}: the joints {', '.join(sorted(loop))} form a loop")
    return root, ordered


def _element(path: Path) -> Element:
    """The root element; xacro files are expanded. Prefixes of tags need not be declared, as in PyBullet."""
    data = path.read_bytes().lstrip()
    root = None if path.suffix == ".xacro" else _parsed(data)
    if root is None or any(element.tag.startswith("xacro:") for element in root.iter()):
        import xacro  # optional, and only for xacro files

        root = _parsed(xacro.process_file(str(path)).toxml().encode())
    return root


def _parsed(data: bytes) -> Element:
    builder, parser = TreeBuilder(), expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    parser.Parse(data, True)
    return builder.close()


def load(uri: str) -> Urdf:
    """Reads a robot.

    Args:
        uri: of the URDF file, see :func:`hmap_core.validation.files.locate`.

    Returns:
        The kinematic tree, from a cache.

    Raises:
        InputError: INVALID_PLAN_FILE; the file does not exist or is no URDF with a single tree.
    """
    path = locate(uri)
    state = path.stat()
    return _load(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=16)
def _load(path: Path, _changed: int, _size: int) -> Urdf:
    try:
        robot = _element(path)
        joints = [_joint(element) for element in robot.findall("joint")]
        links = [_attribute(element, "name") for element in robot.findall("link")]
        shapes = [shape for element in robot.findall("link") for shape in _link_shapes(element, path)]
    except InputError:
        raise
    except Exception as error:  # xacro evaluates expressions of the file, which raise exceptions of any type
        raise invalid_plan(f"{path}: not a readable URDF ({error})") from error
    root, ordered = _tree(path, links, joints)
    return Urdf(root, tuple(links), ordered, tuple(shapes))
