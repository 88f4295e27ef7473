"""Reads the joints of a robot description."""

from collections.abc import Sequence

import numpy as np

from hmap_core.robot_description.node import LARGEST, Node
from hmap_core.robot_description.tree import ASSUMED_FIXED, MOVING, Joint, mimic_relations
from hmap_core.transforms import from_rpy

SOFT = ("lower", -np.inf), ("upper", np.inf)  # limits of a safety controller, and what counts where they are missing
KINDS = (*MOVING, "fixed", *ASSUMED_FIXED)
LIMITED = ("revolute", "prismatic")
QUATERNION = "quat_xyzw"  # of URDF 1.2, which PyBullet and most others do not read
UNIT_TOLERANCE = 1e-3  # deviation of an axis' length from 1 that is rounding
LARGEST_ANGLE = 2.01 * np.pi  # rad; a larger one in an origin is probably in degrees
MOST_TURNS = 4  # of a revolute joint to either side; more are probably in degrees
MIMIC_TOLERANCE = 1e-3  # rad or m by which a joint may leave its limits where it mimics another, as by rounding
SHORTEST_AXIS = 1e-6  # shorter ones have no direction


def read_origin(node: Node) -> np.ndarray:
    """The pose (7,) in the ``origin`` of an element; the identity if it has none, or it cannot be read."""
    origin = node.child("origin")
    zero = np.zeros(3)
    if origin is None:
        return from_rpy(zero, zero)
    if origin.element.get(QUATERNION) is not None:
        origin.error(
            f"has the attribute {QUATERNION}, which most readers of URDF files ignore", 'give the angles: rpy=""'
        )
    xyz, rpy = (origin.numbers(key, 3, (0.0, 0.0, 0.0)) for key in ("xyz", "rpy"))
    if rpy is not None and np.abs(rpy).max() > LARGEST_ANGLE:
        origin.warn(f'rpy="{origin.element.get("rpy")}" is more than a full turn', "angles are in radians")
    return from_rpy(zero if xyz is None else xyz, zero if rpy is None else rpy)


def read_joint(node: Node) -> Joint | None:
    """Reads a joint; None, with recorded errors, if it cannot be used."""
    name = node.text("name")
    if name is None:
        return None
    node = node.at(f"joint '{name}'")
    kind = node.text("type")
    parent, child = (_link(node, tag) for tag in ("parent", "child"))
    if kind is not None and kind not in KINDS:
        node.error(f'type="{kind}" is not known', f"allowed: {', '.join(KINDS)}")
    if kind not in KINDS or parent is None or child is None:
        return None
    if kind in ASSUMED_FIXED:
        node.warn(f'type="{kind}" is not supported; it is taken for fixed, at its origin', 'use type="fixed"')
    moves = kind in MOVING
    axis = _axis(node) if moves else np.array([1.0, 0.0, 0.0])
    lower, upper, velocity, effort = _limits(node, kind) if moves else (-np.inf, np.inf, np.inf, None)
    mimic = _mimic(node, moves)
    _check_dynamics(node)
    return Joint(name, kind, parent, child, read_origin(node), axis, lower, upper, velocity, effort, mimic)


def _link(node: Node, tag: str) -> str | None:
    end = node.child(tag)
    if end is None:
        node.error(f"has no <{tag}>")
        return None
    return end.text("link")


def _axis(node: Node) -> np.ndarray:
    element = node.child("axis")
    axis = np.array([1.0, 0.0, 0.0]) if element is None else element.numbers("xyz", 3, [1, 0, 0])
    if axis is None or element is None:
        return np.array([1.0, 0.0, 0.0])
    length = float(np.linalg.norm(axis))
    shown = f'xyz="{element.element.get("xyz")}"'
    if length < SHORTEST_AXIS:
        element.error(f"{shown} has no direction", "give a vector of length 1")
        return np.array([1.0, 0.0, 0.0])
    if abs(length - 1.0) > UNIT_TOLERANCE:
        element.warn(f"{shown} has the length {length:g}; the vector of length 1 is used")
    return axis / length


def _limits(node: Node, kind: str) -> tuple[float, float, float, float | None]:
    """Lower and upper position limit, velocity limit, and effort; infinite, or None, where there is none."""
    element = node.child("limit")
    lower, upper, velocity, effort = -np.inf, np.inf, np.inf, None
    if element is None:
        if kind in LIMITED:
            node.error(f"is {kind} and has no <limit>", 'add <limit lower="" upper="" velocity="" effort="">')
        else:
            node.warn("has no <limit>; an effort is assumed in the simulation")
        return lower, upper, velocity, effort
    if kind in LIMITED:
        lower, upper = _within_soft_limits(node, *_range(element))
        far = max((abs(value) for value in (lower, upper) if np.isfinite(value)), default=0.0)
        if kind == "revolute" and far > 2.0 * np.pi * MOST_TURNS:
            element.warn(f"allows the joint {far:g} rad", "limits are in radians")
    if element.element.get("velocity") is None:
        element.warn("has no velocity; that of the robot file counts")
    else:
        velocity = _not_negative(element, "velocity")
    if element.element.get("effort") is None:
        element.warn("has no effort; one is assumed in the simulation")
    else:
        effort = _not_negative(element, "effort")
        if effort == 0.0:
            element.warn('effort="0" lets the joint drop; an effort is assumed in the simulation')
    return lower, upper, velocity, effort if effort and np.isfinite(effort) else None


