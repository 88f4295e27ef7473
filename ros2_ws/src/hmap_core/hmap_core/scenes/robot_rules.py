"""What a robot file may say of a robot description: joints, chain and limits have to fit together."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hmap_core.exceptions import Code, InputError
from hmap_core.robot_description import Finding, RobotDescription, Severity, cleaned_urdf, load_robot_description
from hmap_core.types import RobotModel

LIMIT_TOLERANCE = 1e-4  # rad or m, excess over a limit of the URDF that is attributed to rounding
VELOCITY_TOLERANCE = 1e-3  # the same for velocity limits, relative
MOST_JOINTS = 100  # of an arm; the time of a Newton step grows with the square of their number

Place = tuple[str | int, ...]  # keys of the robot file


@dataclass(frozen=True)
class Problem:
    """A contradiction between a robot file and its URDF: keys of the robot file, and what is wrong or assumed."""

    place: Place
    text: str
    severity: Severity = Severity.ERROR


@dataclass(frozen=True)
class ArmEntry:
    """What a robot file says of the arm.

    Attributes:
        joints: names of the n joints, base to tip. They are joints of the URDF that can move.
        end_effector_link: a link of the URDF.
        position_limits: (2, n) rad or m.
        velocity_limits: (n,) rad/s or m/s.
        gripper_joints: joints of the URDF.
    """

    joints: tuple[str, ...]
    end_effector_link: str
    position_limits: np.ndarray
    velocity_limits: np.ndarray
    gripper_joints: tuple[str, ...] = ()


def problems(description: RobotDescription, arm: ArmEntry) -> Iterator[Problem]:
    """Finds contradictions between a robot file and a valid robot description."""
    if len(arm.joints) > MOST_JOINTS:
        yield Problem(("joints",), f"has {len(arm.joints)} joints; an arm may have {MOST_JOINTS}")
        return
    yield from _chain(description, arm)
    yield from _limits(description, arm)
    yield from _others(description, arm)


def _chain(description: RobotDescription, arm: ArmEntry) -> Iterator[Problem]:
    tree = description.tree
    for i, name in enumerate(arm.joints):
        mimic = tree.by_name[name].mimic
        if mimic is not None:
            driver = tree.driver(name)[0]
            yield Problem(("joints", i), f"mimics {driver} in the URDF; name joints that move by themselves")
    chain = [joint.name for joint in tree.path(arm.end_effector_link)]
    for i, name in enumerate(arm.joints):
        if name not in chain:
            on_chain = ", ".join(j for j in chain if tree.by_name[j].moves) or "none"
            text = f"is not on the chain to end_effector.link, {arm.end_effector_link}; its joints are {on_chain}"
            yield Problem(("joints", i), text)
            return
    ordered = [name for name in chain if name in arm.joints]
    if ordered != list(arm.joints):
        i = next(i for i, (a, b) in enumerate(zip(ordered, arm.joints, strict=True)) if a != b)
        yield Problem(("joints", i), f"is in the wrong place; from base to tip they are {', '.join(ordered)}")


def _limits(description: RobotDescription, arm: ArmEntry) -> Iterator[Problem]:
    """Limits that are wider than those of the URDF."""
    position, velocity = allowed_limits(description, arm)
    for i, name in enumerate(arm.joints):
        joint = description.joints[name]
        if position[0, i] >= position[1, i]:
            text = f"of {name} leave no range: the URDF allows {joint.lower:g} to {joint.upper:g}"
            yield Problem(("position_limits", "lower", i), text)
            continue
        for key, given, own, used in (
            ("lower", arm.position_limits[0, i], joint.lower, position[0, i]),
            ("upper", arm.position_limits[1, i], joint.upper, position[1, i]),
        ):
            if abs(given - used) > LIMIT_TOLERANCE:
                text = f"of {name} is beyond that of the URDF, {own:g}, which is used"
                yield Problem(("position_limits", key, i), text, Severity.WARNING)
        if arm.velocity_limits[i] > velocity[i] * (1.0 + VELOCITY_TOLERANCE):
            text = f"of {name} is above that of the URDF, {joint.velocity:g}, which is used"
            yield Problem(("velocity_limits", i), text, Severity.WARNING)


def allowed_limits(description: RobotDescription, arm: ArmEntry) -> tuple[np.ndarray, np.ndarray]:
    """The limits that both the robot file and the URDF allow.

    Returns:
        Position limits (2, n) and velocity limits (n,). A velocity limit of 0 in the URDF counts as none.
    """
    joints = [description.joints[name] for name in arm.joints]
    lower = np.maximum(arm.position_limits[0], [joint.lower for joint in joints])
    upper = np.minimum(arm.position_limits[1], [joint.upper for joint in joints])
    velocity = np.minimum(arm.velocity_limits, [joint.velocity or np.inf for joint in joints])
    return np.array([lower, upper]), velocity


def _others(description: RobotDescription, arm: ArmEntry) -> Iterator[Problem]:
    """Joints that the file does not name, and that have to move or cannot stay where they are."""
    tree, carried = description.tree, _carried(description, arm.end_effector_link)
    for joint in _unnamed(description, arm):
        driver, _, _ = tree.driver(joint)
        if joint not in carried:
            continue
        if driver in arm.joints:
            text = f"{joint} mimics it in the URDF and moves {carried[joint]}; only gripper joints may mimic others"
            yield Problem(("joints", arm.joints.index(driver)), text)
            continue
        value, limits = tree.value(joint, {}), tree.by_name[joint]
        if not limits.lower - LIMIT_TOLERANCE <= value <= limits.upper + LIMIT_TOLERANCE:
            text = f"{joint} is not one of them and would stay at {value:g}; the URDF allows {limits.lower:g} to "
            yield Problem(("joints",), text + f"{limits.upper:g}. Name it, or make it fixed in the URDF")


def _unnamed(description: RobotDescription, arm: ArmEntry) -> list[str]:
    """The moving joints that neither the file names nor a gripper joint drives."""
    tree = description.tree
    named = {*arm.joints, *arm.gripper_joints}
    moving = [name for name, joint in description.joints.items() if joint.moves and name not in named]
    return [name for name in moving if tree.driver(name)[0] not in arm.gripper_joints]


def _carried(description: RobotDescription, end_effector_link: str) -> dict[str, str]:
    """For each joint that moves a link that matters the first such link: it has a shape, or is the end effector's."""
    carried: dict[str, str] = {}
    by_child = description.tree.by_child
    for name, link in description.links.items():
        if link.shapes or name == end_effector_link:
            at = name
            while at in by_child and by_child[at].name not in carried:
                carried[by_child[at].name] = name
                at = by_child[at].parent
    return carried


