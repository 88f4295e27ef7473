"""The relaxed problem: how a waypoint could be left if removable bodies were gone, and which of them are in the way."""

from collections.abc import Sequence
from dataclasses import dataclass

from hmap_core.planner.interfaces import RobotContact, ToolGrasp
from hmap_core.planner.sweep import Sweep


@dataclass(frozen=True)
class RelaxedSolution:
    """A solution of the relaxed problem.

    Attributes:
        contact: the contact by hand; None if it takes a tool.
        tool_grasp: the grasp on that tool.
        in_the_way: removable bodies that the motion hits.
        sweeps: volumes through which the object and the robot pass.
    """

    contact: RobotContact | None
    tool_grasp: ToolGrasp | None
    in_the_way: tuple[str, ...]
    sweeps: tuple[Sweep, ...]

    def with_all(self, names: Sequence[str]) -> list[str]:
        """Names of some bodies, followed by those of all others in the way."""
        return [*names, *(name for name in self.in_the_way if name not in names)]
