"""Motion problems as data: robots, attached objects, and target poses at the end of each phase."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hmap_core.types import Body, BodyKind, ContactPoint, Goal, Robot, Scene, Shape, ShapeKind, TaskMode


@dataclass(frozen=True)
class Target:
    """The end-effector of a robot has to be at T_world_ee (7,) at the end of a phase, or ``before`` steps earlier."""

    robot: str
    phase: int
    T_world_ee: np.ndarray
    before: int = 0


@dataclass(frozen=True)
class Attachment:
    """An object is rigidly attached to a robot's end-effector from the start of phase ``first`` to the end.

    Attributes:
        robot: name of the robot.
        object: name of the body.
        first: the phase that starts with the mode switch.
        T_obj_ee: (7,) the contact: the end-effector's pose in the object's frame at the mode switch.
        support: body on which the object stays, upright and at its height, while it is attached; None: it can be
            lifted.
        contact: the same contact with its kind and opening, where these are known; the gripper is then open as the
            contact says.
    """

    robot: str
    object: str
    first: int
    T_obj_ee: np.ndarray
    support: str | None = None
    contact: ContactPoint | None = None


@dataclass(frozen=True)
class MotionInstance:
    """One seeded instance of a motion problem.

    Attributes:
        scene: robots, at their start configurations ``q``, and bodies. All robots are variables, in the order of
            ``scene.robots``.
        opening: gripper opening (m) of each robot, constant during the motion.
        steps_per_phase: number of steps of each phase, without the start.
        targets: required end-effector poses.
        attachments: objects that robots carry.
        touching: (robot, body) pairs that can be in contact: the robot's fingers and the body.
        restarts: number of further starts that a solver can try.
        path: whether the motion is judged. Otherwise the instance is one configuration (one step), and only that is
            judged.
        rounding: radius (m) by which the edges of all boxes are rounded, within their sizes.
        seed: for the solvers' random numbers.
    """

    scene: Scene
    opening: dict[str, float]
    steps_per_phase: tuple[int, ...]
    targets: tuple[Target, ...]
    attachments: tuple[Attachment, ...] = ()
    touching: tuple[tuple[str, str], ...] = ()
    restarts: int = 0
    path: bool = True
    rounding: float = 0.0
    seed: int = 0

    @property
    def steps(self) -> int:
        """Number of steps of all phases."""
        return sum(self.steps_per_phase)

    @property
    def start(self) -> np.ndarray:
        """The start configuration (n,) of all robots."""
        return np.concatenate([robot.q for robot in self.scene.robots.values()])

    def last(self, phase: int) -> int:
        """Row of a phase's end in a path (T + 1, n) that includes the start; -1 gives the start."""
        return sum(self.steps_per_phase[: phase + 1])

    def columns(self, robot: str) -> slice:
        """The columns of a robot in a path."""
        names = list(self.scene.robots)
        sizes = [len(self.scene.robots[name].q) for name in names]
        first = sum(sizes[: names.index(robot)])
        return slice(first, first + len(self.scene.robots[robot].q))


@dataclass(frozen=True)
class Answer:
    """The result of a solver.

    Attributes:
        claimed: whether the solver reports its result as feasible.
        path: what the judge of the problem expects: (T + 1, n) with the start as the first row, (M, 7) poses, or a list
            of motions; None without a result.
    """

    claimed: bool
    path: Any = field(default=None, repr=False)


def box(name: str, size: Iterable[float], pose: np.ndarray, kind: BodyKind = BodyKind.FIXED) -> Body:
    """A box of full extents (m) at a pose (7,)."""
    return Body(name, kind, (Shape(ShapeKind.BOX, tuple(float(s) for s in size)),), pose)


def scene_of(task: str, seed: int, bodies: Sequence[Body], robots: Sequence[Robot], goal: Goal) -> Scene:
    """A kinematic scene of these bodies and robots."""
    return Scene(task, seed, TaskMode.KINEMATIC, {b.name: b for b in bodies}, {r.name: r for r in robots}, {}, goal)
