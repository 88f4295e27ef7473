"""Grippers of robot files: what they leave to be computed from the URDF, and what does not fit to it."""

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
    _check_limits(document, own, gripper, geometry.tree)
    return gripper if own.speed is not None else _paced(document, gripper, joint_tree(root))


def _frozen(value: float | list[float]) -> float | tuple[float, ...]:
    return tuple(value) if isinstance(value, list) else value


def _sliding(document: Document, own: GripperEntry, geometry: GripperGeometry, given: dict) -> Gripper:
    """A gripper whose joints move in proportion to the opening."""
    gripper = Gripper(**{"tip_offset": 0.0} | given, per_joint=_frozen(own.per_joint))
    if own.tip_offset is not None:
        return gripper
    values = dict(zip(own.joints, gripper.joints(gripper.min_opening), strict=True))
    tip = _places(document, geometry, values).tip
    return Gripper(**given, per_joint=gripper.per_joint, tip_offset=_ahead(document, tip))


def _turning(document: Document, own: GripperEntry, geometry: GripperGeometry, given: dict) -> Gripper:
    """A gripper whose openings between closed and open are as the URDF's shapes say."""
    n = len(own.joints)
    closed, opened = (np.broadcast_to(np.array(value, float), n) for value in (own.closed, own.open))

    def places(travel: float) -> FingerPlaces:
        values = closed + travel * (opened - closed)
        return _places(document, geometry, dict(zip(own.joints, values, strict=True)))

    ends = places(0.0).gap, places(1.0).gap
    if not ends[1] > max(ends[0], 0.0):
        problem = f"finger_links are {ends[1]:.4f} m apart here and {ends[0]:.4f} m at closed; they have to be farther"
        raise document.error(("gripper", "open"), problem)
    first = brentq(lambda travel: places(travel).gap, 0.0, 1.0) if ends[0] < 0.0 else 0.0
    found = [places(travel) for travel in np.linspace(first, 1.0, TRAVELS)]
    openings = np.array([place.gap for place in found])
    openings[0] = max(openings[0], 0.0)
    if np.any(np.diff(openings) <= 0.0):
        at = closed + np.linspace(first, 1.0, TRAVELS)[int(np.diff(openings).argmin()) + 1] * (opened - closed)
        raise document.error(("gripper", "open"), f"the gap has to grow all the way from closed; near {at} it does not")
    off = max((place.middle for place in found), key=abs)
    if abs(off) > MIDDLE_OFF:
        problem = f"the middle between finger_links is at y = {off:.4f} m in it; at most {MIDDLE_OFF} m are allowed"
        raise document.error(("end_effector", "pose"), problem)
    start = closed + first * (opened - closed)
    defaults = {
        "min_opening": openings[0],
        "max_opening": given.get("open_opening", openings[-1]) - JAW_CLEARANCE,
        "open_opening": openings[-1],
        "tip_offset": _ahead(document, found[0].tip) if own.tip_offset is None else own.tip_offset,
    }
    values = {key: float(value) for key, value in defaults.items()} | given
    for key in ("min_opening", "open_opening"):
        if not openings[0] - LIMIT_SLACK <= values[key] <= openings[-1] + LIMIT_SLACK:
            problem = f"must be between {openings[0]:.4f} and {openings[-1]:.4f}, as finger_links have it"
            raise document.error(("gripper", key), problem)
    return Gripper(
        per_joint=tuple((opened - start).tolist()),
        at_zero=tuple(start.tolist()),
        openings=tuple(openings.tolist()),
        tips=tuple(place.tip - found[0].tip for place in found),
        **values,
    )


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


def _check_limits(document: Document, own: GripperEntry, gripper: Gripper, tree: JointTree) -> None:
    """Joints are within the URDF's limits at all openings."""
    key = "per_joint" if own.per_joint is not None else "closed"
    for opening, where in ((gripper.min_opening, key), (gripper.open_opening, key.replace("closed", "open"))):
        for name, value in zip(gripper.joint_names, gripper.joints(opening).tolist(), strict=True):
            joint = tree.by_name[name]
            if not joint.lower - LIMIT_SLACK <= value <= joint.upper + LIMIT_SLACK:
                problem = f"puts {name} at {value:.4f} with the gripper open by {opening:.4f} m; "
                problem += f"the URDF allows {joint.lower:g} to {joint.upper:g}"
                raise document.error(("gripper", where), problem)


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
