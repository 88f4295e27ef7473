"""Intermediate placements: the object is put somewhere, so that another contact can take over."""

from dataclasses import replace
from typing import TYPE_CHECKING

from hmap_core.exceptions import Code, PlannerError
from hmap_core.planner.attached_path import attached_paths
from hmap_core.planner.goals import goal_of_round, path_scene
from hmap_core.planner.manipulation_graph.graph import Edge, ManipulationGraph
from hmap_core.planner.manipulation_graph.grasp_sets import grasp_sets
from hmap_core.planner.manipulation_graph.placements import Placement, carried_between, intermediate_placements
from hmap_core.planner.obstacle_removal import RemovalError
from hmap_core.planner.obstruction import without
from hmap_core.planner.outcome import Failure, Outcome, Solution
from hmap_core.planner.solution_sequence import SolutionSequence, Subgoal
from hmap_core.planner.strategies.pick_and_place import PickAndPlace
from hmap_core.planner.strategies.remove_obstacles import clear_path
from hmap_core.planner.tasks import EndGrasp, PathTask
from hmap_core.planner.tools import with_tool_placed
from hmap_core.types import Goal

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

EDGES_PLANNED = 16  # in one round
# failed edges over which the object is pushed, each a search of its own, after which the graph is given up
SLIDES_FAILED, SLIDES_TO_GOAL_FAILED = 6, 3
# searches for contacts on the edges of one graph, after which it is given up; each takes 0.05 to 0.3 s if it fails
CONTACT_SEARCHES = 40
TRANSFERS_FAILED = (
    4  # edges over which the joints were searched without success, after which that is not tried any more
)
ROUNDS = 2  # of the outer loop in which a graph is searched
_REASONS = ("to an intermediate placement", "to its goal")


class ManipulationGraphStrategy:
    """A graph of placements, searched best first; its edges are planned by Algorithm 1."""

    name = "intermediate placements"

    def applies(self, task: PathTask) -> bool:
        """Whether the task is physical, about the task's own object, and several contacts may be used."""
        return task.subgoal.depth == 0 and task.number < ROUNDS and task.may_change_contacts

    def solve(self, search: "Search", task: PathTask) -> Outcome:
        """Plan edges on the cheapest way to the goal until it is reached, or no way is left."""
        context, record = search.context, search.context.record
        if self.name in search.given_up:
            return record.last_failure()
        graph, goal = self._graph(search, task)
        slides = {False: 0, True: 0}  # failed ones to other placements, and to the goal
        before, transfers = record.contact_searches, 0
        for _ in range(EDGES_PLANNED):
            context.time_left()
            ended = sum(slides.values()) >= SLIDES_FAILED or slides[True] >= SLIDES_TO_GOAL_FAILED
            ended |= record.contact_searches - before >= CONTACT_SEARCHES
            if ended:
                search.given_up.add(self.name)
            way = None if ended else graph.cheapest()
            if way is None:
                break
            a, b = way[0], way[1]
            edge = graph.edge(a, b)
            final = len(way) == 2
            own = goal if final else Goal(goal.object, graph.nodes[b].pose)
            subgoal = replace(task.subgoal, goal=own, depth=task.subgoal.depth + 1, reason=_REASONS[final])
            contact = "slide" if edge.sliding else "grasp"
            where = "its goal" if final else "({:.3f}, {:.3f}, {:.3f})".format(*graph.nodes[b].pose[:3])
            with record.tree.attempt(f"placement {a} to {b} at {where}: {contact}") as node:
                outcome = self._plan(search, subgoal, graph.reached[a], edge)
                if isinstance(outcome, Failure) and edge.hands and transfers < TRANSFERS_FAILED:
                    outcome = self._transferred(search, subgoal, graph.reached[a], edge, outcome)
                    transfers += isinstance(outcome, Failure)
                node.close(outcome)
            if isinstance(outcome, Failure):
                if isinstance(outcome.error, RemovalError):
                    record.failed(outcome.error)
                graph.failed(a, b)
                slides[final] += edge.sliding
            elif final:
                return outcome
            else:
                graph.solved(a, b, outcome.sequence)
        return record.last_failure()

    def _graph(self, search: "Search", task: PathTask) -> tuple[ManipulationGraph, Goal]:
        context, object = search.context, task.object
        context.report("waypoints", text=f"intermediate placements of '{object}'")
        state = with_tool_placed(task.sequence.state, task.sequence.tool_grasp)
        goal, rng = goal_of_round(context, task, state), context.child_rng()
        scene = path_scene(context.scene, task)
        bare = without(scene, scene.removable)
        start, end = Placement.at(state.poses[object]), Placement.at(goal.pose)
        placements = intermediate_placements(scene, state, object, goal.pose, rng)
        grasps = grasp_sets(bare, state, object, (start.pose, end.pose), rng)

        def carried(a: Placement, b: Placement) -> bool:
            return carried_between(bare, state, object, a, b)

        return ManipulationGraph(
            [start, end, *placements], grasps, task.sequence, rng, carried, context.time_left
        ), goal

    def _plan(self, search: "Search", subgoal: Subgoal, sequence: SolutionSequence, edge: Edge) -> Outcome:
        """Plan one edge: with a hand attached, or by one round of H-MaP's own loop, another one at each try."""
        context, hands = search.context, edge.hands
        if edge.sliding:
            return search.bring(subgoal, sequence, (edge.tries,))
        context.record.forget()
        state = with_tool_placed(sequence.state, sequence.tool_grasp)
        scene = replace(context.scene, motion="spatial")
        planner = context.components.object_path
        paths = attached_paths(planner, scene, state, subgoal.goal, hands, context.rng, context.time_left())
        for path in paths:
            context.record.counts["waypoint_plans"] += 1
            own = replace(subgoal, attached_path=path)
            cleared = clear_path(search, own, sequence, path.poses, path.blockers)
            if isinstance(cleared, Failure):
                continue
            outcome = search.follow(own, cleared.sequence, path.poses, cleared.known)
            if isinstance(outcome, Solution) or outcome.ends_round:
                return outcome
        return Failure.of(context.record.error or PlannerError("no path of the object and a hand", Code.NO_MOTION))

    @staticmethod
    def _transferred(
        search: "Search", subgoal: Subgoal, sequence: SolutionSequence, edge: Edge, failure: Failure
    ) -> Outcome:
        """The object as a part of the hand, for a grasp whose arm follows no path of the object; or the failure."""
        hands = [EndGrasp(robot, contact, subgoal.goal.pose) for robot, contact in edge.hands]
        task = PathTask(subgoal, sequence, 0, hands=hands)
        transfer = PickAndPlace()
        if failure.ends_round or not transfer.applies(task):
            return failure
        outcome = transfer.solve(search, task)
        return outcome if isinstance(outcome, Solution) else failure
