"""Pairs of grasps are tried one after the other, until two robots carry the object to its goal together."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from hmap_core.exceptions import Code, ContactError, MotionError, PlannerError
from hmap_core.planner import steps
from hmap_core.planner.attached_path import path_with_hands
from hmap_core.planner.goals import goal_of_round, path_scene
from hmap_core.planner.interfaces import SubTrajectory
from hmap_core.planner.lifting import raised_at_ends
from hmap_core.planner.obstacle_removal import RemovalError
from hmap_core.planner.obstruction import without
from hmap_core.planner.outcome import Failure, Outcome, Solution
from hmap_core.planner.protocols import SharedQuery
from hmap_core.planner.shared_grasps import GraspPair, SharedGrasps
from hmap_core.planner.solution_sequence import SolutionSequence
from hmap_core.planner.strategies.remove_obstacles import removable_load
from hmap_core.planner.surroundings import away_from_home
from hmap_core.planner.sweep import object_sweep
from hmap_core.planner.tasks import PathTask
from hmap_core.types import Goal, Scene

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

TRIED = 8  # pairs of grasps for which a path is planned
CLEARED = 4  # bodies that are removed before no more are


class BlockedPath(MotionError):
    """Removable bodies are on the path of the object with two hands attached.

    Attributes:
        poses: (M, 7) the path without them.
        blockers: their names.
    """

    def __init__(self, object: str, poses: np.ndarray, blockers: tuple[str, ...]):
        super().__init__(f"{', '.join(blockers)} in the way of '{object}' with two hands attached")
        self.poses, self.blockers = poses, blockers


def possible(scene: Scene) -> bool:
    """Whether two robots of a scene have grippers, and its object may leave its support."""
    return scene.motion != "planar" and sum(robot.model.gripper is not None for robot in scene.robots.values()) > 1


@dataclass(frozen=True)
class TwoArms:
    """Two robots that may carry the object of a task together.

    Attributes:
        search, task: the job, and the round of the outer loop.
        sequence: what has been done already; all hands are free.
        goal: of the object.
        grasps: of the robots on the object.
    """

    search: "Search"
    task: PathTask
    sequence: SolutionSequence
    goal: Goal
    grasps: SharedGrasps

    @staticmethod
    def of(search: "Search", task: PathTask, sequence: SolutionSequence | None = None) -> "TwoArms | None":
        """The robots with their grasps; None where a tool cannot be placed.

        Removable bodies do not count, unless a ``sequence`` is given, in which those in the way are gone.
        """
        context, object = search.context, task.object
        scene = context.scene
        if sequence is None:
            scene, sequence = (
                without(scene, path_scene(scene, task).removable),
                steps.place_tool(context, task.sequence),
            )
        if sequence is None:
            return None
        context.report("waypoints", text=f"'{object}' by two arms")
        goal = goal_of_round(context, task, sequence.state)
        ends = sequence.state.poses[object], goal.pose
        grasps = SharedGrasps(scene, sequence.state, object, ends, context.child_rng())
        return TwoArms(search, task, sequence, goal, grasps)

    def solve(self) -> Outcome:
        """Try pairs of grasps; bodies in the way are removed first. The failure is that of the last pair."""
        context, task = self.search.context, self.task
        load = removable_load(path_scene(context.scene, task), task)
        if load:
            ends = np.array([self.sequence.state.poses[task.object], self.goal.pose])
            return self._without(load, ends)
        return self._try_pairs()

    def _without(self, names: Sequence[str], poses: np.ndarray) -> Outcome:
        """Remove bodies that are on the path (M, 7) of the object, and try pairs of grasps then."""
        sweeps = [object_sweep(self.search.context.scene, self.task.object, poses)]
        try:
            sequence = self.search.removal.clear(self.task.subgoal, self.sequence, names, sweeps)
        except RemovalError as error:
            return Failure.of(error)
        again = TwoArms.of(self.search, self.task, sequence)
        return self.search.context.record.last_failure() if again is None else again._try_pairs(frozenset(names))

    def _try_pairs(self, removed: frozenset[str] = frozenset()) -> Outcome:
        """Try pairs of grasps, once ``removed`` bodies are gone; others that are in the way are removed once."""
        context, object = self.search.context, self.task.object
        if not self.grasps.promising():
            reason = f"two robots cannot carry '{object}' together: {self.grasps.why_none()}"
            return Failure.of(ContactError(reason, Code.NO_CONTACT))
        failure = Failure.of(
            PlannerError(f"two arms do not reach their grasps on '{object}' at start and goal", Code.NO_CONTACT)
        )
        for number, pair in zip(range(1, TRIED + 1), self.grasps.pairs(), strict=False):
            what = f"{pair.robots[0]} and {pair.robots[1]} carry '{object}'"
            context.report("motion", attempt=number, text=what)
            blocked: BlockedPath | None = None
            with context.record.tree.attempt(f"{what}, {100.0 * pair.share:.0f} % by {pair.robots[0]}") as node:
                try:
                    motion = self._motion(pair)
                except MotionError as error:
                    node.fail(error.stage, error.code, error.reason)
                    failure = Failure.of(error)
                    blocked = error if isinstance(error, BlockedPath) else None
                else:
                    node.succeed()
                    return Solution(self.sequence.after(motion), waypoints=np.array([self.goal.pose]))
            if blocked is not None and removed.isdisjoint(blocked.blockers) and len(removed) < CLEARED:
                return self._without(blocked.blockers, blocked.poses)
        return failure

    def _motion(self, pair: GraspPair) -> SubTrajectory:
        """The motion with one pair of grasps. Raises MotionError."""
        context, state = self.search.context, self.sequence.state
        poses = self._path(pair)
        first, second = self.grasps.followed(pair, poses)
        first = replace(first, clear=away_from_home(context.scene, state, first.robot))
        context.record.counts["contact_tries"] += 1
        query = SharedQuery(
            context.scene, state, self.task.object, (first, second), poses, context.seed(), context.time_left()
        )
        return context.components.segments.plan_shared(query)

    def _path(self, pair: GraspPair) -> np.ndarray:
        """Path (M, 7) of the object with both hands attached; it leaves and reaches supports vertically.

        Raises:
            MotionError: there is none.
        """
        context, hands = self.search.context, list(zip(pair.robots, pair.contacts, strict=True))
        planner = context.components.object_path
        found = path_with_hands(
            planner, context.scene, self.sequence.state, self.goal, hands, context.rng, context.time_left()
        )
        if found is None:
            raise MotionError(f"no path of '{self.goal.object}' with two hands attached")
        poses, blockers = found
        if blockers:
            raise BlockedPath(self.goal.object, poses, blockers)
        context.record.counts["waypoint_plans"] += 1
        return raised_at_ends(poses)
