"""Guess of everything in a robot file that a URDF does not say."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hmap_core.exceptions import Code, InputError
from hmap_core.kinematics.urdf import Urdf, load_urdf
from hmap_core.robot_description import Joint
from hmap_core.robot_setup.gripper import DIGITS, GripperGuess, NoGripper, guess_gripper
from hmap_core.robot_setup.points import LinkPoints
from hmap_core.robot_setup.structure import Structure, find_structure
from hmap_core.scenes.robot_rules import MOST_JOINTS
from hmap_core.transforms import IDENTITY, pose

TURN = 3.141593  # rad, limit of a joint without limits
SLIDE = 1.0  # m, the same for a joint that slides
SPEED = 1.0  # rad/s or m/s, of a joint whose URDF has no speed
ROUNDING = 1e-3  # of the last decimal, that is none
ACCELERATION = 5.0  # rad/s^2 or m/s^2; a URDF has none


@dataclass(frozen=True)
class RobotGuess:
    """What a first robot file says.

    Attributes:
        file: the URDF.
        urdf: its content.
        structure: arm, palm and fingers.
        link: that carries the end-effector frame.
        T_link_ee: (7,) that frame.
        limits: (2, n) position limits, rad or m.
        velocities, accelerations: (n,) limits, per s and per s^2.
        gripper: the gripper; None without one.
        notes: key of the robot file -> what was guessed there, for people.
    """

    file: Path
    urdf: Urdf
    structure: Structure
    link: str
    T_link_ee: np.ndarray
    limits: np.ndarray
    velocities: np.ndarray
    accelerations: np.ndarray
    gripper: GripperGuess | None
    notes: dict[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def joint_names(self) -> list[str]:
        """The arm's joints, base to tip."""
        return [joint.name for joint in self.structure.arm]


def guess_robot(file: Path, tip: str | None = None) -> RobotGuess:
    """Guesses the content of a robot file.

    Args:
        file: the URDF.
        tip: the link that carries the fingers or a tool; None: it is searched.

    Returns:
        The guess.

    Raises:
        InputError: the URDF cannot be used, has no joint that moves, or has no such link.
    """
    urdf = load_urdf(file)
    structure = find_structure(urdf, file, tip)
    if len(structure.arm) > MOST_JOINTS:
        text = f"{file}: the chain to '{structure.palm}' has {len(structure.arm)} joints that move"
        raise InputError(f"{text}; an arm may have {MOST_JOINTS}: choose its last link by --tip", Code.INVALID_SCENE)
    notes = {"joints": _joint_notes(structure)}
    gripper = None
    if structure.fingers:
        try:
            gripper = guess_gripper(urdf, structure)
        except NoGripper as reason:
            notes["gripper"] = (f"left out: {reason}",)
    if gripper is not None:
        link, T = gripper.link, gripper.T_link_ee
        notes["end_effector"] = (
            "guess: between the pads where they meet, from the innermost faces of the fingers; z is the approach "
            "direction, y the closing direction",
        )
        notes["gripper"] = _gripper_notes(gripper)
    else:
        link = structure.palm
        T, note = _tip(urdf, structure)
        notes["end_effector"] = (note,)
    limits, notes["position_limits"] = _limits(structure.arm)
    velocities, notes["velocity_limits"] = _velocities(structure.arm)
    notes["acceleration_limits"] = (f"guess: {ACCELERATION:g} for every joint; a URDF has none",)
    accelerations = np.full(len(structure.arm), ACCELERATION)
    return RobotGuess(file, urdf, structure, link, T, limits, velocities, accelerations, gripper, notes)


def _joint_notes(structure: Structure) -> tuple[str, ...]:
    what = "that ends at the link with the fingers" if structure.fingers else "of joints"
    notes = [f"guess: the longest chain {what}, '{structure.palm}'", *structure.notes]
    if structure.others:
        notes.append(f"not used, at 0: {', '.join(joint.name for joint in structure.others)}")
    return tuple(notes)


def _gripper_notes(gripper: GripperGuess) -> tuple[str, ...]:
    closed, opened = (round(1e3 * gap, 1) + 0.0 for gap in gripper.gaps)
    notes = [
        f"guess: the fingers touch with {' and '.join(gripper.finger_links)}; between them are {closed:.1f} mm "
        f"at one end of the joints' limits and {opened:.1f} mm at the other",
        "guess: force, in N; see the data sheet of the gripper",
    ]
    if gripper.pad_is_edge:
        notes.append("guess: pad_half_width; the fingers have no flat inner face")
    return tuple(notes)


def _tip(urdf: Urdf, structure: Structure) -> tuple[np.ndarray, str]:
    """The end-effector frame (7,) of an arm without gripper, in its last link, and how it was guessed."""
    points = LinkPoints(urdf, structure.palm)
    if not points.has_shape(structure.palm):
        return (
            IDENTITY,
            f"guess: the frame of the link '{structure.palm}', whose z axis has to be the approach direction",
        )
    end = -points.lowest(structure.palm, {}, np.array([0.0, 0.0, -1.0]))
    return pose([0.0, 0.0, max(round(end, 6), 0.0)]), "guess: where the last link's shapes end along its z axis"


def _limits(arm: tuple[Joint, ...]) -> tuple[np.ndarray, tuple[str, ...]]:
    limits, endless = [], []
    for joint in arm:
        if np.isfinite([joint.lower, joint.upper]).all():
            limits.append((joint.lower, joint.upper))
        else:
            bound = SLIDE if joint.kind == "prismatic" else TURN
            limits.append((max(joint.lower, -bound), min(joint.upper, bound)))
            endless.append(joint.name)
    note = "of the URDF"
    if endless:
        note += f"; guess: half a turn to either side for {', '.join(endless)}, which have no limits"
    lower, upper = np.array(limits).T
    return np.array([_rounded_up(lower), -_rounded_up(-upper)]), (note,)


def _rounded_up(values: np.ndarray) -> np.ndarray:
    """Values with the decimals of a robot file, none of them smaller but by rounding."""
    scale = 10.0**DIGITS
    return np.ceil(values * scale - ROUNDING) / scale + 0.0


def _velocities(arm: tuple[Joint, ...]) -> tuple[np.ndarray, tuple[str, ...]]:
    speeds = np.array([joint.velocity for joint in arm])
    missing = ~(np.isfinite(speeds) & (speeds > 0.0))
    note = "of the URDF"
    if missing.any():
        names = ", ".join(joint.name for joint, none in zip(arm, missing, strict=True) if none)
        note += f"; guess: {SPEED:g} for {names}, which have none"
    return np.where(missing, SPEED, speeds), (note,)
