"""Grippers of robot files: what they leave to be computed from the URDF, and what does not fit to it."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.optimize import brentq

from hmap_core.exceptions import InputError
from hmap_core.scenes.document import Document
from hmap_core.scenes.gripper_geometry import FingerPlaces, GripperGeometry
from hmap_core.scenes.schema import GripperEntry, RobotFile
from hmap_core.scenes.urdf import JointTree, joint_tree
from hmap_core.types import GRIPPER_SPEED, Gripper

TRAVELS = 33  # places between closed and open at which the opening is known
JAW_CLEARANCE = (
    0.004  # m by which the widest that is gripped is less than the open gripper, where the file does not say
)
MIDDLE_OFF = 0.001  # m that the middle between the pads may be beside the end-effector frame
LIMIT_SLACK = 1e-4  # rad or m that a joint may be over its limit, for rounded numbers
KEYS = ("joints", "closed", "open", "per_joint", "at_zero", "finger_links")  # that are not taken over as they are


def build_gripper(document: Document, entry: RobotFile, urdf: Path, root: Element) -> Gripper:
    """The gripper of a robot file.

    Args:
        root: of the URDF, which has the joints and links that the file names.

    Raises:
        InputError: INVALID_SCENE; joints would leave their limits, or the fingers do not open as the file says.
    """
    own = entry.gripper
    _check_drivers(document, own, joint_tree(root))
    end_effector = entry.end_effector.link, entry.end_effector.pose.vector()
    geometry = GripperGeometry(root, urdf, end_effector, own.finger_links)
    given = {key: value for key, value in own.model_dump(exclude=set(KEYS)).items() if value is not None}
    given |= {"joint_names": tuple(own.joints), "finger_links": tuple(own.finger_links)}
    if own.per_joint is None:
        gripper = _turning(document, own, geometry, given)
    else:
        if own.at_zero is not None:
            given["at_zero"] = _frozen(own.at_zero)
        gripper = _sliding(document, own, geometry, {"min_opening": 0.0} | given)
    if not gripper.min_opening < gripper.max_opening <= gripper.open_opening:
        raise document.error(
            ("gripper", "max_opening"),
            f"must be above min_opening, {gripper.min_opening:g}, and at most open_opening, {gripper.open_opening:g}",
        )
    return gripper if own.speed is not None else _paced(document, gripper, joint_tree(root))


def _check_drivers(document: Document, own: GripperEntry, tree: JointTree) -> None:
    """No joint that is named follows one that is not, and none is named twice."""
    for i, name in enumerate(own.joints):
        try:
            driver, _, _ = tree.driver(name)
        except InputError as error:
            raise document.error(("gripper", "joints", i), error.reason) from error
        if driver not in own.joints:
            raise document.error(("gripper", "joints", i), f"mimics {driver} in the URDF; name that one instead")
        if name in own.joints[:i]:
            raise document.error(("gripper", "joints", i), "is named twice")


def _frozen(value: float | list[float]) -> float | tuple[float, ...]:
    return tuple(value) if isinstance(value, list) else value


def _sliding(document: Document, own: GripperEntry, geometry: GripperGeometry, given: dict) -> Gripper:
    """A gripper whose joints move in proportion to the opening."""
    gripper = Gripper(**{"tip_offset": 0.0} | given, per_joint=_frozen(own.per_joint))
    for opening in (gripper.min_opening, gripper.open_opening):
        _check_limits(document, own, "per_joint", gripper.joints(opening), geometry.tree)
    if own.tip_offset is not None:
        return gripper
    values = dict(zip(own.joints, gripper.joints(gripper.min_opening), strict=True))
    tip = _places(document, geometry, values).tip
    return Gripper(**given, per_joint=gripper.per_joint, tip_offset=_ahead(document, tip))


def _turning(document: Document, own: GripperEntry, geometry: GripperGeometry, given: dict) -> Gripper:
    """A gripper whose openings between closed and open are as the URDF's shapes say."""
    n = len(own.joints)
    closed, opened = (np.broadcast_to(np.array(value, float), n) for value in (own.closed, own.open))
    for key, joints in (("closed", closed), ("open", opened)):
        _check_limits(document, own, key, joints, geometry.tree)

    def places(travel: float) -> FingerPlaces:
        values = closed + travel * (opened - closed)
        return _places(document, geometry, dict(zip(own.joints, values, strict=True)))

    first = _meeting(document, places)
    start = closed + first * (opened - closed)
    found = [places(travel) for travel in np.linspace(first, 1.0, TRAVELS)]
    _check_places(document, found)
    openings = tuple(max(place.gap, 0.0) for place in found)
    return Gripper(
        per_joint=tuple((opened - start).tolist()),
        at_zero=tuple(start.tolist()),
        openings=openings,
        tips=tuple(place.tip - found[0].tip for place in found),
        **_with_defaults(document, given, openings, found[0].tip),
    )


