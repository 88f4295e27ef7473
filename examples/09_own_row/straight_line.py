"""A method of one's own as a row of `hmap bench table`: the object goes straight to its goal, contact by contact."""

import numpy as np

from hmap_core.planner import ContactSearchQuery, SegmentQuery, local_components
from hmap_core.planner.assembly import assemble, state_after
from hmap_core.transforms import interpolate


class StraightLine:
    """Implements :class:`hmap_core.planner.ManipulationPlanner`."""

    def plan(self, scene, state=None, seed=0, time_limit=60.0, progress=None, cancel=None):
        """Carry the object along a straight line; a body in the way is an error of the parts."""
        parts, start = local_components(), state or scene.start_state()
        object, goal, robots = scene.goal.object, scene.goal.pose, tuple(scene.robots)
        state, motions = start, []
        while not np.allclose(state.poses[object][:3], goal[:3], atol=1e-3):
            poses = interpolate(state.poses[object], goal, np.linspace(0.0, 1.0, 30))
            query = ContactSearchQuery(scene, state, object, poses, robots, seed=seed, time_limit=time_limit)
            contact = parts.contacts.find_contacts(query)[0]
            query = SegmentQuery(scene, state, object, contact, poses[: contact.reach + 1], seed, time_limit)
            motions.append(parts.segments.plan_segment(query))
            state = state_after(state, motions[-1])
        return assemble(scene, start, motions, goal[None], {})
