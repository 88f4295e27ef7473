"""A scene under MuJoCo's dynamics, with the interface of the simulated world that executions use."""

import os
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from hmap_core import transforms
from hmap_core.exceptions import Code, InputError
from hmap_core.simulation.mjcf import TIME_STEP, scene_to_mjcf
from hmap_core.simulation.mujoco_robot import MujocoRobot
from hmap_core.simulation.world import Contact
from hmap_core.types import Body, BodyKind, Scene, SceneState

os.environ.setdefault("MUJOCO_GL", "disable")  # nothing is drawn, so no window system is needed
import mujoco  # noqa: E402

SUBSTEPS = 2  # steps of MuJoCo in one of the world


class MujocoWorld:
    """A scene under dynamics. Objects move by contact and gravity only."""

    dt = SUBSTEPS * TIME_STEP

    def __init__(self, scene: Scene):
        """Build the scene at its start state.

        Raises:
            InputError: a body or a robot cannot be simulated.
        """
        self.scene = scene
        self._bodies = dict(scene.bodies)
        with tempfile.TemporaryDirectory(prefix="hmap_mjcf_") as folder:
            text = scene_to_mjcf(scene, Path(folder))
        try:
            self.model = mujoco.MjModel.from_xml_string(text)
        except ValueError as error:
            raise InputError(f"MuJoCo cannot load the scene '{scene.task}': {error}", Code.INVALID_SCENE) from error
        self.data = mujoco.MjData(self.model)
        self._robots = {name: MujocoRobot(self.model, self.data, robot) for name, robot in scene.robots.items()}
        self._steps = 0
        mujoco.mj_forward(self.model, self.data)

    def __enter__(self) -> "MujocoWorld":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def close(self) -> None:
        """Nothing has to be freed."""

    @property
    def time(self) -> float:
        """Simulated seconds since the world was made."""
        return self._steps * self.dt

    def step(self) -> None:
        """Let ``dt`` pass."""
        for _ in range(SUBSTEPS):
            for robot in self._robots.values():
                robot.advance(TIME_STEP)
            mujoco.mj_step(self.model, self.data)
        self._steps += 1

    def robot(self, name: str) -> MujocoRobot:
        """The robot of that name.

        Raises:
            InputError: there is none.
        """
        if name not in self._robots:
            raise InputError(f"no robot '{name}' in the world; there are {sorted(self._robots)}", Code.UNKNOWN_ROBOT)
        return self._robots[name]

    def body_names(self) -> list[str]:
        """Names of all bodies."""
        return list(self._bodies)

    def body(self, name: str) -> Body:
        """The body as described, at its present pose."""
        return replace(self._body(name), pose=self.body_pose(name))

    def body_pose(self, name: str) -> np.ndarray:
        """``T_world_body`` (7,)."""
        if self._body(name).kind is BodyKind.FIXED:
            return self._body(name).pose.copy()
        qpos = self.data.joint(name).qpos
        return np.concatenate([qpos[:3], np.roll(qpos[3:], -1)])

    def body_velocity(self, name: str) -> np.ndarray:
        """Velocity of the body's origin (m/s), angular velocity (rad/s): (6,), world axes."""
        if self._body(name).kind is BodyKind.FIXED:
            return np.zeros(6)
        qvel = self.data.joint(name).qvel
        return np.concatenate([qvel[:3], transforms.rotation_matrix(self.body_pose(name)) @ qvel[3:]])

    def state(self) -> SceneState:
        """Where everything is now."""
        return SceneState(
            q={name: robot.arm_state()[0] for name, robot in self._robots.items()},
            gripper={name: robot.gripper_state()[0] for name, robot in self._robots.items()},
            poses={name: self.body_pose(name) for name in self._bodies},
        )

    def contacts(self, name: str) -> list[Contact]:
        """Contacts of a body or robot at the last step."""
        found = []
        for k in range(self.data.ncon):
            contact = self.data.contact[k]
            owners = [self._owner(geom) for geom in (contact.geom1, contact.geom2)]
            if name not in (owners[0][0], owners[1][0]):
                continue
            force = np.zeros(6)
            mujoco.mj_contactForce(self.model, self.data, k, force)
            normal = np.array(contact.frame[:3])  # from the first geom to the second
            (a, link_a), (b, link_b) = owners
            if a != name:
                (a, link_a), (b, link_b), normal = (b, link_b), (a, link_a), -normal
            position = np.array(contact.pos)
            found.append(Contact(a, link_a, b, link_b, position, -normal, float(contact.dist), float(force[0])))
        return found

    def _owner(self, geom: int) -> tuple[str, str]:
        """The body or robot of a geom, and the robot's link."""
        name = self.model.body(self.model.geom_bodyid[geom]).name
        if name in self._bodies:
            return name, ""
        robot, _, link = name.partition("/")
        return robot, link

    def _body(self, name: str) -> Body:
        if name not in self._bodies:
            raise InputError(f"no body '{name}' in the world; there are {sorted(self._bodies)}", Code.UNKNOWN_OBJECT)
        return self._bodies[name]
