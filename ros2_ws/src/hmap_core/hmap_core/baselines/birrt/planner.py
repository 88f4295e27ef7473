"""Bi-RRT as a method: transits by OMPL's RRTConnect, transfers by two trees on the manifolds of contacts."""

from hmap_core.baselines import job
from hmap_core.baselines.birrt.realise import Realisation
from hmap_core.baselines.birrt.search import BidirectionalSearch
from hmap_core.baselines.birrt.shorten import shortened
from hmap_core.exceptions import MotionError
from hmap_core.planner.components import local_components
from hmap_core.planner.context import SearchContext
from hmap_core.planner.goals import unturned
from hmap_core.planner.interfaces import ProgressCallback
from hmap_core.planner.komo_segments import KomoSegmentPlanner
from hmap_core.planner.ompl_transit import OmplTransit
from hmap_core.planner.outcome import Solution
from hmap_core.planner.protocols import Cancel
from hmap_core.types import Goal, Plan, Scene, SceneState

DEFAULT_TIME_LIMIT = 180.0  # s, as in the paper
TRANSIT = "RRTConnect"


class BirrtPlanner:
    """Implements :class:`hmap_core.planner.protocols.ManipulationPlanner`.

    Kuffner and LaValle, RRT-Connect, ICRA 2000; contact modes as leaves of the configuration space as in Hauser and
    Ng-Thow-Hing, Randomized multi-modal motion planning, IJRR 2011.
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
        components = local_components(segments=KomoSegmentPlanner(OmplTransit(TRANSIT)))
        return job.solve(_solution, scene, state, seed, time_limit, progress, cancel, components)


def _solution(context: SearchContext, goal: Goal) -> Solution:
    """Grow the trees until a way between them can be carried out. Raises PlannerError."""
    goal = unturned(goal, context.start.poses[goal.object])
    search = BidirectionalSearch(context, goal)
    while True:
        way = search.next_way()
        realisation = Realisation(context, goal.object)
        for legs in (shortened(way, search.space, context.rng), way):
            try:
                return realisation.solution(legs)
            except MotionError as error:
                context.record.failed(error)
        search.reject(way, realisation.done)
