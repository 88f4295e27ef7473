"""Joint states and motion capture of one scene, combined into one state."""

import threading
from collections import deque
from collections.abc import Mapping

import numpy as np

from hmap_core.exceptions import Code, InputError
from hmap_core.types import BodyKind, Scene, SceneState

POSES_KEPT = 200  # per body, to find its pose at the time of a picture


class Fusion:
    """The newest measurements of one scene. Times are in seconds of the sensors' clock.

    Args:
        scene: the scene.
        arm_joints: robot -> names of its arm's joints in the joint states, base to tip.
        finger_joints: robot -> names of its gripper's joints there; empty without a gripper.
    """

    def __init__(self, scene: Scene, arm_joints: Mapping[str, list[str]], finger_joints: Mapping[str, list[str]]):
        self.scene = scene
        self._arm_joints, self._finger_joints = arm_joints, finger_joints
        self._lock = threading.Lock()
        self._joints: dict[str, tuple[float, float, float]] = {}  # name -> time, position, velocity
        self._poses: dict[str, deque[tuple[float, np.ndarray]]] = {
            name: deque(maxlen=POSES_KEPT) for name, body in scene.bodies.items() if body.kind is not BodyKind.FIXED
        }

    @property
    def tracked(self) -> list[str]:
        """The bodies with measured poses."""
        return list(self._poses)

    def copy_measurements(self, previous: "Fusion") -> None:
        """Copy the measurements of the robots and bodies that both scenes have."""
        with previous._lock, self._lock:
            self._joints |= previous._joints
            for name in self._poses.keys() & previous._poses.keys():
                self._poses[name].extend(previous._poses[name])

    def add_joints(self, time: float, names, positions, velocities) -> None:
        """Add joint states; unknown joints are ignored.

        Args:
            time: s.
            names: of the joints.
            positions: rad or m.
            velocities: rad/s or m/s; empty: zero.

        Raises:
            InputError: the numbers of values differ, or a value is not finite.
        """
        velocities = velocities if len(velocities) else np.zeros(len(positions))
        if not len(names) == len(positions) == len(velocities):
            raise InputError(f"joint states of {len(names)} names with {len(positions)} positions")
        values = np.array([positions, velocities], float)
        if not np.isfinite(values).all():
            bad = names[int(np.argwhere(~np.isfinite(values))[0][1])]
            raise InputError(f"the joint state of {bad!r} is not finite")
        with self._lock:
            for i, name in enumerate(names):
                self._joints[name] = (time, float(values[0, i]), float(values[1, i]))

    def add_pose(self, time: float, body: str, pose: np.ndarray) -> None:
        """Add a measured pose ``T_world_body`` (7,) of a body at a time (s)."""
        with self._lock:
            self._poses[body].append((time, pose))

    def pose_at(self, body: str, time: float) -> np.ndarray | None:
        """T_world_body (7,) from the measurement nearest to a time (s); None before the first measurement."""
        with self._lock:
            measured = list(self._poses.get(body, ()))
        return min(measured, key=lambda entry: abs(entry[0] - time))[1] if measured else None

    def state(self) -> tuple[float, SceneState, dict[str, np.ndarray]]:
        """Combine the newest measurements.

        Returns:
            Time of the oldest measurement used (s), the state of the scene, and robot -> joint velocities (n,).

        Raises:
            InputError: STALE_STATE; a joint or body has not been measured yet.
        """
        with self._lock:
            wanted = [
                name for names in (self._arm_joints, self._finger_joints) for row in names.values() for name in row
            ]
            missing = [name for name in wanted if name not in self._joints]
            missing += [name for name, measured in self._poses.items() if not measured]
            if missing:
                raise InputError(f"not measured yet: {', '.join(missing)}", Code.STALE_STATE)
            times = [self._joints[name][0] for name in wanted] + [m[-1][0] for m in self._poses.values()]
            poses = {name: body.pose for name, body in self.scene.bodies.items()}
            poses |= {name: measured[-1][1] for name, measured in self._poses.items()}
            q = {robot: self._column(names, 1) for robot, names in self._arm_joints.items()}
            qd = {robot: self._column(names, 2) for robot, names in self._arm_joints.items()}
            gripper = {robot: self._opening(robot) for robot in self._arm_joints}
        return min(times, default=0.0), SceneState(q, gripper, poses), qd

    def _column(self, names: list[str], k: int) -> np.ndarray:
        return np.array([self._joints[name][k] for name in names])

    def _opening(self, robot: str) -> float:
        names = self._finger_joints[robot]
        if not names:
            return 0.0
        return self.scene.robots[robot].model.gripper.opening_at(self._column(names, 1))
