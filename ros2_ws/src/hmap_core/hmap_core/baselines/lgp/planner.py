"""LGP as a method: the skeleton is searched, its paths are those of KOMO."""

from hmap_core.baselines import job
from hmap_core.baselines.lgp.search import SkeletonSearch
from hmap_core.planner.context import SearchContext
from hmap_core.planner.goals import unturned
from hmap_core.planner.interfaces import ProgressCallback
from hmap_core.planner.outcome import Solution
from hmap_core.planner.protocols import Cancel
from hmap_core.types import Goal, Plan, Scene, SceneState

DEFAULT_TIME_LIMIT = 180.0  # s, as in the paper


class LgpPlanner:
    """Implements :class:`hmap_core.planner.protocols.ManipulationPlanner`.

    Toussaint, Logic-geometric programming, IJCAI 2015; Toussaint and Lopes, Multi-bound tree search, ICRA 2017.
    """

    def plan(
        self,
        scene: Scene,
        state: SceneState | None = None,
        seed: int = 0,
        time_limit: float = DEFAULT_TIME_LIMIT,
        progress: ProgressCallback | None = None,
        cancel: Cancel | None = None,
    ) -> Plan:
        """Plan a task; the arguments are those of the protocol. Raises HmapError."""
        return job.solve(_solution, scene, state, seed, time_limit, progress, cancel, removals_first=False)


def _solution(context: SearchContext, goal: Goal) -> Solution:
    """Search skeletons until one has a path. Raises PlannerError."""
    return SkeletonSearch(context, unturned(goal, context.start.poses[goal.object])).solve()
