"""Subgoals of Algorithm 1 and the sequence of motions that leads to them."""

from dataclasses import dataclass, replace

from hmap_core.planner.assembly import state_after
from hmap_core.planner.interfaces import AttachedPath, SubTrajectory, ToolGrasp
from hmap_core.planner.sweep import Sweep
from hmap_core.types import Goal, Scene, SceneState


@dataclass(frozen=True)
class Subgoal:
    """What one instance of Algorithm 1 has to achieve.

    Attributes:
        goal: the object and its goal pose.
        busy: bodies that must not be moved for it: the objects of the instances above, and what they keep in place.
        keep_out: volumes through which the instances above will pass; nothing may be placed there.
        depth: number of instances above this one.
        alone: the subgoal fails if another body would have to be removed first.
        whole: one contact has to carry the object all the way.
        attached_path: the path of the object together with a hand, if it was planned for one.
        pressed: hands press on the object from above as far as they can; other contacts take over where they end.
        reason: why, for people.
    """

    goal: Goal
    busy: frozenset[str] = frozenset()
    keep_out: tuple[Sweep, ...] = ()
    depth: int = 0
    alone: bool = False
    whole: bool = False
    attached_path: AttachedPath | None = None
    pressed: bool = False
    reason: str = "to its goal"


@dataclass(frozen=True)
class SolutionSequence:
    """The motions found so far, one after the other (MoveIt Task Constructor's term).

    Attributes:
        state: where everything is after them.
        motions: the motions.
        aside: bodies that were removed from the way.
        depth: depth of the deepest removal.
        tool_grasp: the grasp on the tool that a robot holds; None: all hands are free.
    """

    state: SceneState
    motions: tuple[SubTrajectory, ...] = ()
    aside: tuple[str, ...] = ()
    depth: int = 0
    tool_grasp: ToolGrasp | None = None

    def after(self, motion: SubTrajectory) -> "SolutionSequence":
        """The sequence with one more motion."""
        return replace(self, state=state_after(self.state, motion), motions=(*self.motions, motion))


def removable_for(scene: Scene, subgoal: Subgoal, sequence: SolutionSequence) -> tuple[str, ...]:
    """Names of the bodies that may be removed from the way of a subgoal."""
    stay = {subgoal.goal.object, scene.goal.object, *subgoal.busy, *sequence.aside}
    return tuple(name for name in scene.removable if name not in stay)
