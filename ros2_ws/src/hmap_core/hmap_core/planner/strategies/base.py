"""The protocol of strategies."""

from typing import TYPE_CHECKING, Protocol, TypeVar

from hmap_core.planner.outcome import Outcome
from hmap_core.planner.tasks import PathTask, WaypointTask

if TYPE_CHECKING:
    from hmap_core.planner.search import Search

Task = TypeVar("Task", PathTask, WaypointTask, contravariant=True)


class Strategy(Protocol[Task]):
    """One way to solve a task.

    Attributes:
        name: for people; it stands in the search tree.
    """

    name: str

    def applies(self, task: Task) -> bool:
        """Whether it makes sense to try this strategy."""
        ...

    def solve(self, search: "Search", task: Task) -> Outcome:
        """Solve the task.

        Raises:
            HmapError: only errors that end the whole job: time limit, cancel, invalid input.
        """
        ...