def unnamed_joints(description: RobotDescription, arm: ArmEntry) -> list[Finding]:
    """A warning for each joint that could move, and that the robot file does not name."""
    value = description.tree.value
    return [
        Finding(
            Severity.WARNING,
            description.file,
            f"joint '{name}'",
            f"the robot file does not name it; it is taken for fixed, at {value(name, {}):g}",
        )
        for name in _unnamed(description, arm)
    ]


def simulated_urdf(model: RobotModel) -> Path:
    """Path of the URDF that is simulated: the cleaned one, in which joints that nothing moves are fixed.

    Raises:
        InputError: INVALID_SCENE; the robot description has errors.
    """
    description = load_robot_description(model.urdf).require_valid()
    return cleaned_urdf(description, _unnamed(description, _arm_entry(model)))


def _arm_entry(model: RobotModel) -> ArmEntry:
    gripper = model.gripper.joint_names if model.gripper else ()
    limits = model.position_limits, model.velocity_limits
    return ArmEntry(model.joint_names, model.end_effector_link, *limits, tuple(gripper))


def checked_model(model: RobotModel) -> RobotModel:
    """Checks a robot model that comes from a message or a plan file.

    Returns:
        The model, with the limits that its URDF allows.

    Raises:
        InputError: INVALID_SCENE; its URDF has errors, lacks a joint or link of the model, or contradicts it.
    """

    def refused(problem: str) -> InputError:
        return InputError(f"robot '{model.name}': {problem}", Code.INVALID_SCENE)

    description = load_robot_description(model.urdf).require_valid()
    gripper = model.gripper.joint_names if model.gripper else ()
    for name in (*model.joint_names, *gripper):
        if name not in description.joints or not description.joints[name].moves:
            known = ", ".join(joint.name for joint in description.joints.values() if joint.moves)
            raise refused(f"joint '{name}' is not in the URDF; it has {known}")
    for name in (model.end_effector_link, *(model.gripper.finger_links if model.gripper else ())):
        if name not in description.links:
            raise refused(f"link '{name}' is not in the URDF; it has {', '.join(description.links)}")
    arm = _arm_entry(model)
    for problem in problems(description, arm):
        if problem.severity is Severity.ERROR:
            at = next((f" of joint '{model.joint_names[p]}'" for p in problem.place if isinstance(p, int)), "")
            raise refused(f"{problem.place[0]}{at}: {problem.text}")
    position, velocity = allowed_limits(description, arm)
    return replace(model, position_limits=position, velocity_limits=velocity)
