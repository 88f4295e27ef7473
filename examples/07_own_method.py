"""Write a whole method beside H-MaP: here, the shortest of several plans. Anything that returns a ``Plan`` will do."""

from dataclasses import dataclass

from hmap_core import planner
from hmap_core.exceptions import Code, HmapError, PlannerError
from hmap_core.planner import HmapPlanner, plugins
from hmap_core.planner.interfaces import ProgressCallback
from hmap_core.planner.protocols import Cancel
from hmap_core.scenes import load_scene
from hmap_core.types import Plan, Scene, SceneState


@dataclass
class BestOf:
    """Implements :class:`hmap_core.planner.ManipulationPlanner`; ``best_of:3`` plans three times."""

    tries: str = "2"

    def plan(
        self,
        scene: Scene,
        state: SceneState | None = None,
        seed: int = 0,
        time_limit: float = 60.0,
        progress: ProgressCallback | None = None,
        cancel: Cancel | None = None,
    ) -> Plan:
        """Plan with several seeds; the plan that takes the robots the least time."""
        plans, tries = [], int(self.tries)
        for k in range(tries):
            try:
                plans.append(HmapPlanner().plan(scene, state, seed + k, time_limit / tries, progress, cancel))
            except HmapError as error:
                if error.code is Code.CANCELED:
                    raise
                last = error
        if not plans:
            raise PlannerError(f"none of {tries} tries found a plan; the last: {last.reason}", last.code)
        return min(plans, key=lambda plan: plan.trajectory.time[-1])


# In a package: [project.entry-points."hmap.planners"]  best_of = "my_package:BestOf"
# Then `hmap plan bolt --planner best_of:3`, and the parameter `planner` of the supervisor, use it.
plugins.register(plugins.PLANNERS, "best_of", BestOf)

plan = planner.plan(load_scene("bolt", seed=0), planner="best_of:2", time_limit=240.0)
print(f"the best plan takes {plan.trajectory.time[-1]:.1f} s")
