"""The segment of H-MaP: its phases, how a hand comes to a contact and leaves it, and its skeletons.

A robot comes to a contact, moves the object with it, and leaves it; this is eq. (2) of the paper. The phases are those
of pick and place in manipulation planning: transit, approach, transfer (here called hold, as the contact may be a
push), retreat. The planner and the benchmark build their skeletons of these functions.
"""

from collections.abc import Sequence
from enum import IntEnum

import numpy as np

from hmap_core.komo.skeleton import Skeleton, SkeletonEntry, Symbol
from hmap_core.transforms import multiply, pose, rotation_matrix
from hmap_core.types import ContactKind, ContactPoint, Robot

# how far the hand draws back from a contact, m
GRASP_RETREAT = 0.10
TOUCH_RETREAT = 0.05
# how much wider than the object each side of the gripper opens, m
OPENING_CLEARANCE = 0.008
APPROACH_STEPS = 4  # poses between the contact and the pre-contact pose

Contact = ContactPoint | np.ndarray  # or T_obj_ee (7,), where no more is known


class Phase(IntEnum):
    """Phases of a segment, in their order."""

    TRANSIT = 0  # to the pre-contact pose, touching nothing
    APPROACH = 1  # straight to the contact
    HOLD = 2  # in contact, the object moves along
    RETREAT = 3  # straight back from the contact

    @property
    def end(self) -> int:
        """The phase's end as a time of a skeleton."""
        return self + 1


def bit(*phases: Phase) -> int:
    """Bit mask of phases."""
    return sum(1 << int(p) for p in phases)


def retreat_distance(contact: ContactPoint) -> float:
    """How far from the contact the approach begins and the retreat ends, m."""
    return GRASP_RETREAT if contact.kind == ContactKind.GRASP else TOUCH_RETREAT


def free_opening(robot: Robot, contact: ContactPoint) -> float:
    """Gripper opening in transit, approach and retreat, m."""
    gripper = robot.model.gripper
    if robot.model.attached is not None:
        return robot.model.attached.opening
    if gripper is None or contact.kind != ContactKind.GRASP:
        return contact.opening
    return min(gripper.open_opening, contact.opening + 2 * OPENING_CLEARANCE)


def retreated(contact: ContactPoint, fraction: float = 1.0) -> np.ndarray:
    """T_obj_ee (7,) with the hand drawn back along its approach by a fraction of the retreat distance."""
    return multiply(contact.T_obj_ee, pose(-fraction * retreat_distance(contact) * contact.approach))


# --- entries


def contact_entries(
    robot: str, object: str, contact: Contact, first: int, last: float, poses: np.ndarray | None = None
) -> list[SkeletonEntry]:
    """A robot meets an object at the end of phase ``first`` and moves it until ``last``.

    Args:
        poses: (S, 7) of the object in the world at every step of these phases; None: they are left open.
    """
    hand = robot, object
    entries = [
        SkeletonEntry(first, first, Symbol.TOUCH, hand, contact),
        SkeletonEntry(first, last, Symbol.STABLE, hand),
    ]
    if poses is not None:
        entries.append(SkeletonEntry(first, last, Symbol.POSE_EQ, (object,), poses))
    return entries


def approach_entry(robot: str, contact: ContactPoint, T_world_obj: np.ndarray) -> SkeletonEntry:
    """The hand comes straight from the pre-contact pose to the object at T_world_obj (7,), the contact left out."""
    shares = np.arange(APPROACH_STEPS, 0, -1) / APPROACH_STEPS
    end = Phase.APPROACH.end - 1.0 / APPROACH_STEPS
    return SkeletonEntry(Phase.TRANSIT.end, end, Symbol.POSE_EQ, (robot,), _drawn_back(contact, T_world_obj, shares))


