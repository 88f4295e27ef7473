"""A robot in the physics server: its URDF, position-controlled joints, and fingers with realistic contact."""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pybullet

from hmap_core import transforms
from hmap_core.exceptions import InputError
from hmap_core.kinematics.urdf import load_urdf
from hmap_core.scenes.robot_rules import simulated_urdf
from hmap_core.simulation.client import BulletClient
from hmap_core.simulation.compliance import Compliance
from hmap_core.simulation.finger_pads import with_pads
from hmap_core.simulation.settings import RENEWAL, RobotSettings
from hmap_core.types import Robot

# Bullet's defaults for what moves; setting them, even to what they are, makes it forget the contacts of a link
COLLISION_GROUP, COLLISION_MASK = 1, -1


@dataclass(frozen=True)
class JointStates:
    """Measured joints of a robot: the arm's, base to tip, then the fingers'.

    Attributes:
        names: m joint names, as in the URDF.
        positions: (m,) rad or m.
        velocities: (m,) rad/s or m/s.
        efforts: (m,) N m or N that the motors apply.
    """

    names: tuple[str, ...]
    positions: np.ndarray
    velocities: np.ndarray
    efforts: np.ndarray


class SimulatedRobot:
    """An arm with position control on every joint and, where it has one, a gripper."""

    def __init__(self, client: BulletClient, robot: Robot):
        """Load the robot at its base and put it at its configuration, gripper open.

        Raises:
            InputError: PyBullet cannot load the URDF, or a joint or link that the model names is not in it.
        """
        self.robot = robot
        self.model = robot.model
        self.settings = RobotSettings.of(self.model.name, self.model.simulation)
        self._client = client
        self.id = self._load()
        self._read_names()
        self._arm = [self._joint(name) for name in self.model.joint_names]
        self._ee_link = self._link(self.model.end_effector_link)
        gripper = self.model.gripper
        self._fingers = [self._joint(name) for name in gripper.joint_names] if gripper else []
        self._mimics = self._find_mimics()
        self.finger_links = [self._link(name) for name in gripper.finger_links] if gripper else []
        self._arm_forces = self._forces()
        self._prepare_fingers()
        self._gripper_command: tuple = ()
        self._compliance = Compliance(client, robot, self.id, self._arm, self.finger_links)
        self._contacts_turn: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)  # of the hand when contacts were last renewed
        self.place(robot.q, gripper.open_opening if gripper else 0.0)

    def place(self, q: np.ndarray, opening: float) -> None:
        """Set the robot to a configuration at rest, and command it to stay there.

        Args:
            q: (n,) arm joints, rad or m.
            opening: of the gripper, m.

        Raises:
            InputError: q has a wrong length or a value that is not finite.
        """
        if np.shape(q) != (len(self._arm),) or not np.isfinite(q).all():
            raise InputError(f"robot '{self.robot.name}': a configuration has {len(self._arm)} finite values, not {q}")
        for joint, value in zip(self._arm, q, strict=True):
            self._client.resetJointState(self.id, joint, float(value), 0.0)
        if self._fingers:
            positions = self._finger_positions(opening)
            for joint, value in zip(self._fingers, positions, strict=True):
                self._client.resetJointState(self.id, joint, value, 0.0)
            for joint, driver, factor, offset in self._mimics:
                self._client.resetJointState(self.id, joint, factor * positions[driver] + offset, 0.0)
        self.set_joint_targets(q, np.zeros(len(self._arm)))
        if self._fingers:
            self.set_gripper(opening, self.settings.finger_force)

    def set_joint_targets(self, q: np.ndarray, qd: np.ndarray, effort: np.ndarray | None = None) -> None:
        """Positions (n,) and velocities (n,) that the joint motors go for until told otherwise.

        With efforts (n,) in N m or N the hand yields until what it presses on pushes back with their force.
        """
        offset, rate = self._compliance.step(effort)
        q, qd = q + offset, qd + rate
        self._client.setJointMotorControlArray(
            self.id,
            self._arm,
            pybullet.POSITION_CONTROL,
            targetPositions=np.asarray(q, float).tolist(),
            targetVelocities=np.asarray(qd, float).tolist(),
            forces=self._arm_forces,
            positionGains=[self.settings.position_gain] * len(self._arm),
            velocityGains=[self.settings.velocity_gain] * len(self._arm),
        )

    def set_gripper(self, opening: float, force: float) -> None:
        """Gap between the pads (m) that the fingers go for, each pressing with at most ``force`` (N).

        Raises:
            InputError: the robot has no gripper, or a value is not finite.
        """
        if not self._fingers:
            raise InputError(f"robot '{self.robot.name}' has no gripper to open to {opening} m")
        if not (np.isfinite(opening) and np.isfinite(force)):
            raise InputError(f"robot '{self.robot.name}': gripper opening {opening} m, force {force} N: not finite")
        rates = tuple(map(abs, self._slopes()))
        command = (opening, force, rates)
        if command == self._gripper_command:
            return  # the motors keep their targets
        self._gripper_command = command
        for joint, target, rate in zip(self._fingers, self._finger_positions(opening), rates, strict=True):
            self._client.setJointMotorControl2(
                self.id,
                joint,
                pybullet.POSITION_CONTROL,
                targetPosition=target,
                force=force / rate / len(self._fingers),  # the work of all joints is that of the pads
                maxVelocity=self.settings.finger_speed * 2.0 * rate,  # half of the gap's is each finger's
            )

    def renew_contacts(self) -> None:
        """Have the fingers' contacts found anew once the hand has turned by RENEWAL; to be called before every step.

        A contact that sticks is anchored where it was made, without which what is held would fall behind the hand on
        its arc, and Bullet keeps the direction of its normal in the world with it, however the hand turns meanwhile.
        """
        if not self.finger_links:
            return
        turn = self._client.getLinkState(self.id, self._ee_link, computeForwardKinematics=1)[1]
        if abs(np.dot(turn, self._contacts_turn)) < np.cos(0.5 * RENEWAL):
            self._contacts_turn = turn
            for link in self.finger_links:
                self._client.setCollisionFilterGroupMask(self.id, link, COLLISION_GROUP, COLLISION_MASK)

    def joint_states(self) -> JointStates:
        """What the joint sensors say."""
        states = self._client.getJointStates(self.id, [*self._arm, *self._fingers])
        names = self.model.joint_names + (self.model.gripper.joint_names if self.model.gripper else ())
        positions, velocities, _, efforts = zip(*states, strict=True)
        return JointStates(tuple(names), np.array(positions), np.array(velocities), np.array(efforts))

    def arm_state(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n,) and velocities (n,) of the arm's joints."""
        states = self._client.getJointStates(self.id, self._arm)
        return np.array([s[0] for s in states]), np.array([s[1] for s in states])

    def gripper_state(self) -> tuple[float, float, float]:
        """Opening (m), its velocity (m/s) and the force of the pads (N) by the motors; zeros without a gripper."""
        if not self._fingers:
            return 0.0, 0.0, 0.0
        states = self._client.getJointStates(self.id, self._fingers)
        opening = self.model.require_gripper().opening_at([state[0] for state in states])
        slopes = self.model.require_gripper().joints_per_opening(opening)
        velocity = sum(state[1] / slope for state, slope in zip(states, slopes, strict=True)) / len(states)
        effort = sum(state[3] * slope for state, slope in zip(states, slopes, strict=True))
        return opening, float(velocity), float(effort)

    def end_effector_pose(self) -> np.ndarray:
        """``T_world_ee`` (7,)."""
        state = self._client.getLinkState(self.id, self._ee_link, computeForwardKinematics=1)
        return transforms.multiply(np.array([*state[4], *state[5]]), self.model.T_link_ee)

    def link_name(self, index: int) -> str:
        """Name of a link by PyBullet's index (-1: the base)."""
        return self._link_names[index]

    def _load(self) -> int:
        base = self.robot.base_pose
        try:
            with tempfile.TemporaryDirectory(prefix="hmap_urdf_") as folder:
                urdf = with_pads(replace(self.model, urdf=simulated_urdf(self.model)), Path(folder))
                return self._client.loadURDF(str(urdf), base[:3].tolist(), base[3:].tolist(), useFixedBase=True)
        except pybullet.error as error:
            raise InputError(f"robot '{self.robot.name}': PyBullet cannot load {self.model.urdf}: {error}") from error

    def _read_names(self) -> None:
        infos = [self._client.getJointInfo(self.id, i) for i in range(self._client.getNumJoints(self.id))]
        self._joint_indices = {info[1].decode(): info[0] for info in infos if info[2] != pybullet.JOINT_FIXED}
        self._limits = {info[0]: (info[8], info[9]) for info in infos}
        self._efforts = {info[0]: info[10] for info in infos}
        self._link_names = {-1: self._client.getBodyInfo(self.id)[0].decode()}
        self._link_names |= {info[0]: info[12].decode() for info in infos}

    def _joint(self, name: str) -> int:
        if name not in self._joint_indices:
            raise InputError(f"{self.model.urdf} has no joint '{name}'; its joints are {list(self._joint_indices)}")
        return self._joint_indices[name]

    def _link(self, name: str) -> int:
        for index, link in self._link_names.items():
            if link == name:
                return index
        raise InputError(f"{self.model.urdf} has no link '{name}'; its links are {list(self._link_names.values())}")

    def _forces(self) -> list[float]:
        forces = self.settings.joint_forces
        if forces is None:
            return [self._efforts[joint] for joint in self._arm]
        if len(forces) != len(self._arm):
            raise InputError(f"robot model {self.model.name}: {len(forces)} joint_forces for {len(self._arm)} joints")
        return list(forces)

    def _prepare_fingers(self) -> None:
        s, gripper = self.settings, self.model.gripper
        for link in self.finger_links:
            self._client.changeDynamics(
                self.id,
                link,
                lateralFriction=s.finger_friction,
                spinningFriction=s.finger_spinning_friction,
                rollingFriction=s.finger_rolling_friction,
                contactStiffness=s.finger_stiffness,
                contactDamping=s.finger_damping,
                frictionAnchor=1,
            )
        if gripper is None:
            return
        if gripper.openings:
            self._weigh_linkage()
        for joint, driver, factor, offset in self._mimics:
            self._client.setJointMotorControl2(self.id, joint, pybullet.VELOCITY_CONTROL, force=0.0)
            self._couple(self._fingers[driver], joint, factor, offset)
        # without it the object pushes one finger open while the other closes
        start, slope = (np.broadcast_to(v, len(self._fingers)) for v in (gripper.at_zero, gripper.per_joint))
        for k in range(1, len(self._fingers)):
            factor = slope[k] / slope[0]
            self._couple(self._fingers[0], self._fingers[k], factor, start[k] - factor * start[0])

    def _weigh_linkage(self) -> None:
        """Give the links of a linkage the inertia that the solver needs to keep it together under load."""
        for joint in (*self._fingers, *(joint for joint, *_ in self._mimics)):
            own = self._client.getDynamicsInfo(self.id, joint)[2]
            heavier = [max(value, self.settings.linkage_inertia) for value in own]
            self._client.changeDynamics(self.id, joint, localInertiaDiagonal=heavier)

    def _couple(self, driver: int, joint: int, factor: float, offset: float) -> None:
        """Keep a joint at ``factor`` (not 0) times another one, and ``offset``."""
        gear = self._client.createConstraint(
            self.id, driver, self.id, joint, pybullet.JOINT_GEAR, [1, 0, 0], [0] * 3, [0] * 3
        )
        self._client.changeConstraint(
            gear,
            gearRatio=-1.0 / factor,
            relativePositionTarget=-offset / factor,
            erp=self.settings.finger_gear_erp,
            maxForce=self.settings.finger_gear_force,
        )

    def _find_mimics(self) -> list[tuple[int, int, float, float]]:
        """Joints that mimic one of the fingers': the joint, the finger's number, factor and offset."""
        gripper = self.model.gripper
        if gripper is None:
            return []
        tree = load_urdf(self.model.urdf).tree
        return [
            (self._joint(name), number, factor, offset)
            for number, driver in enumerate(gripper.joint_names)
            for name, (factor, offset) in tree.mimics(driver).items()
            if name not in gripper.joint_names and factor != 0.0
        ]

    def _slopes(self) -> tuple[float, ...]:
        """How much the finger joints (k,) move for each metre of opening where they are now."""
        gripper = self.model.require_gripper()
        return gripper.joints_per_opening(self.gripper_state()[0] if gripper.openings else 0.0)

    def _finger_positions(self, opening: float) -> list[float]:
        """Where the finger joints (k,) are at an opening (m), within their limits."""
        positions = []
        for joint, value in zip(self._fingers, self.model.require_gripper().joints(opening), strict=True):
            lower, upper = self._limits[joint]
            positions.append(min(max(value, lower), upper) if lower < upper else value)
        return positions
