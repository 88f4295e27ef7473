"""Plan the path of the object yourself: up, across and down. OMPL's planners are chosen alike (``ompl:RRTConnect``)."""

import numpy as np

from hmap_core import planner
from hmap_core.planner import ObjectPathQuery, plugins
from hmap_core.scenes import SceneBuilder
from hmap_core.transforms import interpolate
from hmap_core.waypoints import NoObjectPath, ObjectPath

STEPS = 15  # poses of each of the three parts


class UpAcrossDown:
    """Implements :class:`hmap_core.planner.ObjectPathPlanner`, at a height that its name may give: ``over:0.3``."""

    def __init__(self, height: str = "0.2"):
        self._height = float(height)  # m

    def plan_path(self, query: ObjectPathQuery) -> ObjectPath:
        """Three straight parts, whatever stands around: robots and the judge have the last word."""
        start, goal = query.state.poses[query.goal.object], query.goal.pose
        if self._height <= 0.0:
            raise NoObjectPath("the height must be above 0", blockers=(), free_without=None)
        above_start, above_goal = start.copy(), goal.copy()
        above_start[2] = above_goal[2] = max(start[2], goal[2]) + self._height
        corners = [start, above_start, above_goal, goal]
        shares = np.arange(1, STEPS + 1) / STEPS
        poses = [start, *(interpolate(a, b, s) for a, b in zip(corners[:-1], corners[1:], strict=True) for s in shares)]
        return ObjectPath(
            poses=np.array(poses),
            cuts=STEPS * np.array([1, 2, 3]),  # waypoints: where it turns, and the goal
            clearance=np.zeros(len(poses)),  # not measured
            motion="spatial",
        )


# In a package: [project.entry-points."hmap.object_path_planners"]  over = "my_package:UpAcrossDown"
plugins.register(plugins.OBJECT_PATH_PLANNERS, "over", UpAcrossDown)

scene = SceneBuilder("brick").add_robot("arm", "panda").add_box("table", [2, 2, 0.1], [0, 0, -0.05])
scene.add_box("brick", [0.08, 0.05, 0.06], [0.5, -0.2, 0.03], movable=True, mass=0.3)
scene.add_box("wall", [0.3, 0.02, 0.12], [0.5, 0.0, 0.06]).set_goal("brick", [0.5, 0.2, 0.03])

plan = planner.plan(scene.build(), object_path="over:0.2", time_limit=120.0)
print(f"the brick rises to {plan.trajectory.objects['brick'][:, 2].max():.2f} m")
