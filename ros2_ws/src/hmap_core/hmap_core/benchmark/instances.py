"""Motion problems as data: who moves, what rides on whom, and where everybody has to be at the end of each phase."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from hmap_core.types import Body, BodyKind, Goal, Robot, Scene, Shape, ShapeKind, TaskMode


@dataclass(frozen=True)
class Target:
    """The end-effector of a robot is at T_world_ee (7,) at the end of a phase, or some steps before it."""

    robot: str
    phase: int
    T_world_ee: np.ndarray
    before: int = 0


@dataclass(frozen=True)
class Ride:
    """An object rides rigidly on a robot's end-effector from the beginning of phase ``first`` to the end.

    Attributes:
        T_obj_ee: (7,) the contact: the end-effector seen from the object at the mode switch.
        support: body on which the object stays, upright and at its height, while it rides; None: it may be lifted.
    """

    robot: str
    object: str
    first: int
    T_obj_ee: np.ndarray
    support: str | None = None


@dataclass(frozen=True)
class MotionInstance:
    """One seeded instance of a motion problem.

    Attributes:
        scene: robots (which stand at their start configurations ``q``) and bodies. All robots are variables, in the
            order of ``scene.robots``.
        opening: gripper opening (m) of each robot, the same over the whole motion.
        steps_per_phase: steps of each phase, without the start.
        touching: (robot, body) whose fingers may touch it.
        restarts: how many further starts a solver may try.
        path: whether the way counts. If not, this is one configuration (one step), and only that configuration is
            judged.
        rounding: radius (m) by which the edges of all boxes are rounded, inside of their sizes.
        seed: of whatever the solvers draw.
    """

    scene: Scene
    opening: dict[str, float]
    steps_per_phase: tuple[int, ...]
    targets: tuple[Target, ...]
    rides: tuple[Ride, ...] = ()
    touching: tuple[tuple[str, str], ...] = ()
    restarts: int = 0
    path: bool = True
    rounding: float = 0.0
    seed: int = 0

    @property
    def steps(self) -> int:
        """Steps over all phases."""
        return sum(self.steps_per_phase)

    @property
    def start(self) -> np.ndarray:
        """The start configuration (n,) of all robots."""
        return np.concatenate([robot.q for robot in self.scene.robots.values()])

    def last(self, phase: int) -> int:
        """Row, in a path (T + 1, n) with the start, of the end of a phase; -1 gives the start."""
        return sum(self.steps_per_phase[: phase + 1])

    def columns(self, robot: str) -> slice:
        """The columns of a robot in a path."""
        names = list(self.scene.robots)
        sizes = [len(self.scene.robots[name].q) for name in names]
        first = sum(sizes[: names.index(robot)])
        return slice(first, first + len(self.scene.robots[robot].q))


@dataclass(frozen=True)
class Answer:
    """What a solver says.

    Attributes:
        claimed: whether it calls its result feasible.
        path: (T + 1, n) with the start as the first row; None where there is nothing.
    """

    claimed: bool
    path: np.ndarray | None = field(default=None, repr=False)


def box(name: str, size: Sequence[float], pose: np.ndarray, kind: BodyKind = BodyKind.FIXED) -> Body:
    """A box of full extents (m) at a pose (7,)."""
    return Body(name, kind, (Shape(ShapeKind.BOX, tuple(float(s) for s in size)),), pose)


def scene_of(task: str, seed: int, bodies: Sequence[Body], robots: Sequence[Robot], goal: Goal) -> Scene:
    """A kinematic scene of these bodies and robots."""
    return Scene(task, seed, TaskMode.KINEMATIC, {b.name: b for b in bodies}, {r.name: r for r in robots}, {}, goal)
