"""The motions of robots for given contacts, by KOMO in this process."""

import numpy as np

from hmap_core.planner import segments
from hmap_core.planner.interfaces import SubTrajectory
from hmap_core.planner.lifting import lifted
from hmap_core.planner.protocols import SegmentQuery, SharedQuery, ToolQuery, TransitPlanner
from hmap_core.planner.sampled_contacts import TURNING_SHARE
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.planner.transit import TreeTransit
from hmap_core.types import TaskMode


class KomoSegmentPlanner:
    """Implements :class:`hmap_core.planner.protocols.SegmentPlanner`.

    Args:
        transit: searches a transit where the optimiser finds none.
    """

    def __init__(self, transit: TransitPlanner | None = None):
        self._find = (transit or TreeTransit()).find_transit

    def plan_segment(self, query: SegmentQuery) -> SubTrajectory:
        """Plan one segment; an object that would tip when it is dragged is lifted.

        Raises:
            MotionError: NO_MOTION, with the constraint that stays violated.
        """
        scene, contact, poses = query.scene, query.contact, query.object_poses
        if scene.mode == TaskMode.PHYSICAL and not (scene.motion == "planar" and query.object == scene.goal.object):
            around = placed_bodies(scene, query.state, query.object)
            contact, poses = lifted(scene, query.state, query.object, contact, poses, around, TURNING_SHARE)
        rng = np.random.default_rng(query.seed)
        return segments.solve_segment(
            scene, query.state, query.object, contact, poses, rng, query.time_limit, self._find
        )

    def plan_pick(self, query: ToolQuery) -> SubTrajectory:
        """Plan how a robot picks a tool.

        Raises:
            MotionError: NO_MOTION.
        """
        grasp, rng = query.tool_grasp, np.random.default_rng(query.seed)
        return segments.pick(query.scene, query.state, grasp.contact, grasp.tool, rng, query.time_limit, self._find)

    def plan_place(self, query: ToolQuery) -> SubTrajectory:
        """Plan how a robot places its tool where it picked it.

        Raises:
            MotionError: NO_MOTION.
        """
        grasp, rng = query.tool_grasp, np.random.default_rng(query.seed)
        contact, T = grasp.contact, grasp.T_place
        return segments.place(query.scene, query.state, contact, grasp.tool, T, rng, query.time_limit, self._find)

    def plan_shared(self, query: SharedQuery) -> SubTrajectory:
        """Plan how two robots carry an object together, or pass it on.

        Raises:
            MotionError: NO_MOTION.
        """
        rng = np.random.default_rng(query.seed)
        plan = segments.pass_on if query.hand_over else segments.carry_together
        contacts, poses, limit = query.contacts, query.object_poses, query.time_limit
        return plan(query.scene, query.state, query.object, contacts, poses, rng, limit, self._find)
