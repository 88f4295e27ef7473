"""What an execution needs of a physics engine; PyBullet's world and MuJoCo's both have it."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from hmap_core.simulation.world import Contact
from hmap_core.types import Body, Scene, SceneState


class PhysicsRobot(Protocol):
    """An arm with motors and, where it has one, a gripper."""

    def arm_state(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n,) and velocities (n,) of the arm's joints."""

    def gripper_state(self) -> tuple[float, float, float]:
        """Opening (m), its velocity (m/s) and the force of the pads (N); zeros without a gripper."""

    def set_joint_targets(self, q: np.ndarray, qd: np.ndarray, effort: np.ndarray | None = None) -> None:
        """Positions (n,) and velocities (n,) that the motors go for, and efforts (n,) in N m or N to press with."""

    def set_gripper(self, opening: float, force: float) -> None:
        """Gap between the pads (m) that the fingers go for, each pressing with at most ``force`` (N)."""


class PhysicsWorld(Protocol):
    """A scene under dynamics.

    Attributes:
        scene: as robots and planner know it.
    """

    scene: Scene

    @property
    def time(self) -> float:
        """Simulated seconds since the world was made."""

    def step(self) -> None:
        """Let a time step pass."""

    def close(self) -> None:
        """Free the engine; the world cannot be used afterwards."""

    def robot(self, name: str) -> PhysicsRobot:
        """The robot of that name."""

    def body_names(self) -> Sequence[str]:
        """Names of all bodies at present."""

    def body(self, name: str) -> Body:
        """The body as described, at its present pose."""

    def body_pose(self, name: str) -> np.ndarray:
        """``T_world_body`` (7,)."""

    def body_velocity(self, name: str) -> np.ndarray:
        """Velocity of the body's origin (m/s), angular velocity (rad/s): (6,), world axes."""

    def state(self) -> SceneState:
        """Where everything is now."""

    def contacts(self, name: str) -> Sequence[Contact]:
        """Contacts of a body or robot at the last step."""
