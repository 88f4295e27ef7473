"""Kinematics and collision shapes of a robot from its URDF, with the standard library and NumPy only."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from hmap_core.validation import rigid
from hmap_core.validation.files import invalid_plan, locate, mesh_points
from hmap_core.validation.geometry import Solid, hull, solid

MOVING = ("revolute", "continuous", "prismatic")


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


def _numbers(text: str | None, default: tuple[float, ...]) -> np.ndarray:
    return np.array(text.split() if text else default, float)


def _attribute(element: Element, key: str) -> str:
    value = element.get(key)
    if value is None:
        raise ValueError(f"a <{element.tag}> has no attribute '{key}'")
    return value


def _child(element: Element, tag: str) -> Element:
    found = element.find(tag)
    if found is None:
        raise ValueError(f"a <{element.tag}> has no <{tag}>")
    return found


def _origin(element: Element) -> tuple[np.ndarray, np.ndarray]:
    origin = element.find("origin")
    if origin is None:
        return np.eye(3), np.zeros(3)
    return rigid.from_rpy(_numbers(origin.get("rpy"), (0, 0, 0))), _numbers(origin.get("xyz"), (0, 0, 0))


def _joint(element: Element) -> Joint:
    axis_element, limit, mimic = element.find("axis"), element.find("limit"), element.find("mimic")
    axis = _numbers(axis_element.get("xyz") if axis_element is not None else None, (1, 0, 0))
    kind = _attribute(element, "type")
    if kind in MOVING:
        axis = axis / np.linalg.norm(axis)
    bounds = None if kind == "continuous" else limit
    R, p = _origin(element)
    return Joint(
        name=_attribute(element, "name"),
        kind=kind,
        parent=_attribute(_child(element, "parent"), "link"),
        child=_attribute(_child(element, "child"), "link"),
        origin_R=R,
        origin_p=p,
        axis=axis,
        lower=float(bounds.get("lower", 0.0)) if bounds is not None else -np.inf,
        upper=float(bounds.get("upper", 0.0)) if bounds is not None else np.inf,
        velocity=float(limit.get("velocity", "inf")) if limit is not None else np.inf,
        mimic=None
        if mimic is None
        else (_attribute(mimic, "joint"), float(mimic.get("multiplier", 1.0)), float(mimic.get("offset", 0.0))),
    )


def _mesh_file(name: str, urdf: Path) -> Path:
    """Path of a mesh. ``package://`` is relative to the URDF's folder, as in PyBullet, or to a folder above it."""
    scheme, separator, rest = name.partition("://")
    if separator and scheme != "package":
        return locate(name)
    relative = rest if separator else name
    folders = [urdf.parent, *urdf.parents]
    candidates = [folder / part for part in (relative, relative.partition("/")[2]) if part for folder in folders[:4]]
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    raise invalid_plan(f"{urdf}: no mesh {name!r} in its folder or those above it")


def _collision_solid(geometry: Element, urdf: Path) -> Solid:
    child = geometry[0]
    if child.tag == "mesh":
        name = _attribute(child, "filename")
        points = mesh_points(_mesh_file(name, urdf)) * _numbers(child.get("scale"), (1, 1, 1))
        return hull(points, name)
    if child.tag == "box":
        return solid("box", tuple(_numbers(child.get("size"), ()).tolist()))
    if child.tag == "sphere":
        return solid("sphere", (float(_attribute(child, "radius")),))
    if child.tag in ("cylinder", "capsule"):
        return solid(child.tag, (float(_attribute(child, "radius")), float(_attribute(child, "length"))))
    raise invalid_plan(
        f"{urdf}: unknown collision geometry {child.tag!r}; allowed: mesh, box, sphere, cylinder, capsule"
    )


def _link_shapes(element: Element, urdf: Path) -> list[LinkShape]:
    shapes = []
    for collision in element.findall("collision"):
        R, p = _origin(collision)
        shape = _collision_solid(_child(collision, "geometry"), urdf)
        shapes.append(LinkShape(_attribute(element, "name"), shape, R, p))
    return shapes


def _ordered(joints: list[Joint], root: str) -> tuple[Joint, ...]:
    ordered, frontier = [], [root]
    while frontier:
        link = frontier.pop(0)
        below = [joint for joint in joints if joint.parent == link]
        ordered += below
        frontier += [joint.child for joint in below]
    return tuple(ordered)


@lru_cache(maxsize=16)
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
    try:
        robot = ElementTree.parse(path).getroot()
        joints = [_joint(element) for element in robot.findall("joint")]
        links = [_attribute(element, "name") for element in robot.findall("link")]
        shapes = [shape for element in robot.findall("link") for shape in _link_shapes(element, path)]
    except (ElementTree.ParseError, AttributeError, ValueError, TypeError, IndexError) as error:
        raise invalid_plan(f"{path}: not a readable URDF ({error})") from error
    roots = [link for link in links if link not in {joint.child for joint in joints}]
    if len(roots) != 1:
        raise invalid_plan(f"{path}: {len(roots)} links without a parent; a robot has exactly one")
    return Urdf(roots[0], tuple(links), _ordered(joints, roots[0]), tuple(shapes))
