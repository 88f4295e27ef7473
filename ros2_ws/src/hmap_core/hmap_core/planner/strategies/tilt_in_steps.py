"""Tilting an object with arms that have fewer than six joints: placements on the way that suit the arm."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hmap_core.contacts.grip_width import grip_problem
from hmap_core.exceptions import Code, ContactError, HmapError, MotionError
from hmap_core.kinematics.arm import load_arm
from hmap_core.planner.context import SearchContext
from hmap_core.planner.goals import GOAL_SHARE
from hmap_core.planner.obstruction import without
from hmap_core.planner.outcome import Failure, Outcome, Solution
from hmap_core.planner.solution_sequence import SolutionSequence
from hmap_core.planner.strategies.pick_and_place import picked_and_placed
from hmap_core.planner.tasks import EndGrasp, PathTask
from hmap_core.planner.tilt import SAME_TILT, keeps_tilt, tilt_and_yaw
from hmap_core.planner.tilting import GOAL, Tilting, TiltingGrasp, missing_turns
from hmap_core.planner.tools import tools_of
from hmap_core.transforms import rotation_matrix
from hmap_core.types import Scene

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

LEVEL_GRASPS = 3  # with which it is moved without a change of its tilt, for which motions are planned
SAME_PLACE = 1e-3  # m, and in entries of the rotation matrix
GRASPS_TRIED = 3  # that tilt the object from one side to another one


class TiltInSteps:
    """Moves the object so that a grasp tilts it which the arm can follow, tilts it, and moves it to its goal.

    A path of the object alone says nothing to such arms: they tilt an object about some axes only.
    """

    name = "tilt in steps"

    def applies(self, task: PathTask) -> bool:
        """Whether it is the first round of the task's own object, with all hands free, and it may be lifted."""
        free = task.sequence.tool_grasp is None
        return task.number == 0 and task.subgoal.depth == 0 and not task.kinematic and free

    def solve(self, search: "Search", task: PathTask) -> Outcome:
        """Try chains of such grasps, with the fewest first.

        Raises:
            ContactError: OUT_OF_REACH; no grasp tilts the object, whatever is removable being gone.
        """
        context, record, goal = search.context, search.context.record, task.subgoal.goal
        tilt = tilt_and_yaw(task.sequence.state.poses[task.object], goal.pose)[0]
        if tilt <= GOAL_SHARE * goal.rotation_tolerance + SAME_TILT or not keeps_tilt(context.scene):
            return record.last_failure()
        if context.scene.motion == "planar":
            return record.last_failure()
        context.report("waypoints", text=f"placements between which '{task.object}' is tilted")
        bare = without(context.scene, context.scene.removable.keys() - {task.object})
        rng = context.child_rng()
        tilting = Tilting(bare, task.sequence.state, task.object, goal.pose, rng, context.time_left)
        failures: list[ContactError | MotionError] = []
        if not tilting.reaches(GOAL):
            failures.append(ContactError("its goal is too far for the arm, however it is turned", Code.OUT_OF_REACH))
        for chain in () if failures else tilting.chains():
            edges = [tilting.grasps(a, b) for a, b in zip(chain, chain[1:], strict=False)]
            if not all(edges):
                continue
            with record.tree.attempt(f"{len(edges)} tilts") as node:
                try:
                    sequence = self._done(search, bare, task, task.sequence, edges)
                except (ContactError, MotionError) as error:
                    failures.append(error)
                    record.failed(error)
                    node.fail(error.stage, error.code, error.reason)
                    continue
                node.succeed()
            return Solution(sequence, waypoints=np.array([goal.pose]))
        moved = any(isinstance(failure, MotionError) for failure in failures)
        if not moved and not tools_of(context.scene, task.object):
            raise _cannot_tilt(context.scene, task, tilt, tilting, failures)
        return record.last_failure()

    def _done(
        self,
        search: "Search",
        bare: Scene,
        task: PathTask,
        sequence: SolutionSequence,
        edges: list[list[TiltingGrasp]],
    ) -> SolutionSequence:
        """The sequence after all tilts. Raises ContactError, MotionError."""
        context = search.context
        if not edges:
            return self._brought(search, bare, task, sequence)
        failure: ContactError | MotionError | None = None
        for grasp in edges[0][:GRASPS_TRIED]:
            try:
                there = self._moved_level(context, bare, task, sequence, grasp.T_from)
                end = EndGrasp(grasp.robot, grasp.contact, grasp.T_to)
                tilted = picked_and_placed(context, there, task.object, end)
                return self._done(search, bare, task, tilted, edges[1:])
            except (ContactError, MotionError) as error:
                failure = error
        raise failure or MotionError("nothing was tried")

    def _brought(self, search: "Search", bare: Scene, task: PathTask, sequence: SolutionSequence) -> SolutionSequence:
        """The sequence after the tilted object is at its goal, by a grasp, or else pushed there."""
        goal = task.subgoal.goal
        try:
            return self._moved_level(search.context, bare, task, sequence, goal.pose)
        except ContactError:
            slides = abs(sequence.state.poses[task.object][2] - goal.pose[2]) < SAME_PLACE
            if not slides or self.name in search.given_up:
                raise
            search.given_up.add(self.name)  # it takes long where no push does it either
            subgoal = replace(task.subgoal, depth=task.subgoal.depth + 1, reason="to its goal, once tilted")
            outcome = search.bring(subgoal, sequence, (0,))
            if isinstance(outcome, Failure):
                raise
            return outcome.sequence

    def _moved_level(
        self, context: SearchContext, bare: Scene, task: PathTask, sequence: SolutionSequence, T: np.ndarray
    ) -> SolutionSequence:
        """The sequence after the object was brought to a pose (7,) with the tilt it has.

        Raises:
            ContactError: NO_CONTACT; no grasp serves at both ends.
            MotionError: no motion was found for those that do.
        """
        now, object = sequence.state.poses[task.object], task.object
        if max(np.abs(now[:3] - T[:3]).max(), np.abs(rotation_matrix(now) - rotation_matrix(T)).max()) < SAME_PLACE:
            return sequence
        failure: MotionError | None = None
        for robot in context.scene.robots:
            for contact in context.components.end_contacts.find(
                bare, sequence.state, object, T, robot, LEVEL_GRASPS, context.seed()
            ):
                context.record.counts["contact_tries"] += 1
                try:
                    return picked_and_placed(context, sequence, object, EndGrasp(robot, contact, T))
                except MotionError as error:
                    failure = error
        place = ", ".join(f"{value:.3f}" for value in T[:3])
        raise failure or ContactError(
            f"no grasp on '{object}' serves both where it is and at ({place})", Code.NO_CONTACT
        )


