"""Two robots carry an object that no robot moves alone, by its weight."""

from dataclasses import replace
from typing import TYPE_CHECKING

from hmap_core.planner.outcome import Failure, Outcome
from hmap_core.planner.tasks import PathTask
from hmap_core.planner.two_arms import TwoArms

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

ROUNDS = 2  # of the outer loop, after which the last failure is the answer


class CarryHeavy:
    """Two arms, before everything else, since nothing else can move the object."""

    name = "two arms, since no one carries the weight"

    def applies(self, task: PathTask) -> bool:
        """Whether no robot can move the task's own object alone, and two might."""
        return task.needs_two

    def solve(self, search: "Search", task: PathTask) -> Outcome:
        """Try pairs of grasps. A failure ends the round.

        Raises:
            ContactError: NO_CONTACT; no two robots can carry the object.
            MotionError: NO_MOTION; they find no motion with any of the grasps.
        """
        arms = TwoArms.of(search, task)
        if arms is None:
            return search.context.record.last_failure()
        outcome = arms.solve()
        if not isinstance(outcome, Failure) or outcome.error is None:
            return outcome
        search.context.record.failed(outcome.error)
        if task.number + 1 >= ROUNDS or not arms.grasps.promising():
            raise outcome.error
        return replace(outcome, ends_round=True)
