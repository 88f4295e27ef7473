"""Removable bodies in the way of the object or of the hand are removed, each by an instance of Algorithm 1."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from hmap_core.planner import steps
from hmap_core.planner.contact_filters import CostTerm, NoneServes, bodies_hit
from hmap_core.planner.diagnosis import why_no_contact
from hmap_core.planner.obstacle_removal import BlockedError, RemovalError, StuckError, blocked, raise_if_alone
from hmap_core.planner.obstruction import CONTACT_ROOM, in_motions, met, stacked_on, without
from hmap_core.planner.outcome import Failure, Outcome, Solution
from hmap_core.planner.relaxed import RelaxedSolution
from hmap_core.planner.solution_sequence import SolutionSequence, Subgoal, removable_for
from hmap_core.planner.sweep import motion_sweeps, object_sweep
from hmap_core.planner.tasks import PathTask, WaypointTask
from hmap_core.planner.tools import with_tool_placed
from hmap_core.types import Scene

if TYPE_CHECKING:
    from hmap_core.planner.search import Search


ALIKE = 0.02  # m by which distances of bodies from a robot differ where neither stands before the other


class RemoveObstacles:
    """At a waypoint: solve the relaxed problem without the removable bodies, then remove those that its motion hits."""

    name = "with obstacles removed"

    def applies(self, task: WaypointTask) -> bool:
        """Whether there is something that may be removed."""
        return bool(removable_for(task.context.scene, task.subgoal, task.sequence))

    def solve(self, search: "Search", task: WaypointTask) -> Outcome:
        """Return the sequence after the removals; an obstacle is moved only if that makes a solution possible.

        The failure ends the round if no other body may be moved, and hands fit on the object only without some.
        """
        before = task.context.record.error
        found = solve_relaxed(search, task.subgoal, task.sequence, task.ahead)
        if not isinstance(found, RelaxedSolution):
            covered = isinstance(found, Failure) and isinstance(found.error, NoneServes)
            if task.subgoal.alone and covered and not isinstance(before, NoneServes):
                others = removable_for(task.context.scene, task.subgoal, task.sequence)
                return Failure.of(blocked(task.subgoal, others[0]), ends_round=True)
            return found
        return _removed(search, task.subgoal, task.sequence, found.in_the_way, found)


def removable_load(scene: Scene, task: PathTask) -> tuple[str, ...]:
    """The removable bodies that stand on the object of a round, on each other or on several: from below to the top.

    Args:
        scene: in which only those bodies are removable that the subgoal may move.
        task: the round.
    """
    state = with_tool_placed(task.sequence.state, task.sequence.tool_grasp)
    return tuple(name for name in stacked_on(scene, state, task.object) if name in scene.removable)


def clear_path(
    search: "Search", subgoal: Subgoal, sequence: SolutionSequence, poses: np.ndarray, blockers: tuple[str, ...]
) -> Outcome:
    """Remove the bodies on an object path, and whatever else is in the way of the first motion along it.

    Args:
        search: the job.
        subgoal, sequence: what has to be achieved, and what has been done.
        poses: (M, 7) path of the object, world frame.
        blockers: removable bodies on the path.

    Returns:
        The sequence once they are removed, with what is known to work then. The failure ends the round if a body cannot
        be removed.
    """
    search.removal.new_path(subgoal)
    if not blockers:
        return Solution(sequence)
    try:
        raise_if_alone(subgoal, blockers[0])
    except RemovalError as error:
        return Failure.of(error, ends_round=True)
    found = solve_relaxed(search, subgoal, sequence, poses, blockers)
    if not isinstance(found, RelaxedSolution):
        return search.context.record.last_failure()
    placed = steps.place_tool(search.context, sequence)
    if placed is None:
        return search.context.record.last_failure()
    scene = search.context.scene
    ordered = nearest_first(scene, placed, met(scene, placed.state, subgoal.goal.object, poses, blockers))
    return _removed(search, subgoal, placed, found.with_all(ordered), found)


def why_stuck(search: "Search", task: PathTask, blockers: Sequence[str]) -> StuckError | None:
    """Why obstacles cannot be moved out of the way of a path, even if it is not known how it would be followed.

    Args:
        search: the job, whose last failure stays the same.
        task: the round, with the path.
        blockers: removable bodies on the path.

    Returns:
        The reason; None if they can be moved, or if it is not known.
    """
    context, subgoal = search.context, task.subgoal
    before = context.record.last_failure()
    try:
        search.removal.clear(subgoal, task.sequence, blockers, [object_sweep(context.scene, task.object, task.poses)])
    except BlockedError:
        return None
    except RemovalError as error:
        name = error.body or blockers[0]
        why = why_no_contact(context.scene, task.sequence.state, name, task.sequence.state.poses[name])
        return StuckError(f"{error.reason}; nothing can move '{name}' where it stands: {why}", error.code)
    finally:
        if before.error is not None:
            context.record.failed(before.error)
    return None


def _removed(
    search: "Search", subgoal: Subgoal, sequence: SolutionSequence, names: Sequence[str], found: RelaxedSolution
) -> Outcome:
    placed = steps.place_tool(search.context, sequence)
    if placed is None:
        return search.context.record.last_failure()
    try:
        cleared = search.removal.clear(subgoal, placed, names, found.sweeps)
    except RemovalError as error:
        return Failure.of(error, ends_round=True)
    return Solution(cleared, known=found)


def solve_relaxed(
    search: "Search",
    subgoal: Subgoal,
    sequence: SolutionSequence,
    ahead: np.ndarray,
    blockers: tuple[str, ...] = (),
) -> RelaxedSolution | Outcome:
    """Solve one waypoint with removable bodies gone: only the blockers first, then all of them.

    Contacts in which the robot is in the way of the fewest of these bodies come first.

    Returns:
        A relaxed solution if the motion hits some of the bodies; a solution if it hits none and there are no blockers;
        otherwise the last failure.
    """
    context, object = search.context, subgoal.goal.object
    scene, names = context.scene, removable_for(context.scene, subgoal, sequence)
    for gone in dict.fromkeys((blockers, names)) if names else ():
        if not gone:
            continue
        task = WaypointTask.of(context.within(without(scene, gone)), subgoal, sequence, ahead, 0)
        finder = CostTerm(task.context.components.contacts, bodies_hit(scene, gone))
        task = replace(task, context=task.context.using(contacts=finder))
        with context.record.tree.attempt(f"relaxed problem without {', '.join(gone)}"):
            outcome = search.run(search.contact_strategies(task), task)
        if isinstance(outcome, Failure):
            continue
        motions = outcome.sequence.motions[len(sequence.motions) :]
        hit = in_motions(scene, sequence.state, motions, gone)
        if not hit and not blockers:
            return outcome
        hit = nearest_first(scene, sequence, hit)
        sweeps = [object_sweep(scene, object, ahead)]
        sweeps += [way for m in motions for way in motion_sweeps(scene, sequence.state, m, CONTACT_ROOM)]
        return RelaxedSolution(outcome.contact, outcome.tool_grasp, hit, tuple(sweeps))
    return context.record.last_failure()


def nearest_first(scene: Scene, sequence: SolutionSequence, names: Sequence[str]) -> tuple[str, ...]:
    """Names of bodies, those nearest to the base of a robot first: what stands before others has to go before them.

    Distances that differ by less than ALIKE count as the same; these bodies keep their order.
    """
    bases = [robot.base_pose[:3] for robot in scene.robots.values()]

    def away(name: str) -> float:
        return min(float(np.linalg.norm(sequence.state.poses[name][:3] - base)) for base in bases)

    return tuple(sorted(names, key=lambda name: round(away(name) / ALIKE)))
