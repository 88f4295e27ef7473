"""What a plan executor needs of the world: controllers, observation and a clock.

The simulation implements these protocols in ``hmap_core.simulation.ports``, the ROS graph in ``hmap.supervision``.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from hmap_core.exceptions import Code, InputError
from hmap_core.types import JointTrajectory, Robot, Scene, SceneState

Canceled = Callable[[], bool]  # asked while waiting; true ends the waiting and stops the motion


@dataclass(frozen=True)
class Feedback:
    """Where a controller commands its joints to be.

    Attributes:
        arrived: s of the executor's clock.
        stamp: s of the controller's clock.
        positions: (n,) rad, base to tip.
    """

    arrived: float
    stamp: float
    positions: np.ndarray


class Command(Protocol):
    """A command that was sent to a controller."""

    @property
    def done(self) -> bool:
        """Whether it has ended."""

    @property
    def feedback(self) -> Sequence[Feedback]:
        """The first and the newest feedback; empty before the first, and for grippers."""

    @property
    def opening(self) -> float:
        """Opening of a gripper when its command ended, m."""


class ControllerPort(Protocol):
    """The arms and grippers."""

    @property
    def tracking_error(self) -> float:
        """Largest deviation of any joint from its commanded position so far, rad; 0 where it is not known."""

    def move(self, robot: Robot, motion: JointTrajectory, start: float | None = None) -> Command:
        """Send an arm along a trajectory, in place of the one that it follows.

        Args:
            robot: whose arm.
            motion: joint positions over time.
            start: s of the controller's clock from which the times count, those in the past left out; None: now.

        Raises:
            InputError: the trajectory is malformed or starts elsewhere; STALE_STATE, the robot is not measured.
            ExecutionError: SERVICE_UNAVAILABLE, there is no such controller; TRACKING_LOST, the robot is measured
                elsewhere than where the trajectory starts.
        """

    def common_start(self) -> float | None:
        """When motions of several arms that are sent now should begin together, s of the controllers' clock.

        It is late enough for all of them to arrive. None: they begin together when they are sent.
        """

    def grip(self, robot: Robot, opening: float, force: float) -> Command:
        """Send a gripper to an opening (m) with at most ``force`` (N). It keeps pressing when it has ended.

        Raises:
            InputError: the opening is out of range.
            ExecutionError: SERVICE_UNAVAILABLE; there is no such controller.
        """

    def wait(
        self,
        commands: Sequence[Any],
        limit: float,
        canceled: Canceled,
        look: Callable[[], None] | None = None,
    ) -> None:
        """Wait until all commands have ended.

        Args:
            commands: what is waited for, as :meth:`move` and :meth:`grip` of this port returned them.
            limit: s of the executor's clock after which a controller is taken to hang.
            canceled: true stops all commands.
            look: called now and then, and whenever the scene has changed. What it raises ends the waiting, not the
                commands.

        Raises:
            PlannerError: CANCELED; the commands were stopped.
            ExecutionError: TRACKING_LOST, one failed or hangs; CONTROLLER_LOST, one does not answer or does not move;
                STALE_STATE, the world is not measured any more. The others were stopped.
        """

    def stop(self) -> None:
        """Bring all arms to rest and wait for that."""


class ObservationPort(Protocol):
    """What is known of the world."""

    def scene(self) -> Scene | None:
        """The scene with every body that is known now; the same object as long as nothing came, moved or went."""

    def changed(self) -> float:
        """When bodies came, moved otherwise than by themselves, or went for the last time, s of the clock."""

    def wait_for_change(self, since: float, patience: float, canceled: Canceled) -> bool:
        """Wait until the scene has changed after ``since`` (s of the clock), for ``patience`` seconds at most.

        Returns:
            whether it has.
        """

    def state(self) -> SceneState:
        """The newest state; it may be some milliseconds old.

        Raises:
            InputError: STALE_STATE; there is none.
        """

    def settled(self) -> SceneState:
        """The state once everything is at rest, or after as long as one waits for that.

        Raises:
            InputError: STALE_STATE; there is none.
        """

    def live_poses(self) -> Mapping[str, np.ndarray] | None:
        """Body -> its pose (7,) at this very instant; None where poses arrive late."""

    def grasped(self, robot: str, body: str) -> bool | None:
        """Whether every finger of a robot touches a body, after a moment to do so; None without touch sensors."""

    def touched(self, robot: str, body: str) -> bool | None:
        """Whether a finger of a robot touches a body; None without touch sensors."""


class ClockPort(Protocol):
    """The executor's clock."""

    def now(self) -> float:
        """Seconds of a steady clock."""


@dataclass(frozen=True)
class Ports:
    """Everything through which a plan executor acts and sees."""

    controllers: ControllerPort
    observation: ObservationPort
    clock: ClockPort

    def scene(self) -> Scene:
        """The scene with every body that is known now, see :meth:`ObservationPort.scene`.

        Raises:
            InputError: STALE_STATE; there is none yet.
        """
        scene = self.observation.scene()
        if scene is None:
            raise InputError("no scene has been observed yet", Code.STALE_STATE)
        return scene