def _cannot_tilt(
    scene: Scene, task: PathTask, tilt: float, tilting: Tilting, failures: Sequence[HmapError]
) -> ContactError:
    """The error that no hand tilts the object of a task by an angle (rad)."""
    reasons, fits = [], False
    for name, (count, start, end, both) in tilting.counts().items():
        arm, robot = load_arm(scene.robots[name].model), scene.robots[name]
        fits |= both > 0
        axes = missing_turns(arm, robot.model.home) @ rotation_matrix(robot.base_pose).T
        about = " nor ".join("({:.2f}, {:.2f}, {:.2f})".format(*axis + 0.0) for axis in axes)
        where = f", not about {about} with its point where it is at home" if len(axes) else ""
        grips = f"of {count} grasps of '{name}' {start} are free for the hand as it stands, {end} tilted, {both} both"
        grips = grips if count else grip_problem(scene, task.object, [name])
        reasons.append(f"{grips}; it moves its hand in {arm.mobility} of 6 directions{where}")
    goal = task.subgoal.goal
    what = f"; {failures[-1].reason}" if failures else ", wherever it is placed for that"
    remedy = "use an arm with six joints or more" if fits else "leave more room for the hand there"
    return ContactError(
        f"the goal of '{task.object}' is tilted by {np.degrees(tilt):.1f} deg from where it stands (allowed are "
        f"{np.degrees(goal.rotation_tolerance):.1f} deg), and no grasp was found with which a robot can tilt it"
        f"{what}: {'; '.join(reasons) or 'no robot has a gripper'}; choose a goal with another tilt, or {remedy}",
        Code.OUT_OF_REACH,
    )
