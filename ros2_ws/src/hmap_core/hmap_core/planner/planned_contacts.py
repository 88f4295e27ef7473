"""The contacts of a plan with what belongs to them, as a new plan in the middle of it takes them up again."""

from dataclasses import dataclass

import numpy as np

from hmap_core import transforms
from hmap_core.kinematics.arm import load_arm
from hmap_core.trajectory.samples import index_at
from hmap_core.types import ContactKind, ContactPoint, Plan, Segment, SegmentKind

STANDS = 0.005  # m; a hand that moves less after a contact does not leave it


@dataclass(frozen=True)
class PlannedContact:
    """A contact of the old plan with what belongs to it.

    Attributes:
        first, begin, end, last: samples at which the robot sets out, the contact is made, is left, the hand is back.
        segment: the contact's own.
    """

    first: int
    begin: int
    end: int
    last: int
    segment: Segment


def planned_contacts(plan: Plan, object: str) -> list[PlannedContact]:
    """The contacts on an object in their order, each with the transits before and after it."""
    time = plan.trajectory.time
    found, first = [], 0
    for k, segment in enumerate(plan.segments):
        if segment.kind is SegmentKind.TRANSIT:
            continue
        after = plan.segments[k + 1] if k + 1 < len(plan.segments) else segment
        leaves = after.kind is SegmentKind.TRANSIT and after.robot == segment.robot
        last = index_at(time, after.end if leaves else segment.end)
        if segment.object == object:
            ends = index_at(time, segment.start), index_at(time, segment.end)
            found.append(PlannedContact(first, *ends, last, segment))
        first = last
    return found


def contact_of(plan: Plan, kept: PlannedContact) -> ContactPoint:
    """The contact of a segment; its approach is opposite to how the hand leaves it, or the hand's z axis.

    Where on the surface it touches is not in a plan: point and normal are taken from the end effector.
    """
    T_obj_ee = kept.segment.T_obj_manipulator
    arm = load_arm(plan.scene.robots[kept.segment.robot].model)
    q = plan.trajectory.joints[kept.segment.robot]
    leaving = transforms.multiply(transforms.inverse(arm.end_effector(q[kept.end])), arm.end_effector(q[kept.last]))
    length = float(np.linalg.norm(leaving[:3]))
    approach = -leaving[:3] / length if length > STANDS else np.array([0.0, 0.0, 1.0])
    R = transforms.rotation_matrix(T_obj_ee)
    return ContactPoint(
        kind=ContactKind(kept.segment.kind.value),
        T_obj_ee=T_obj_ee,
        point=T_obj_ee[:3],
        normal=-R @ approach,
        opening=float(plan.trajectory.gripper[kept.segment.robot][kept.begin]),
        approach=approach,
        force=kept.segment.force or 0.0,
    )
