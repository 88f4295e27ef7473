"""Pressing with a force: a simulated arm yields until what it presses on pushes back as it is told to.

Motors of simulated joints go for positions, however much that takes. A hand that presses is led by its contact force
instead (admittance control: Siciliano et al., "Robotics: Modelling, Planning and Control", 2009, section 9.3): it moves
along the direction of the force with a speed proportional to what is missing to it.
"""

from functools import cached_property

import numpy as np

from hmap_core.kinematics.arm import Arm, load_arm
from hmap_core.simulation.client import BulletClient
from hmap_core.simulation.settings import TIME_STEP, RobotSettings
from hmap_core.transforms import rotation_matrix
from hmap_core.types import Robot

GAIN = 0.06  # share of the missing force that is made up in a step
FASTEST = 0.01  # m/s that the hand yields or advances
FARTHEST = 0.005  # m off its path
RELEASE = 0.9  # share of the distance from the path that is left after a step without a force
# of the fingers while they press, as of rubber: what is dragged rattles by some 0.1 mm, and stiff fingers jump then
SOFT_STIFFNESS = 3e4  # N/m
SOFT_DAMPING = 3e2  # N s/m
LEAST_FORCE = 1e-3  # N; less counts as no force


class Compliance:
    """How far a hand is off its path, because of the force with which it presses."""

    def __init__(self, client: BulletClient, robot: Robot, identifier: int, joints: list[int], fingers: list[int]):
        """
        Args:
            client: the physics server.
            robot: the robot, placed in the world.
            identifier: of its body in the server.
            joints: numbers of the arm's joints.
            fingers: numbers of the finger links, which press; none: any link.
        """
        self._client, self._id, self._joints, self._fingers = client, identifier, joints, fingers
        self._model, self._R_base = robot.model, rotation_matrix(robot.base_pose)
        self._settings = RobotSettings.of(robot.model.name, robot.model.simulation)
        self._soft = False
        self._off = np.zeros(3)  # m, of the end-effector, base frame
        self._before = 0.0  # N, pressed in the last step; contact forces alternate between steps

    @cached_property
    def _arm(self) -> Arm:
        return load_arm(self._model)

    def step(self, effort: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """Advance by a step.

        Args:
            effort: (n,) N m or N beside those that follow the motion; None: none.

        Returns:
            Offsets (n,) of the joints' positions, rad or m, and of their velocities.
        """
        if (effort is None or not np.any(effort)) and not self._off.any():
            self._soften(False)
            return np.zeros(len(self._joints)), np.zeros(len(self._joints))
        self._soften(True)
        q = np.array([state[0] for state in self._client.getJointStates(self._id, self._joints)])
        jacobian = self._arm.tip_jacobian(q)
        before = self._off
        self._off = self._moved(jacobian, np.zeros(len(q)) if effort is None else effort)
        if np.linalg.norm(self._off) < 1e-7:
            self._off = np.zeros(3)
        R, p = self._arm.frames(q)
        whole = np.linalg.pinv(np.concatenate([jacobian, self._turning(R)]))[:, :3]
        return whole @ self._off, whole @ (self._off - before) / TIME_STEP

    def _soften(self, soft: bool) -> None:
        if soft == self._soft:
            return
        self._soft, own = soft, self._settings
        stiffness, damping = (SOFT_STIFFNESS, SOFT_DAMPING) if soft else (own.finger_stiffness, own.finger_damping)
        for link in self._fingers:
            self._client.changeDynamics(self._id, link, contactStiffness=stiffness, contactDamping=damping)

    def _turning(self, R: np.ndarray) -> np.ndarray:
        return np.where((self._arm.prismatic == 0)[:, None], R[1:, :, 2], 0.0).T

    def _moved(self, jacobian: np.ndarray, effort: np.ndarray) -> np.ndarray:
        """The distance (3,) from the path after a step, base frame, m."""
        wanted = np.linalg.pinv(jacobian.T) @ effort
        size = float(np.linalg.norm(wanted))
        if size < LEAST_FORCE:
            return self._off * RELEASE
        way = wanted / size
        pressed = self._pressed(self._R_base @ way)
        missing, self._before = size - 0.5 * (pressed + self._before), pressed
        step = np.clip(GAIN * missing / SOFT_STIFFNESS, -FASTEST * TIME_STEP, FASTEST * TIME_STEP)
        return np.clip(self._off @ way + step, -FARTHEST, FARTHEST) * way

    def _pressed(self, way: np.ndarray) -> float:
        """Force (N) along a direction (3,) of the world with which the fingers press on other bodies."""
        total = 0.0
        for link in self._fingers:
            for contact in self._client.getContactPoints(bodyA=self._id, linkIndexA=link):
                if contact[2] != self._id:
                    total -= contact[9] * float(np.dot(contact[7], way))
        return total
