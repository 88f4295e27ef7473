"""Scenes for the tests of simulation and execution, made without scene files."""

from pathlib import Path

import numpy as np
import pybullet_data

from hmap_core import transforms
from hmap_core.types import Body, BodyKind, Camera, Goal, Gripper, Robot, RobotModel, Scene, Shape, ShapeKind, TaskMode

HOME = np.array([0.0, -0.5, 0.0, -2.3, 0.0, 1.8, 0.785])


def panda_model() -> RobotModel:
    return RobotModel(
        name="panda",
        urdf=Path(pybullet_data.getDataPath()) / "franka_panda" / "panda.urdf",
        urdf_uri="pybullet_data://franka_panda/panda.urdf",
        joint_names=tuple(f"panda_joint{i}" for i in range(1, 8)),
        end_effector_link="panda_hand",
        T_link_ee=transforms.pose((0.0, 0.0, 0.105)),
        home=HOME,
        position_limits=np.array(
            [[-2.9, -1.76, -2.9, -3.07, -2.9, -0.017, -2.9], [2.9, 1.76, 2.9, -0.07, 2.9, 3.75, 2.9]]
        ),
        velocity_limits=np.array([2.175] * 4 + [2.61] * 3),
        acceleration_limits=np.array([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]),
        gripper=Gripper(
            joint_names=("panda_finger_joint1", "panda_finger_joint2"),
            per_joint=0.5,
            finger_links=("panda_leftfinger", "panda_rightfinger"),
            min_opening=0.0,
            max_opening=0.075,
            open_opening=0.08,
            tip_offset=0.007,
            pad_half_width=0.01,
            force=40.0,
        ),
        ignored_collisions=(),
    )


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
