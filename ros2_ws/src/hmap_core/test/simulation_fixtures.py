"""Scenes for the tests of simulation and execution, made without scene files."""

import numpy as np

from hmap_core import transforms
from hmap_core.scenes import load_robot_model
from hmap_core.types import Body, BodyKind, Camera, Goal, Robot, RobotModel, Scene, Shape, ShapeKind, TaskMode

HOME = np.array([0.0, -0.5, 0.0, -2.3, 0.0, 1.8, 0.785])


def panda_model() -> RobotModel:
    return load_robot_model("panda")


def box(name: str, size, position, kind=BodyKind.MOVABLE, mass: float = 0.3, **more) -> Body:
    shape = Shape(ShapeKind.BOX, tuple(size))
    return Body(name, kind, (shape,), transforms.pose(position), 0.0 if kind is BodyKind.FIXED else mass, **more)


def table() -> Body:
    return box("table", (4.0, 4.0, 0.1), (0.0, 0.0, -0.05), BodyKind.FIXED, friction=0.5)


def scene(*bodies: Body, robots: bool = True, mode: TaskMode = TaskMode.PHYSICAL, goal: Goal | None = None) -> Scene:
    everything = {body.name: body for body in (table(), *bodies)}
    robot = Robot("left", panda_model(), transforms.pose(), HOME.copy())
    return Scene(
        task="test",
        seed=0,
        mode=mode,
        bodies=everything,
        robots={"left": robot} if robots else {},
        cameras={"top": Camera("top", transforms.pose((0.5, 0.0, 1.5), (1.0, 0.0, 0.0, 0.0)), 160, 120)},
        goal=goal or Goal(bodies[0].name if bodies else "table", transforms.pose()),
    )
