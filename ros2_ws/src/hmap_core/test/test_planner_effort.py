"""What a search without success costs: strategies that cannot help are given up."""

import numpy as np
import pytest
from simulation_fixtures import box, scene

from hmap_core.exceptions import Code
from hmap_core.planner import HmapPlanner, PlanningJob
from hmap_core.planner.manipulation_graph.graph import Edge
from hmap_core.planner.outcome import Failure
from hmap_core.planner.solution_sequence import SolutionSequence, Subgoal
from hmap_core.planner.strategies.manipulation_graph import (
    EDGES_PLANNED,
    SLIDES_FAILED,
    SLIDES_TO_GOAL_FAILED,
    ManipulationGraphStrategy,
)
from hmap_core.planner.tasks import PathTask
from hmap_core.transforms import pose
from hmap_core.types import Goal


class Graph:
    """A graph in which there is always another way, of one or two edges."""

    def __init__(self, sequence, sliding: bool, to_goal: bool):
        self.sliding, self.way = sliding, [0, 1] if to_goal else [0, 2, 1]
        self.reached = {0: sequence}
        self.nodes = [type("Node", (), {"pose": pose((0.5, 0.0, 0.02))})] * 3
        self.tried = 0

    def cheapest(self):
        return self.way

    def edge(self, a, b):
        return Edge(self.sliding)

    def failed(self, a, b):
        self.tried += 1


@pytest.mark.parametrize(
    "sliding, to_goal, tried",
    [(True, True, SLIDES_TO_GOAL_FAILED), (True, False, SLIDES_FAILED), (False, True, EDGES_PLANNED)],
)
def test_a_graph_whose_pushes_fail_is_given_up(monkeypatch, sliding, to_goal, tried):
    made = scene(box("brick", (0.04, 0.04, 0.04), (0.5, 0.0, 0.02)), goal=Goal("brick", pose((0.4, 0.3, 0.02))))
    job = PlanningJob(HmapPlanner(), made, seed=0)
    sequence, strategy = SolutionSequence(job.start), ManipulationGraphStrategy()
    graph = Graph(sequence, sliding, to_goal)
    monkeypatch.setattr(strategy, "_graph", lambda search, task: (graph, made.goal), raising=False)
    nothing = Failure("contacts", Code.NO_CONTACT, "none")
    monkeypatch.setattr(strategy, "_plan", lambda *args: nothing, raising=False)
    for number in range(2):
        strategy.solve(job.search, PathTask(Subgoal(made.goal), sequence, number))
    assert graph.tried == (tried if sliding else 2 * tried)
    assert np.array_equal([strategy.name in job.search.given_up], [sliding])