def _meeting(document: Document, places: Callable[[float], FingerPlaces]) -> float:
    """The travel, between 0 and 1, from which on the fingers do not overlap."""
    closed, opened = places(0.0).gap, places(1.0).gap
    if opened <= max(closed, 0.0):
        problem = f"finger_links are {opened:.4f} m apart here and {closed:.4f} m at closed; they have to be farther"
        raise document.error(("gripper", "open"), problem)
    return brentq(lambda travel: places(travel).gap, 0.0, 1.0) if closed < 0.0 else 0.0


def _check_places(document: Document, found: Sequence[FingerPlaces]) -> None:
    """From closed to open, the gap grows and its middle stays in the end-effector frame."""
    widening = np.diff([place.gap for place in found])
    if widening.min() <= 0.0:
        share = (int(widening.argmin()) + 0.5) / len(widening)
        problem = f"the gap between finger_links has to grow all the way; {100 * share:.0f} % from closed it does not"
        raise document.error(("gripper", "open"), problem)
    off = max((place.middle for place in found), key=abs)
    if abs(off) > MIDDLE_OFF:
        problem = f"the middle between finger_links is at y = {off:.4f} m in it; at most {MIDDLE_OFF} m are allowed"
        raise document.error(("end_effector", "pose"), problem)


def _with_defaults(document: Document, given: dict, openings: tuple[float, ...], tip: float) -> dict:
    """What a robot file gives of a gripper, and what its fingers are by themselves where it does not."""
    values = {"min_opening": openings[0], "open_opening": openings[-1]} | given
    for key in ("min_opening", "open_opening"):
        if not openings[0] - LIMIT_SLACK <= values[key] <= openings[-1] + LIMIT_SLACK:
            problem = f"must be between {openings[0]:.4f} and {openings[-1]:.4f}, as finger_links have it"
            raise document.error(("gripper", key), problem)
    if "tip_offset" not in values:
        values["tip_offset"] = _ahead(document, tip)
    return {"max_opening": values["open_opening"] - JAW_CLEARANCE} | values


def _places(document: Document, geometry: GripperGeometry, values: dict[str, float]) -> FingerPlaces:
    try:
        return geometry.at(values)
    except InputError as error:
        raise document.error(("gripper", "finger_links"), error.reason) from error


def _ahead(document: Document, tip: float) -> float:
    if tip < 0.0:
        problem = f"finger_links end {-tip:.4f} m behind it; it has to be between the pads"
        raise document.error(("end_effector", "pose"), problem)
    return tip


def _check_limits(document: Document, own: GripperEntry, key: str, joints: Sequence[float], tree: JointTree) -> None:
    """The joints, at (k,), are within the URDF's limits where ``key`` puts them."""
    for name, value in zip(own.joints, joints, strict=True):
        joint = tree.by_name[name]
        if not joint.lower - LIMIT_SLACK <= value <= joint.upper + LIMIT_SLACK:
            problem = f"puts {name} at {value:.4f}; the URDF allows {joint.lower:g} to {joint.upper:g}"
            raise document.error(("gripper", key), problem)


def _paced(document: Document, gripper: Gripper, tree: JointTree) -> Gripper:
    """The gripper no faster than the URDF's velocity limits allow its joints, and those that follow them."""
    openings = gripper.openings or (gripper.min_opening, gripper.open_opening)
    rates = np.abs([gripper.joints_per_opening(float(opening)) for opening in openings]).max(axis=0)
    speed = GRIPPER_SPEED
    for name, rate in zip(gripper.joint_names, rates.tolist(), strict=True):
        moved = {name: 1.0} | {follower: abs(factor) for follower, (factor, _) in tree.followers(name).items()}
        for joint, factor in moved.items():
            if factor > 0.0:
                speed = min(speed, tree.by_name[joint].velocity / (factor * rate))
    if speed <= 0.0:
        problem = "the URDF's velocity limits do not let them move; they have to be positive"
        raise document.error(("gripper", "joints"), problem)
    return gripper if speed == gripper.speed else replace(gripper, speed=speed)
