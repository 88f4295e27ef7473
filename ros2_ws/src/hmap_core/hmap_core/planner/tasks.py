"""The two kinds of task that strategies solve: a round of the outer loop, and a turn of the main loop."""

from dataclasses import dataclass, field

import numpy as np

from hmap_core.planner.contact_filters import (
    AttachedPathContact,
    KnownContact,
    KnownToolGrasp,
    NoToolGrasps,
    covering,
)
from hmap_core.planner.context import SearchContext
from hmap_core.planner.outcome import Failure
from hmap_core.planner.relaxed import RelaxedSolution
from hmap_core.planner.sampled_presses import press_finder
from hmap_core.planner.solution_sequence import SolutionSequence, Subgoal
from hmap_core.types import ContactPoint

DIRECTION_STEP = 0.005  # m of a path that show its direction


@dataclass(frozen=True)
class EndGrasp:
    """A contact that a robot can make where an object starts, and release at its goal.

    Attributes:
        robot: its name.
        contact: on the object.
        T_goal: (7,) goal pose of the object, world frame.
    """

    robot: str
    contact: ContactPoint
    T_goal: np.ndarray


@dataclass
class PathTask:
    """One round of the outer loop: a path has to be found and followed.

    Attributes:
        subgoal: what has to be achieved.
        sequence: what has been done already.
        number: of the round, from 0 on.
        kinematic: whether contacts carry in any direction.
        needs_two: whether no robot can move the object alone, by its weight, and two might carry it.
        poses: (M, 7) the last path that was planned for the object alone.
        ready: the sequence once obstacles were removed from that path; None: they could not be, or there is no path.
        reached: what was done on the last path that could not be followed to its end.
        unserved: directions (rad, world frame) in which no contact brought the object on.
        hands: contacts that serve at the start and at the goal, as far as they were found.
        relay: whether robots grasp the object, and none of them reaches one grasp at both ends.
        blocked: failure on a path of the object and a hand, on which a body stands that may not be moved for this
            subgoal.
    """

    subgoal: Subgoal
    sequence: SolutionSequence
    number: int
    kinematic: bool = False
    needs_two: bool = False
    poses: np.ndarray = field(default_factory=lambda: np.zeros((0, 7)))
    ready: SolutionSequence | None = None
    reached: SolutionSequence | None = None
    unserved: list[float] = field(default_factory=list)
    hands: list[EndGrasp] = field(default_factory=list)
    relay: bool = False
    blocked: Failure | None = None

    @property
    def object(self) -> str:
        """Name of the object."""
        return self.subgoal.goal.object

    @property
    def may_change_contacts(self) -> bool:
        """Whether the task is physical, and several contacts may be used."""
        return not self.subgoal.whole and not self.kinematic

    @property
    def may_slide(self) -> bool:
        """Whether the object may be pushed and dragged, and no other robot has to take it over anyway."""
        return self.may_change_contacts and not self.relay

    def stopped(self, failure: Failure, poses: np.ndarray) -> None:
        """Note how far a path of the object was followed, and in which direction it would have gone on.

        Args:
            failure: of following it.
            poses: (M, 7) the path, world frame.
        """
        self.reached = failure.reached or self.reached
        if failure.at is None:
            return
        way = poses[failure.at + 1 :, :2] - poses[failure.at, :2]
        far = np.flatnonzero(np.hypot(*way.T) > DIRECTION_STEP)
        if len(far):
            self.unserved.append(float(np.arctan2(*way[far[0], ::-1])))

    def require_ready(self) -> SolutionSequence:
        """The sequence once obstacles were removed from the last path.

        Raises:
            ValueError: they could not be, or there is no path.
        """
        if self.ready is None:
            raise ValueError(f"the path of '{self.object}' is not free of obstacles")
        return self.ready


@dataclass(frozen=True)
class WaypointTask:
    """One turn of the main loop: the object has to advance along its path.

    Attributes:
        context: the job; its components already respect the subgoal.
        subgoal: what has to be achieved.
        sequence: what has been done already.
        ahead: (M, 7) the rest of the object's path, from where the object stands.
        at: index of the present pose in the whole path.
        total: index of the last pose of the whole path.
    """

    context: SearchContext
    subgoal: Subgoal
    sequence: SolutionSequence
    ahead: np.ndarray
    at: int
    total: int

    @staticmethod
    def of(
        context: SearchContext,
        subgoal: Subgoal,
        sequence: SolutionSequence,
        ahead: np.ndarray,
        at: int,
        known: RelaxedSolution | None = None,
    ) -> "WaypointTask":
        """The task with the filters that its subgoal asks for, and with what is known to work."""
        context = restricted(context, subgoal)
        if known is not None:
            parts = context.components
            context = context.using(
                contacts=KnownContact(parts.contacts, known, ahead), tools=KnownToolGrasp(parts.tools, known)
            )
        return WaypointTask(context, subgoal, sequence, ahead, at, at + len(ahead) - 1)

    @property
    def object(self) -> str:
        """Name of the object."""
        return self.subgoal.goal.object


def restricted(context: SearchContext, subgoal: Subgoal) -> SearchContext:
    """The job with only those contacts and tools that serve a subgoal."""
    parts, path = context.components, subgoal.attached_path
    if path is not None:
        context = context.using(contacts=AttachedPathContact(parts.checker, path), tools=NoToolGrasps())
    if subgoal.pressed:
        context = context.using(contacts=press_finder(parts.checker, parts.proposer), tools=NoToolGrasps())
    if subgoal.whole:
        context = context.using(contacts=covering(context.components.contacts, subgoal.goal.object))
    return context
