"""A robot in MuJoCo: motors that go for positions and velocities, and fingers with a bounded force."""

from typing import Any

import numpy as np

from hmap_core.simulation.settings import RobotSettings
from hmap_core.types import Robot


class MujocoRobot:
    """An arm with a position motor on every joint and, where it has one, a gripper.

    The model is that of :func:`hmap_core.simulation.mjcf.scene_to_mjcf`.
    """

    def __init__(self, model: Any, data: Any, robot: Robot):
        """Put the robot at its configuration, gripper open.

        Args:
            model: MuJoCo's ``MjModel``.
            data: its ``MjData``.
            robot: the robot.
        """
        self._model, self._data, self._robot = model, data, robot
        self._settings = RobotSettings.of(robot.model.name, robot.model.simulation)
        gripper = robot.model.gripper
        self._arm = self._numbers(robot.model.joint_names)
        self._fingers = self._numbers(gripper.joint_names if gripper else ())
        self._coupled = self._following()
        gains = model.actuator_gainprm[self._arm[2], 0]
        self._damping_time = -model.actuator_biasprm[self._arm[2], 2] / gains  # s, damping over stiffness
        self._gains = gains
        self._target = self._setpoint = np.zeros(len(self._fingers[0]))
        self._rates = np.ones(len(self._fingers[0]))
        self._command: tuple[float, float] | None = None
        self.place(robot.q, gripper.open_opening if gripper else 0.0)

    def place(self, q: np.ndarray, opening: float) -> None:
        """Set the robot to a configuration at rest, and command it to stay there.

        Args:
            q: (n,) arm joints, rad or m.
            opening: of the gripper, m.
        """
        self._data.qpos[self._arm[0]], self._data.qvel[self._arm[1]] = q, 0.0
        self.set_joint_targets(np.asarray(q, float), np.zeros(len(q)))
        if len(self._fingers[0]):
            joints = self._finger_positions(opening)
            self._data.qpos[self._fingers[0]], self._data.qvel[self._fingers[1]] = joints, 0.0
            for address, driver, factor, offset in self._coupled:
                self._data.qpos[address] = factor * self._data.qpos[driver] + offset
            self._command, self._setpoint = None, joints
            self.set_gripper(opening, self._settings.finger_force)

    def set_joint_targets(self, q: np.ndarray, qd: np.ndarray, effort: np.ndarray | None = None) -> None:
        """Positions (n,) and velocities (n,) that the motors go for, and efforts (n,) in N m or N beside these."""
        ctrl = q + self._damping_time * qd
        self._data.ctrl[self._arm[2]] = ctrl if effort is None else ctrl + effort / self._gains

    def set_gripper(self, opening: float, force: float) -> None:
        """Gap between the pads (m) that the fingers go for, each pressing with at most ``force`` (N)."""
        if (opening, force) == self._command:
            return
        self._command = opening, force
        gripper = self._robot.model.require_gripper()
        at = self.gripper_state()[0] if gripper.openings else 0.0
        self._rates = np.abs(gripper.joints_per_opening(at))
        self._target = self._finger_positions(opening)
        now = self._data.qpos[self._fingers[0]]
        turned = (self._setpoint - now) * (self._target - now) < 0.0  # the other way: not back along what was pressed
        self._setpoint = np.where(turned, now, self._setpoint)
        limit = force / self._rates / len(self._rates)  # the work of all joints is that of the pads
        self._model.actuator_forcerange[self._fingers[2]] = np.stack([-limit, limit], axis=1)

    def advance(self, dt: float) -> None:
        """Move the fingers' set-points on by a step, no faster than the fingers can be."""
        if len(self._fingers[0]):
            step = self._settings.finger_speed * 2.0 * self._rates * dt  # half of the gap's is each finger's
            self._setpoint = self._setpoint + np.clip(self._target - self._setpoint, -step, step)
            self._data.ctrl[self._fingers[2]] = self._setpoint

    def arm_state(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n,) and velocities (n,) of the arm's joints."""
        return self._data.qpos[self._arm[0]].copy(), self._data.qvel[self._arm[1]].copy()

    def gripper_state(self) -> tuple[float, float, float]:
        """Opening (m), its velocity (m/s) and the force of the pads (N) by the motors; zeros without a gripper."""
        if not len(self._fingers[0]):
            return 0.0, 0.0, 0.0
        gripper = self._robot.model.require_gripper()
        opening = gripper.opening_at(self._data.qpos[self._fingers[0]].tolist())
        slopes = np.array(gripper.joints_per_opening(opening))
        velocity = float(np.mean(self._data.qvel[self._fingers[1]] / slopes))
        return opening, velocity, float(self._data.actuator_force[self._fingers[2]] @ slopes)

    def _numbers(self, names) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Addresses of joints in positions and in velocities, and the numbers of their motors: (n,) each."""
        found = [(self._joint(name), self._model.actuator(f"{self._robot.name}/{name}").id) for name in names]
        addresses = [(joint.qposadr[0], joint.dofadr[0], motor) for joint, motor in found]
        columns = np.array(addresses, int).reshape(-1, 3).T
        return columns[0], columns[1], columns[2]

    def _joint(self, name: str) -> Any:
        return self._model.joint(f"{self._robot.name}/{name}")

    def _following(self) -> list[tuple[int, int, float, float]]:
        """Joints that follow the fingers' by an equality: addresses of both, factor and offset."""
        found = []
        own = set(self._fingers[0].tolist())
        for k in range(self._model.neq):
            pair = self._model.eq_obj1id[k], self._model.eq_obj2id[k]
            joint, driver = (self._model.jnt_qposadr[number] for number in pair)
            if driver in own and joint not in own:
                offset, factor = self._model.eq_data[k][:2]
                found.append((int(joint), int(driver), float(factor), float(offset)))
        return found

    def _finger_positions(self, opening: float) -> np.ndarray:
        """Where the finger joints (k,) are at an opening (m), within their limits."""
        gripper = self._robot.model.require_gripper()
        joints = np.array(gripper.joints(opening), float)
        ranges = np.array([self._joint(name).range for name in gripper.joint_names])
        limited = ranges[:, 0] < ranges[:, 1]
        return np.where(limited, np.clip(joints, ranges[:, 0], ranges[:, 1]), joints)