def retreat_entry(robot: str, contact: ContactPoint, T_world_obj: np.ndarray) -> SkeletonEntry:
    """The hand draws straight back from the object at T_world_obj (7,)."""
    shares = np.arange(1, APPROACH_STEPS + 1) / APPROACH_STEPS
    begin = Phase.HOLD.end + 1.0 / APPROACH_STEPS
    return SkeletonEntry(begin, Phase.RETREAT.end, Symbol.POSE_EQ, (robot,), _drawn_back(contact, T_world_obj, shares))


def _drawn_back(contact: ContactPoint, T_world_obj: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """World poses (S, 7) of the hand, drawn back by shares (S,) of the retreat distance."""
    touching = multiply(T_world_obj, contact.T_obj_ee)
    poses = np.tile(touching, (len(shares), 1))
    poses[:, :3] -= shares[:, None] * retreat_distance(contact) * (rotation_matrix(touching) @ contact.approach)
    return poses


# --- skeletons


def mode_skeleton(robot: str, object: str, contact: Contact, object_poses: np.ndarray) -> Skeleton:
    """The modes of a segment alone, from which it follows who keeps which distance from whom.

    Args:
        object_poses: (K, 7) of the object, the first and the last among them.
    """
    modes = contact_entries(robot, object, contact, Phase.APPROACH.end, Phase.HOLD.end, object_poses[1:])
    return Skeleton(modes, Phase.RETREAT.end)


def segment_skeleton(
    robot: str, object: str, contact: ContactPoint, object_poses: np.ndarray, leaves: bool = True
) -> Skeleton:
    """A whole segment.

    Args:
        object_poses: (K, 7) of the object, at the start and at every step of the hold.
        leaves: whether it ends with the retreat.
    """
    entries = [
        approach_entry(robot, contact, object_poses[0]),
        *contact_entries(robot, object, contact, Phase.APPROACH.end, Phase.HOLD.end, object_poses[1:]),
    ]
    return Skeleton([*entries, retreat_entry(robot, contact, object_poses[-1])] if leaves else entries)


def shared_skeleton(
    robots: Sequence[str], object: str, contacts: Sequence[ContactPoint], object_poses: np.ndarray
) -> Skeleton:
    """One phase in which several hands carry an object: a closed chain.

    The object hangs on the first hand; the others stay at their contacts with it.

    Args:
        robots: names, each with its contact.
        object_poses: (K, 7) of the object at every step.
    """
    (first, *others), (contact, *theirs) = robots, contacts
    entries = [
        SkeletonEntry(0, 1, Symbol.STABLE, (first, object), contact),
        SkeletonEntry(0, 1, Symbol.POSE_EQ, (object,), object_poses),
        *(SkeletonEntry(0, 1, Symbol.TOUCH, (name, object), own) for name, own in zip(others, theirs, strict=True)),
    ]
    return Skeleton(entries)


def approach_skeleton(robot: str, object: str, contact: ContactPoint, T_world_obj: np.ndarray) -> Skeleton:
    """A segment up to the contact with the object at T_world_obj (7,)."""
    touch = SkeletonEntry(Phase.APPROACH.end, Phase.APPROACH.end, Symbol.TOUCH, (robot, object), contact)
    return Skeleton([approach_entry(robot, contact, T_world_obj), touch])


def approach_through(robot: str, configurations: np.ndarray) -> Skeleton:
    """A segment up to the contact through configurations (APPROACH_STEPS + 1, n), that of the contact the last."""
    return Skeleton([SkeletonEntry(Phase.TRANSIT.end, Phase.APPROACH.end, Symbol.HOME, (robot,), configurations)])


def transit_skeleton(robot: str, q: np.ndarray) -> Skeleton:
    """A transit alone, to the configuration q (n,)."""
    return Skeleton([SkeletonEntry(Phase.TRANSIT.end, Phase.TRANSIT.end, Symbol.HOME, (robot,), q)])


def hand_skeleton(robot: str, T_world_ee: np.ndarray, phase: Phase = Phase.TRANSIT) -> Skeleton:
    """The end-effector at T_world_ee (7,) at the end of a phase."""
    return Skeleton([SkeletonEntry(phase.end, phase.end, Symbol.POSE_EQ, (robot,), T_world_ee)])
