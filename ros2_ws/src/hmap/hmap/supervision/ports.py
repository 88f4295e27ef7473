"""The ports of a plan executor over the ROS graph: the scene monitor as observation, and the steady clock."""

import time

from hmap.supervision.controllers import Controllers
from hmap.supervision.scene_monitor import SceneMonitor
from hmap_core.execution.ports import Canceled, Ports
from hmap_core.types import Scene, SceneState


class RosObservation:
    """What the scene monitor knows; poses arrive late, and there are no touch sensors."""

    def __init__(self, scene_monitor: SceneMonitor, patience: float):
        """
        Args:
            scene_monitor: listens to the topics.
            patience: s to wait for a world state.
        """
        self._scene_monitor, self._patience = scene_monitor, patience

    def scene(self) -> Scene | None:
        """The scene with every body that is known now."""
        return self._scene_monitor.scene()

    def changed(self) -> float:
        """When the scene changed last, s of the steady clock."""
        return self._scene_monitor.changed()

    def wait_for_change(self, since: float, patience: float, canceled: Canceled) -> bool:
        """Whether the scene changes after ``since`` (s of the steady clock), within ``patience`` seconds."""
        return self._scene_monitor.wait_for_change(since, patience, canceled)

    def state(self) -> SceneState:
        """The newest state.

        Raises:
            InputError: STALE_STATE.
        """
        return self._scene_monitor.state(self._patience)[1]

    def settled(self) -> SceneState:
        """Where everything is once it stands.

        Raises:
            InputError: STALE_STATE.
        """
        return self._scene_monitor.settled(self._patience)

    def live_poses(self) -> None:
        """None: poses arrive late."""

    def grasped(self, robot: str, body: str) -> None:
        """None: there are no touch sensors."""

    def touched(self, robot: str, body: str) -> None:
        """None: there are no touch sensors."""


class SteadyClock:
    """The steady clock of this machine."""

    def now(self) -> float:
        """Seconds."""
        return time.monotonic()


def ros_ports(controllers: Controllers, scene_monitor: SceneMonitor, patience: float) -> Ports:
    """The ports of a plan executor in the ROS graph.

    Args:
        controllers: the actions of arms and grippers.
        scene_monitor: what is known of the world.
        patience: s to wait for a world state.
    """
    return Ports(controllers, RosObservation(scene_monitor, patience), SteadyClock())
