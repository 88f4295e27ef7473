"""The symbolic half of the logic-geometric program: hands, actions, and what they change.

An action is ``touch``, ``stable`` and ``pose_eq`` (or ``above``) as RAI calls them: a hand, bare or with a tool, meets
an object, carries it, and releases it at a place.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from hmap_core.planner.context import SearchContext
from hmap_core.planner.interfaces import ToolGrasp
from hmap_core.planner.obstruction import carried_by
from hmap_core.planner.tools import attach_tool, tools_of
from hmap_core.transforms import interpolate
from hmap_core.types import BodyKind, Goal, Scene, SceneState

TOOL_GRASPS = 3  # grasps on tools, the farthest-reaching
LINE = 12  # poses of the straight line on which these are judged
MOST_PLACES = 2  # places in between at which the goal's object is released


class Target(StrEnum):
    """Where an action releases its object."""

    GOAL = "goal"  # pose_eq of the task
    REMOVAL = "removal"  # pose_eq, where the task gives the pose
    PLACE = "place"  # above a support


@dataclass(frozen=True, eq=False)
class Hand:
    """A robot's bare hand, or the tool that it grasps; each is one object, which is equal to itself only.

    Attributes:
        robot: its name.
        scene: the scene; the tool is part of the hand in it.
        grasp: on the tool; None for the bare hand.
    """

    robot: str
    scene: Scene
    grasp: ToolGrasp | None = None

    @property
    def manipulator(self) -> str:
        """Name of what touches."""
        return self.robot if self.grasp is None else self.grasp.tool


@dataclass(frozen=True)
class Action:
    """A hand brings an object to a target.

    Attributes:
        hand: the hand; object: its name; target: where to.
    """

    hand: Hand
    object: str
    target: Target

    def __str__(self) -> str:
        what = self.hand.manipulator, self.object
        end = f"above {self.object}" if self.target is Target.PLACE else f"pose_eq {self.object} {self.target}"
        return f"touch {' '.join(what)}; stable {' '.join(what)}; {end}"


def hands(context: SearchContext, goal: Goal) -> list[Hand]:
    """The hands of all robots, bare ones first."""
    bare = [Hand(robot, context.scene) for robot in context.scene.robots]
    if not tools_of(context.scene, goal.object):
        return bare
    context.report("contacts", text=f"tools for '{goal.object}'")
    ends = context.start.poses[goal.object], goal.pose
    line = np.array([interpolate(*ends, share) for share in np.linspace(0.0, 1.0, LINE)])
    found = context.components.tools.tool_grasps(
        context.scene, context.start, goal.object, line, context.seed(), context.time_left()
    )
    return bare + [Hand(own.robot, attach_tool(context.scene, own), own) for own, _ in found[:TOOL_GRASPS]]


def successors(scene: Scene, goal: Goal, actions: Sequence[Action], hands: Sequence[Hand]) -> Iterator[Action]:
    """The actions that may follow others: every removable body moves once, the object until it is at its goal."""
    if any(action.target is Target.GOAL for action in actions):
        return
    moved = {action.object for action in actions}
    removable = [name for name in scene.removable if name != goal.object and name not in moved]
    places = sum(action.object == goal.object for action in actions)
    for hand in hands:
        yield Action(hand, goal.object, Target.GOAL)
        if places < MOST_PLACES:
            yield Action(hand, goal.object, Target.PLACE)
        for name in removable:
            if name != hand.manipulator:
                yield Action(hand, name, Target.REMOVAL if scene.removable[name] is not None else Target.PLACE)


def support_of(scene: Scene, state: SceneState, object: str) -> str | None:
    """Name of a fixed body that carries an object; None for none."""
    fixed = (name for name, body in scene.bodies.items() if body.kind == BodyKind.FIXED)
    return next((name for name in fixed if object in carried_by(scene, state, name)), None)
