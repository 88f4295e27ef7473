"""Algorithm 1 of the paper: three nested loops over object paths, waypoints and contacts.

What is tried in each loop, and in which order, is data (:mod:`hmap_core.planner.strategies`). Different from the paper,
waypoints are not fixed in advance: a contact serves as far along the object's path as robot and hand can follow, and
the next waypoint is where it ends.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from hmap_core.exceptions import PlannerError
from hmap_core.planner import reachability, steps
from hmap_core.planner.context import SearchContext
from hmap_core.planner.interfaces import RobotContact, ToolGrasp
from hmap_core.planner.loads import needs_two_robots
from hmap_core.planner.manipulator_order import contact_strategies
from hmap_core.planner.obstacle_removal import ObstacleRemoval, RemovalError, StuckError
from hmap_core.planner.outcome import Failure, Outcome, Solution
from hmap_core.planner.relaxed import RelaxedSolution
from hmap_core.planner.solution_sequence import SolutionSequence, Subgoal
from hmap_core.planner.steps import TRIES_WITH_TOOL
from hmap_core.planner.strategies import LAST_STRATEGIES, PATH_STRATEGIES
from hmap_core.planner.strategies.base import Strategy
from hmap_core.planner.tasks import PathTask, WaypointTask
from hmap_core.types import Goal, Plan, TaskMode
from hmap_core.waypoints import NoObjectPath

J_MAX = 40  # contacts tried at one waypoint before new waypoints are planned (the paper's j_max)
ROUNDS = 6  # object paths tried for the task
BLOCKED_ROUNDS = 2  # of these, in which an obstacle could not be removed
REMOVAL_ROUNDS = 2  # object paths tried for an obstacle: one that slides where it can, one that lifts


class Search:
    """Algorithm 1 for one job; a removed obstacle is an instance of it, too.

    Args:
        context: the job.

    Attributes:
        removal: removes obstacles.
        given_up: names of strategies that are not tried in further rounds.
    """

    def __init__(self, context: SearchContext):
        self.context = context
        self.removal = ObstacleRemoval(self)
        self.given_up: set[str] = set()

    def plan(self, goal: Goal, sequence: SolutionSequence, accept: Callable[[Solution], Plan | None]) -> Plan:
        """The outer loop: object paths until one is solved and its plan is accepted.

        Args:
            goal: of the task.
            sequence: what has been done already.
            accept: makes a plan of a solution, or rejects it.

        Raises:
            PlannerError: no plan after ROUNDS paths, an obstacle that cannot be removed, time limit, cancel.
            HmapError: another error that ends the job, such as an object without a path, or one that no robot can tilt.
        """
        reachability.check_tilt(self.context, goal)
        blocked = 0
        for number in range(ROUNDS):
            outcome = self.round(Subgoal(goal), sequence, number)
            if isinstance(outcome, Solution):
                if (plan := accept(outcome)) is not None:
                    return plan
                continue
            if not outcome.ends_round:
                continue
            blocked += isinstance(outcome.error, RemovalError)
            stuck = isinstance(outcome.error, StuckError)
            if stuck or blocked == BLOCKED_ROUNDS or (number == 0 and isinstance(outcome.error, NoObjectPath)):
                raise outcome.error or PlannerError(outcome.reason, outcome.code)
        record = self.context.record
        raise PlannerError(
            f"no plan after {ROUNDS} object paths of '{goal.object}'; last: {record.reason}", record.code
        )

    def bring(
        self, subgoal: Subgoal, sequence: SolutionSequence, rounds: Iterable[int] = range(REMOVAL_ROUNDS)
    ) -> Outcome:
        """The outer loop for an obstacle, or for a part of a plan: object paths until one is solved."""
        self.context.record.forget()
        for number in rounds:
            outcome = self.round(subgoal, sequence, number)
            if isinstance(outcome, Solution) or outcome.ends_round:
                return outcome
        last = PlannerError(self.context.record.reason, self.context.record.code)
        last.__cause__ = self.context.record.error
        return Failure.of(last)

    def round(self, subgoal: Subgoal, sequence: SolutionSequence, number: int) -> Outcome:
        """One round of the outer loop: strategies for an object path until one brings the object to its goal.

        Raises:
            ContactError: OUT_OF_REACH; no robot could bring the task's object to its goal. NO_CONTACT; none could move
                it from its start.
        """
        scene, name = self.context.scene, subgoal.goal.object
        heavy = subgoal.depth == 0 and needs_two_robots(scene, name, sequence.state.poses[name], subgoal.goal)
        task = PathTask(subgoal, sequence, number, scene.mode == TaskMode.KINEMATIC, heavy)
        with self.context.record.tree.attempt(f"round {number + 1}: '{subgoal.goal.object}' {subgoal.reason}"):
            outcome = self.run(PATH_STRATEGIES, task)
            if isinstance(outcome, Failure) and not outcome.ends_round:
                if task.blocked is not None:
                    return task.blocked
                reachability.check_goal(self.context, task)
            return outcome

    def follow(
        self,
        subgoal: Subgoal,
        sequence: SolutionSequence,
        poses: np.ndarray,
        known: RelaxedSolution | None = None,
    ) -> Outcome:
        """The main loop: strategies at one waypoint after the other until the object is at the end of its path.

        Args:
            subgoal: what has to be achieved.
            sequence: what has been done already.
            poses: (M, 7) path of the object, world frame.
            known: solution of the relaxed problem at the first waypoint, if there is one.
        """
        at = 0
        waypoints: list[np.ndarray] = []
        while at < len(poses) - 1:
            ahead = np.concatenate([sequence.state.poses[subgoal.goal.object][None], poses[at + 1 :]])
            task = WaypointTask.of(self.context, subgoal, sequence, ahead, at, known)
            with self.context.record.tree.attempt(f"waypoint {len(waypoints) + 1}: pose {at} of {len(poses) - 1}"):
                outcome = self.run((*self.contact_strategies(task), *LAST_STRATEGIES), task)
            if isinstance(outcome, Failure):
                self.removal.new_path(subgoal)
                return replace(outcome, reached=sequence if at else None, at=at)
            sequence, known = outcome.sequence, outcome.known
            if outcome.reach:
                at += outcome.reach
                waypoints.append(poses[at])
        placed = steps.place_tool(self.context, sequence)
        if placed is None:
            return self.context.record.last_failure()
        return Solution(placed, at, np.array(waypoints).reshape(-1, 7))

    def try_contacts(
        self,
        task: WaypointTask,
        grasp: ToolGrasp | None = None,
        contacts: Sequence[RobotContact] = (),
        min_reach: int = 0,
        samplings: int = 1,
    ) -> Outcome:
        """The inner loop: contacts at one waypoint until one gives a motion.

        Args:
            task: the waypoint.
            grasp: on the attached tool that touches the object; None: the bare hand touches it.
            contacts: to be tried first.
            min_reach: contacts that serve for fewer poses of the path are left out.
            samplings: how often contacts are searched before there are none.
        """
        manipulator = steps.Manipulator.of(task, grasp)
        tries, ready = 0, None if grasp is None else task.sequence
        most = J_MAX if grasp is None else TRIES_WITH_TOOL
        while tries < most:
            samplings -= 1
            contacts = contacts or steps.find_contacts(task, manipulator, most - tries, min_reach)
            contacts = [contact for contact in contacts if contact.reach >= min_reach]
            if not contacts and samplings > 0:
                continue
            ready = ready or (steps.place_tool(task.context, task.sequence) if contacts else None)
            if not contacts or ready is None:
                break
            for contact in contacts:
                tries += 1
                motion = steps.plan_motion(task, manipulator, ready, contact, tries)
                if motion is not None:
                    return Solution(ready.after(motion), contact.reach, contact=None if grasp else contact)
            manipulator, contacts = manipulator.others_first(contacts), ()
        return task.context.record.last_failure()

    def contact_strategies(self, task: WaypointTask) -> tuple[Strategy, ...]:
        """The strategies for contacts at a waypoint, in the order in which they are tried."""
        return contact_strategies(task)

    def run(self, strategies: Sequence[Strategy], task: PathTask | WaypointTask) -> Outcome:
        """Try strategies in their order until one succeeds, or fails in a way that ends the round."""
        outcome: Outcome = self.context.record.last_failure()
        for strategy in strategies:
            if not strategy.applies(task):
                continue
            with self.context.record.tree.attempt(strategy.name) as node:
                outcome = strategy.solve(self, task)
                node.close(outcome)
            if isinstance(outcome, Solution) or outcome.ends_round:
                break
        return outcome