def _within_soft_limits(node: Node, lower: float, upper: float) -> tuple[float, float]:
    """Position limits within those of ``<safety_controller>``, beyond which a controller stops the joint."""
    element = node.child("safety_controller")
    if element is None:
        return lower, upper
    soft = [element.number(f"soft_{side}_limit", default, infinite=True) for side, default in SOFT]
    if soft[0] is None or soft[1] is None:
        return lower, upper
    if soft[0] == soft[1] == 0.0:
        element.warn("both soft limits are 0; they are ignored", "remove them, or give those of the controller")
        return lower, upper
    within = max(lower, soft[0]), min(upper, soft[1])
    if within[0] > within[1]:
        element.error(f"its soft limits {soft[0]:g} to {soft[1]:g} leave nothing of the limits {lower:g} to {upper:g}")
        return lower, upper
    return within


def _range(element: Node) -> tuple[float, float]:
    given = [key for key in ("lower", "upper") if element.element.get(key) is not None]
    if len(given) < 2:
        missing = " and ".join(key for key in ("lower", "upper") if key not in given)
        element.warn(f"has no {missing}; 0 is used, as the URDF specification has it")
    lower, upper = (element.number(key, 0.0, infinite=True) for key in ("lower", "upper"))
    if lower is None or upper is None:
        return -np.inf, np.inf
    if lower > upper:
        element.error(f'lower="{lower:g}" is above upper="{upper:g}"', "exchange them")
        return -np.inf, np.inf
    if lower == upper:
        element.warn(f"lower and upper are both {lower:g}: the joint cannot move")
    return lower, upper


def _not_negative(element: Node, key: str) -> float:
    value = element.number(key, infinite=True)
    if value is not None and value < 0.0:
        element.error(f'{key}="{value:g}" is negative')
    return np.inf if value is None or value < 0.0 else value


def _mimic(node: Node, moves: bool) -> tuple[str, float, float] | None:
    element = node.child("mimic")
    if element is None:
        return None
    driver, multiplier, offset = element.text("joint"), element.number("multiplier", 1.0), element.number("offset", 0.0)
    if not moves:
        element.warn("the joint does not move; it is ignored")
    if driver is None or multiplier is None or offset is None or not moves:
        return None
    return driver, multiplier, offset


def _check_dynamics(node: Node) -> None:
    element = node.child("dynamics")
    if element is not None:
        for key in ("damping", "friction"):
            if (element.number(key, 0.0) or 0.0) < 0.0:
                element.error(f'{key}="{element.element.get(key)}" is negative')


def check_mimics(nodes: dict[str, Node], joints: Sequence[Joint]) -> None:
    """Records what is wrong with the joints that mimic others.

    An error for each that mimics one that does not exist, or itself; a warning for each that leaves its own limits when
    the joint that drives it moves through its range.
    """
    by_name = {joint.name: joint for joint in joints}
    for joint in joints:
        if joint.mimic is not None and joint.mimic[0] not in by_name:
            nodes[joint.name].error(f"mimics '{joint.mimic[0]}', which is not in the URDF")
    drivers, rings = mimic_relations(by_name)
    for ring in rings:
        for name, driver in zip(ring, [*ring[1:], ring[0]], strict=True):
            nodes[name].error(f"mimics '{driver}', which follows it in turn")
    for name, (driver, factor, offset) in drivers.items():
        if name != driver and not (abs(factor) <= LARGEST and abs(offset) <= LARGEST):
            text = f"it moves {factor:g} times as far as '{driver}', which drives it, and {offset:g} beside it"
            nodes[name].error(text, f"at most {LARGEST:g} is allowed")
        elif name != driver:
            _check_range(nodes[name], by_name[name], by_name[driver], factor, offset)


def _check_range(node: Node, joint: Joint, driver: Joint, factor: float, offset: float) -> None:
    """Warns of a mimic joint that leaves its own limits within the range of the joint that drives it."""
    ends = [factor * end + offset if factor else offset for end in (driver.lower, driver.upper)]
    if min(ends) < joint.lower - MIMIC_TOLERANCE or max(ends) > joint.upper + MIMIC_TOLERANCE:
        node.warn(
            f"leaves its limits {joint.lower:g} to {joint.upper:g}: '{driver.name}', which it mimics, moves it from "
            f"{min(ends):g} to {max(ends):g}, and it is moved so",
            f"widen its limits, or narrow those of '{driver.name}'",
        )
