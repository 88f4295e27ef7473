"""Motions one after the other, each planned from the state after those before it."""

from dataclasses import replace

from hmap_core.planner.assembly import joined, state_after
from hmap_core.planner.interfaces import RobotContact, SubTrajectory
from hmap_core.types import Scene, SceneState, Segment, SegmentKind


class MotionSequence:
    """Motions from a state on.

    Args:
        state: where everything is before them.

    Attributes:
        state: where everything is after them.
    """

    def __init__(self, state: SceneState):
        self._start = self.state = state
        self._motions: list[SubTrajectory] = []

    def add(self, motion: SubTrajectory) -> None:
        """Append a motion that begins in the present state."""
        self._motions.append(motion)
        self.state = state_after(self.state, motion)

    def joined(self) -> SubTrajectory:
        """All motions as one."""
        robots = dict.fromkeys(name for own in self._motions for name in own.trajectory.joints)
        bodies = dict.fromkeys(name for own in self._motions for name in own.trajectory.objects)
        return joined(self._start, self._motions, robots, bodies)


def held_still(scene: Scene, motion: SubTrajectory, object: str, holder: RobotContact) -> SubTrajectory:
    """A motion during which another robot holds an object still by a grasp."""
    link, end = scene.robots[holder.robot].model.end_effector_link, float(motion.trajectory.time[-1])
    hold = Segment(0.0, end, holder.robot, link, object, SegmentKind.GRASP, holder.contact.T_obj_ee)
    return replace(motion, segments=(*motion.segments, hold))
