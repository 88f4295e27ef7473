"""Joint states and motion capture of one scene, combined into one state."""

import threading
from collections.abc import Mapping, Sequence

import numpy as np

from hmap.perception.jumps import JumpFilter
from hmap.perception.pose_filter import POSE_NOISE, WINDOW, filtered
from hmap_core.exceptions import Code, InputError
from hmap_core.types import BodyKind, Scene, SceneState
from hmap_msgs_py.checks import joint_readings, poses
from hmap_msgs_py.measurements import Latest, ReceiverClock

POSES_KEPT = 200  # per body, to find its pose at the time of a picture


class Fusion:
    """The newest measurements of one scene. Times are in seconds of the sensors' clock.

    Args:
        scene: the scene.
        arm_joints: robot -> names of its arm's joints in the joint states, base to tip.
        finger_joints: robot -> names of its gripper's joints there; empty without a gripper.
        clock: judges the stamps; None: they are only compared with each other.
        noise: m, standard deviation of a measured position, see :mod:`hmap.perception.pose_filter`.
    """

    def __init__(
        self,
        scene: Scene,
        arm_joints: Mapping[str, list[str]],
        finger_joints: Mapping[str, list[str]],
        clock: ReceiverClock | None = None,
        noise: float = POSE_NOISE,
    ):
        self.scene, self._noise = scene, noise
        self._arm_joints, self._finger_joints = arm_joints, finger_joints
        self._lock = threading.Lock()
        self._clock = clock or ReceiverClock()
        joints = [name for rows in (arm_joints, finger_joints) for row in rows.values() for name in row]
        self._joints: dict[str, Latest[tuple[float, float]]] = {  # name -> position, velocity
            name: Latest(f"the state of joint {name!r}", self._clock) for name in joints
        }
        self._jumps: dict[str, JumpFilter] = {}
        self._restarts = self._clock.restarts
        self._poses: dict[str, Latest[np.ndarray]] = {
            name: Latest(f"the pose of {name!r}", self._clock, POSES_KEPT)
            for name, body in scene.bodies.items()
            if body.kind is not BodyKind.FIXED
        }

    @property
    def tracked(self) -> list[str]:
        """The bodies with measured poses."""
        return list(self._poses)

    def copy_measurements(self, previous: "Fusion") -> None:
        """Copy the measurements of the robots and bodies that both scenes have."""
        with previous._lock, self._lock:
            for joint in self._joints.keys() & previous._joints.keys():
                self._joints[joint].copy_from(previous._joints[joint])
            for body in self._poses.keys() & previous._poses.keys():
                self._poses[body].copy_from(previous._poses[body])

    def add_joints(
        self, time: float, names: Sequence[str], positions: Sequence[float], velocities: Sequence[float] = ()
    ) -> list[str]:
        """Add joint states, field by field; joints that are not of this scene's robots are ignored.

        Args:
            time: s.
            names: of the joints.
            positions: rad or m.
            velocities: rad/s or m/s; empty: zero. A velocity that is wrong counts as zero.

        Returns:
            What is wrong with values that were left out, while others were used.

        Raises:
            InputError: no joint can be used, though joints of this scene are named.
            StampError: the stamp cannot be right.
        """
        readings = joint_readings(names, positions, velocities, self._joints)
        problems = [*readings.refused, *readings.ignored]
        if readings.values:
            self._clock.check("the joint state", time)
        with self._lock:
            for name, value in readings.values.items():
                self._joints[name].add_checked(time, value)
        if readings.refused and not readings.values:
            raise InputError("; ".join(problems))
        return problems

    def add_pose(self, time: float, body: str, pose: np.ndarray) -> None:
        """Add a measured pose ``T_world_body`` (7,) of a body at a time (s).

        Raises:
            PoseError: the pose is not finite, or its quaternion is not normalised.
            StampError: the stamp cannot be right.
            InputError: STALE_STATE; the pose has jumped, see :mod:`hmap.perception.jumps`.
        """
        T = poses(f"the pose of {body!r}", [pose], 1)[0]
        T = np.concatenate([T[:3], T[3:] / np.linalg.norm(T[3:])])  # float32 senders are off by 1e-7
        self._clock.check(f"the pose of {body!r}", time)
        with self._lock:
            if body not in self._poses:  # it has left the scene
                return
            if self._restarts != self._clock.restarts:  # what was measured before is dropped
                self._restarts, self._jumps = self._clock.restarts, {}
            jumps = self._jumps.setdefault(body, JumpFilter())
            used = jumps.accept(body, time, T)
            if used:
                self._poses[body].add_checked(time, T)
        if not used and jumps.doubt is not None:
            raise InputError(jumps.doubt.text, Code.STALE_STATE)

    def pose_at(self, body: str, time: float) -> np.ndarray | None:
        """T_world_body (7,) from the measurement nearest to a time (s); None before the first measurement."""
        with self._lock:
            return self._poses[body].nearest(time) if body in self._poses else None

    def state(self) -> tuple[float, SceneState, dict[str, np.ndarray]]:
        """Combine the newest measurements.

        Returns:
            Time of the oldest measurement used (s), the state of the scene, and robot -> joint velocities (n,).

        Raises:
            InputError: STALE_STATE; a joint or body has not been measured yet, or has just jumped.
        """
        time, _, state, velocities = self._combined()
        return time, state, velocities

    def oldest(self) -> tuple[float, str]:
        """Time (s) and name of the oldest measurement that :meth:`state` uses.

        Raises:
            InputError: STALE_STATE; a joint or body has not been measured yet.
        """
        return self._combined()[:2]

    def _combined(self) -> tuple[float, str, SceneState, dict[str, np.ndarray]]:
        self._clock.now()
        with self._lock:
            joints = {name: keeper.newest() for name, keeper in self._joints.items()}
            tracked = {name: keeper.newest() for name, keeper in self._poses.items()}
            doubts = [jumps.doubt.text for jumps in self._jumps.values() if jumps.doubt is not None]
            recent = {name: keeper.within(WINDOW) for name, keeper in self._poses.items()}
        missing = [name for measured in (joints, tracked) for name, entry in measured.items() if entry is None]
        if doubts:
            raise InputError("; ".join(doubts), Code.STALE_STATE)
        if missing:
            raise InputError(f"not measured yet: {', '.join(missing)}", Code.STALE_STATE)
        times = [(entry[0], f"joint {name!r}") for name, entry in joints.items() if entry is not None]
        times += [(entry[0], f"body {name!r}") for name, entry in tracked.items() if entry is not None]
        time, name = min(times, default=(0.0, "nothing"))
        placed = {name: body.pose for name, body in self.scene.bodies.items()}
        placed |= {name: filtered(poses, self._noise) for name, poses in recent.items()}
        values = {name: entry[1] for name, entry in joints.items() if entry is not None}
        q = {robot: _column(values, names, 0) for robot, names in self._arm_joints.items()}
        qd = {robot: _column(values, names, 1) for robot, names in self._arm_joints.items()}
        gripper = {robot: self._opening(robot, values) for robot in self._arm_joints}
        return time, name, SceneState(q, gripper, placed), qd

    def _opening(self, robot: str, values: Mapping[str, tuple[float, float]]) -> float:
        names = self._finger_joints[robot]
        if not names:
            return 0.0
        gripper = self.scene.robots[robot].model.gripper
        return 0.0 if gripper is None else gripper.opening_at(_column(values, names, 0).tolist())


def _column(values: Mapping[str, tuple[float, float]], names: Sequence[str], k: int) -> np.ndarray:
    return np.array([values[name][k] for name in names])
