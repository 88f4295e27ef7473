"""Builds the gripper of a robot file: computes omitted values from the URDF and checks given ones against it."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np
import scipy

from hmap_core.exceptions import InputError
from hmap_core.robot_description import JointTree, RobotDescription
from hmap_core.scenes.document import Document
from hmap_core.scenes.gripper_geometry import FingerPositions, GripperGeometry
from hmap_core.scenes.robot_rules import LIMIT_TOLERANCE
from hmap_core.scenes.schema import GripperEntry, RobotFile
from hmap_core.types import GRIPPER_SPEED, Gripper

TRAVEL_SAMPLES = 33  # number of travels between closed and open at which the opening is tabulated
JAW_CLEARANCE = 0.004  # m, default difference between the open gripper and the widest grasp
MAX_MIDDLE_OFFSET = 0.001  # m, largest offset of the middle between the pads from the end-effector frame
KEYS = ("joints", "closed", "open", "per_joint", "at_zero", "finger_links")  # keys that are converted, not copied


def build_gripper(document: Document, robot: RobotFile, description: RobotDescription) -> Gripper:
    """Builds the gripper of a robot file.

    Args:
        document: the robot file, for error messages.
        robot: its content; has a gripper.
        description: the robot description, which has all joints and links that the file names.

    Returns:
        The gripper.

    Raises:
        InputError: INVALID_SCENE; a joint would exceed its limits, or the fingers do not open as the file says.
        ValueError: the file has no gripper.
    """
    entry = robot.gripper
    if entry is None:
        raise ValueError(f"robot file '{document.path}' has no gripper")
    _check_drivers(document, entry, description.tree)
    end_effector = robot.end_effector.link, robot.end_effector.pose.vector()
    geometry = GripperGeometry(description, end_effector, entry.finger_links)
    given = {key: value for key, value in entry.model_dump(exclude=set(KEYS)).items() if value is not None}
    given |= {"joint_names": tuple(entry.joints), "finger_links": tuple(entry.finger_links)}
    if entry.per_joint is None:
        gripper = _rotating_gripper(document, entry, geometry, given)
    else:
        if entry.at_zero is not None:
            given["at_zero"] = _as_tuple(entry.at_zero)
        gripper = _sliding_gripper(document, entry, geometry, {"min_opening": 0.0} | given)
    if not gripper.min_opening < gripper.max_opening <= gripper.open_opening:
        raise document.error(
            ("gripper", "max_opening"),
            f"must be above min_opening, {gripper.min_opening:g}, and at most open_opening, {gripper.open_opening:g}",
        )
    return gripper if entry.speed is not None else _with_speed(document, gripper, description.tree)


def _check_drivers(document: Document, entry: GripperEntry, tree: JointTree) -> None:
    """Checks that no driven joint mimics a joint that is not driven."""
    for i, name in enumerate(entry.joints):
        driver, _, _ = tree.driver(name)
        if driver not in entry.joints:
            raise document.error(("gripper", "joints", i), f"mimics {driver} in the URDF; name that one instead")


def _as_tuple(value: float | list[float]) -> float | tuple[float, ...]:
    return tuple(value) if isinstance(value, list) else value


def _sliding_gripper(document: Document, entry: GripperEntry, geometry: GripperGeometry, given: dict) -> Gripper:
    """A gripper whose joints are proportional to the opening."""
    gripper = Gripper(**{"tip_offset": 0.0} | given, per_joint=_as_tuple(entry.per_joint))
    for opening in (gripper.min_opening, gripper.open_opening):
        _check_limits(document, entry, "per_joint", gripper.joints(opening), geometry.tree)
    if entry.tip_offset is not None:
        return gripper
    values = dict(zip(entry.joints, gripper.joints(gripper.min_opening), strict=True))
    tip = _finger_positions(document, geometry, values).tip
    return Gripper(**given, per_joint=gripper.per_joint, tip_offset=_checked_tip(document, tip))


def _rotating_gripper(document: Document, entry: GripperEntry, geometry: GripperGeometry, given: dict) -> Gripper:
    """A gripper whose openings between closed and open are computed from the shapes of the URDF."""
    n = len(entry.joints)
    closed, opened = (np.broadcast_to(np.array(value, float), n) for value in (entry.closed, entry.open))
    for key, joints in (("closed", closed), ("open", opened)):
        _check_limits(document, entry, key, joints, geometry.tree)

    def positions(travel: float) -> FingerPositions:
        values = closed + travel * (opened - closed)
        return _finger_positions(document, geometry, dict(zip(entry.joints, values, strict=True)))

    first = _closed_travel(document, positions)
    start = closed + first * (opened - closed)
    found = [positions(travel) for travel in np.linspace(first, 1.0, TRAVEL_SAMPLES)]
    _check_positions(document, found)
    openings = tuple(max(position.gap, 0.0) for position in found)
    return Gripper(
        per_joint=tuple((opened - start).tolist()),
        at_zero=tuple(start.tolist()),
        openings=openings,
        tips=tuple(position.tip - found[0].tip for position in found),
        **_with_defaults(document, given, openings, found[0].tip),
    )


def _closed_travel(document: Document, positions: Callable[[float], FingerPositions]) -> float:
    """The travel in [0, 1] above which the fingers do not overlap."""
    closed, opened = positions(0.0).gap, positions(1.0).gap
    if opened <= max(closed, 0.0):
        problem = f"finger_links are {opened:.4f} m apart here and {closed:.4f} m at closed; they have to be farther"
        raise document.error(("gripper", "open"), problem)
    return scipy.optimize.brentq(lambda travel: positions(travel).gap, 0.0, 1.0) if closed < 0.0 else 0.0


def _check_positions(document: Document, found: Sequence[FingerPositions]) -> None:
    """Checks that the gap grows from closed to open and stays centred in the end-effector frame."""
    widening = np.diff([position.gap for position in found])
    if widening.min() <= 0.0:
        share = (int(widening.argmin()) + 0.5) / len(widening)
        problem = f"the gap between finger_links has to grow all the way; {100 * share:.0f} % from closed it does not"
        raise document.error(("gripper", "open"), problem)
    off = max((position.middle for position in found), key=abs)
    if abs(off) > MAX_MIDDLE_OFFSET:
        problem = (
            f"the middle between finger_links is at y = {off:.4f} m in it; at most {MAX_MIDDLE_OFFSET} m are allowed"
        )
        raise document.error(("end_effector", "pose"), problem)


def _with_defaults(document: Document, given: dict, openings: tuple[float, ...], tip: float) -> dict:
    """The values of a robot file, completed by those that follow from the finger geometry."""
    values = {"min_opening": openings[0], "open_opening": openings[-1]} | given
    for key in ("min_opening", "open_opening"):
        if not openings[0] - LIMIT_TOLERANCE <= values[key] <= openings[-1] + LIMIT_TOLERANCE:
            problem = f"must be between {openings[0]:.4f} and {openings[-1]:.4f}, as finger_links have it"
            raise document.error(("gripper", key), problem)
    if "tip_offset" not in values:
        values["tip_offset"] = _checked_tip(document, tip)
    return {"max_opening": values["open_opening"] - JAW_CLEARANCE} | values


def _finger_positions(document: Document, geometry: GripperGeometry, values: dict[str, float]) -> FingerPositions:
    try:
        return geometry.at(values)
    except InputError as error:
        raise document.error(("gripper", "finger_links"), error.reason) from error


def _checked_tip(document: Document, tip: float) -> float:
    if tip < 0.0:
        problem = f"finger_links end {-tip:.4f} m behind it; it has to be between the pads"
        raise document.error(("end_effector", "pose"), problem)
    return tip


def _check_limits(document: Document, entry: GripperEntry, key: str, joints: Iterable[float], tree: JointTree) -> None:
    """Checks that the joint values (k,) of ``key`` are within the URDF's limits."""
    for name, value in zip(entry.joints, joints, strict=True):
        joint = tree.by_name[name]
        if not joint.lower - LIMIT_TOLERANCE <= value <= joint.upper + LIMIT_TOLERANCE:
            problem = f"puts {name} at {value:.4f}; the URDF allows {joint.lower:g} to {joint.upper:g}"
            raise document.error(("gripper", key), problem)


def _with_speed(document: Document, gripper: Gripper, tree: JointTree) -> Gripper:
    """The gripper with its speed limited by the URDF's velocity limits of its joints and their mimic joints."""
    openings = gripper.openings or (gripper.min_opening, gripper.open_opening)
    rates = np.abs([gripper.joints_per_opening(float(opening)) for opening in openings]).max(axis=0)
    speed = GRIPPER_SPEED
    for name, rate in zip(gripper.joint_names, rates.tolist(), strict=True):
        moved = {name: 1.0} | {mimic: abs(factor) for mimic, (factor, _) in tree.mimics(name).items()}
        for joint, factor in moved.items():
            if factor > 0.0:
                speed = min(speed, tree.by_name[joint].velocity / (factor * rate))
    if speed <= 0.0:
        problem = "the URDF's velocity limits do not let them move; they have to be positive"
        raise document.error(("gripper", "joints"), problem)
    return gripper if speed == gripper.speed else replace(gripper, speed=speed)
