"""Paths made of pushes in other directions than those in which no contact brought the object on."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hmap_core.contacts.grippable import grippable
from hmap_core.contacts.hand import hand_of
from hmap_core.planner.outcome import Failure, Outcome, Solution
from hmap_core.planner.solution_sequence import SolutionSequence
from hmap_core.planner.strategies.pushed_paths import push_planner
from hmap_core.planner.tasks import PathTask
from hmap_core.planner.tools import extent, with_tool_placed
from hmap_core.waypoints.resample import CUT_ANGLE, direction

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

TRIED = 4  # paths; each adds a direction that is avoided


class PushedAround:
    """Turns the object on its way, so that hands push it where they reach its sides."""

    name = "object path made of pushes in other directions"

    def applies(self, task: PathTask) -> bool:
        """Whether no contact served in some direction, and several contacts may be used."""
        return task.ready is not None and task.may_slide and bool(task.unserved)

    def solve(self, search: "Search", task: PathTask) -> Outcome:
        """Follow paths without the directions that failed; only what no hand grips."""
        context = search.context
        ready = task.require_ready()
        state = with_tool_placed(ready.state, ready.tool_grasp)
        hands = [hand_of(robot) for robot in context.scene.robots.values()]
        if grippable(context.scene.bodies[task.object], state.poses[task.object], hands):
            return context.record.last_failure()
        pushes = push_planner(context.scene, state, task.object, task.poses)
        for _ in range(TRIED):
            pushed = pushes.path(task.poses, None, task.unserved)
            if pushed is None:
                break
            with context.record.tree.attempt(f"{len(pushed)} poses"):
                outcome = _follow_legs(search, task, ready, pushed)
            if isinstance(outcome, Solution) or outcome.ends_round:
                return outcome
            task.stopped(outcome, pushed)
        return context.record.last_failure()


def _follow_legs(search: "Search", task: PathTask, ready: SolutionSequence, poses: np.ndarray) -> Outcome:
    """Follow a path (M, 7) leg by leg: the hand stops where a push along a line becomes one along an arc.

    A smooth motion of the joints would swing out there, and the push would slip.
    """
    sequence, waypoints, ends = ready, [], _leg_ends(poses, extent(search.context.scene, task.object))
    for first, last in zip([0, *ends[:-1]], ends, strict=True):
        outcome = search.follow(task.subgoal, sequence, poses[first : last + 1])
        if isinstance(outcome, Failure):
            at = None if outcome.at is None else first + outcome.at
            return replace(outcome, at=at, reached=outcome.reached or (sequence if first else None))
        sequence = outcome.sequence
        waypoints.append(outcome.waypoints)
    return Solution(sequence, len(poses) - 1, np.concatenate(waypoints))


def _leg_ends(poses: np.ndarray, radius: float) -> list[int]:
    """Numbers of the poses (M, 7) at which legs end: where the direction of the motion jumps, and the last one.

    Args:
        poses: the path.
        radius: m that one radian of rotation counts as.
    """
    steps = [direction(a, b, radius) for a, b in zip(poses[:-1], poses[1:], strict=True)]
    jumps = [k for k in range(1, len(steps)) if steps[k - 1] @ steps[k] < np.cos(CUT_ANGLE)]
    return [*jumps, len(poses) - 1]
