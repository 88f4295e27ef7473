"""A part of a segment: a sub-trajectory of one robot in one mode; and parts joined to one sub-trajectory."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from hmap_core.planner.assembly import joined
from hmap_core.planner.interfaces import SubTrajectory
from hmap_core.planner.segments.attached import attached_at_rest
from hmap_core.planner.segments.timing import SAMPLE_PERIOD
from hmap_core.types import Scene, SceneState, Segment, SegmentKind, Trajectory


def part(
    scene: Scene,
    robot: str,
    q: np.ndarray,
    opening: np.ndarray,
    kind: SegmentKind = SegmentKind.TRANSIT,
    object: str | None = None,
    contact_pose: np.ndarray | None = None,
    moved: Mapping[str, np.ndarray] = MappingProxyType({}),
    force: float | None = None,
) -> SubTrajectory:
    """A sub-trajectory of one robot in one mode, sampled every SAMPLE_PERIOD.

    Args:
        q: (N, n) its configurations; opening: (N,) of its gripper, m.
        kind, object, contact_pose: the contact; the pose (7,) is that of the end-effector in the object's frame.
        moved: poses (N, 7) of the bodies that move along.
        force: N with which a press presses.
    """
    time = np.arange(len(q)) * SAMPLE_PERIOD
    link = scene.robots[robot].model.end_effector_link
    segment = Segment(0.0, float(time[-1]), robot, link, object, kind, contact_pose, force)
    return SubTrajectory(Trajectory(time, {robot: q}, {robot: opening}, dict(moved)), (segment,))


def at_rest(scene: Scene, robot: str, q: np.ndarray, opening: float) -> SubTrajectory:
    """A transit along configurations (N, n) with the gripper as it is, m."""
    return part(scene, robot, q, np.full(len(q), opening))


def last_configuration(parts: Sequence[SubTrajectory], robot: str) -> np.ndarray:
    """Where (n,) a robot is at the end of the last part."""
    return parts[-1].trajectory.joints[robot][-1]


def joined_parts(scene: Scene, state: SceneState, parts: Sequence[SubTrajectory]) -> SubTrajectory:
    """One sub-trajectory of the robots and bodies that move in the parts; a part of one sample is left out.

    What is attached to robots that stand still in a part stays attached to them.
    """
    robots = dict.fromkeys(name for own in parts for name in own.trajectory.joints)
    bodies = dict.fromkeys(name for own in parts for name in own.trajectory.objects)
    whole = [
        SubTrajectory(own.trajectory, (*own.segments, *attached_at_rest(scene, own)))
        for own in parts
        if len(own.trajectory.time) > 1
    ]
    return joined(state, whole, robots, bodies)
