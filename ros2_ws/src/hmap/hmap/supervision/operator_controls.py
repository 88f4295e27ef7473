"""What an operator does while robots work: pause, resume, stop, confirm, and scale their speed."""

import threading
from collections.abc import Callable

from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from hmap.node import HmapNode
from hmap_core.exceptions import Code, InputError, PlannerError
from hmap_core.execution.pace import Pace

POLL = 0.2  # s between looks while a confirmation is waited for
SPEED, ACCELERATION = "speed_scaling", "acceleration_scaling"


class OperatorControls:
    """The services and topics with which an operator paces and ends motions, and allows the first one.

    Attributes:
        pace: of all motions.
        dry_run: whether nothing may ever move.
        stops: how often it was asked to stop so far.
    """

    def __init__(self, node: HmapNode, has_goal: Callable[[], bool], on_change: Callable[[], None]):
        """
        Args:
            node: that offers them; its parameters are declared.
            has_goal: whether a goal is being worked on.
            on_change: called after every change.

        Raises:
            InputError: a parameter is out of its range.
        """
        self._node, self._has_goal, self._on_change = node, has_goal, on_change
        text = "of planned speeds, in (0, 1]; the topic of this name changes it"
        speed = node.parameter(SPEED, 1.0, text, 0.0, 1.0)
        text = "of planned accelerations and of those in which arms brake, in (0, 1]; the topic of this name changes it"
        self.pace = Pace(speed, node.parameter(ACCELERATION, 1.0, text, 0.0, 1.0))
        self.dry_run = node.parameter("dry_run", False, "plan and show, but never move anything")
        text = "wait for the service ~/confirm before the first motion of each goal; for hardware"
        self._confirm_first = node.parameter("confirm_motion", False, text)
        self.stops = 0
        self._waits, self._confirmed = threading.Event(), threading.Event()
        self.pace.on_change(on_change)
        node.subscribe(Float64, SPEED, lambda message: self.pace.set_speed(message.data))
        node.subscribe(Float64, ACCELERATION, lambda message: self.pace.set_acceleration(message.data))
        for name, handler in (
            ("pause", self._pause),
            ("resume", self._resume),
            ("stop", self._stop),
            ("confirm", self._confirm),
        ):
            self._serve(name, handler)

    def state(self) -> dict[str, str | float]:
        """What holds now, by name, for people."""
        values: dict[str, str | float] = {SPEED: self.pace.speed, ACCELERATION: self.pace.acceleration}
        return values | {"paused": str(self.pace.paused).lower(), "dry_run": str(self.dry_run).lower()}

    def wait_for_confirmation(self, canceled: Callable[[], bool], tell: Callable[[str], None]) -> None:
        """Wait for an operator's confirmation, where the parameter asks for one.

        Args:
            canceled: ends the waiting.
            tell: called with what is waited for.

        Raises:
            PlannerError: CANCELED.
        """
        if not self._confirm_first:
            return
        self._confirmed.clear()
        self._waits.set()
        tell(f"waiting for the service {self._node.get_name()}/confirm before anything moves")
        try:
            while not self._confirmed.wait(POLL):
                if canceled():
                    raise PlannerError("canceled before the motion was confirmed", Code.CANCELED)
        finally:
            self._waits.clear()

    def _serve(self, name: str, handler: Callable[[], str]) -> None:
        def answer(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                response.message, response.success = handler(), True
            except InputError as error:
                response.message, response.success = error.reason, False
            self._node.get_logger().info(f"{name}: {response.message}")
            return response

        self._node.create_service(Trigger, f"~/{name}", answer, callback_group=self._node.group)

    def _pause(self) -> str:
        if self.pace.paused:
            return "it is paused already"
        self.pace.pause()
        return "arms come to rest along their paths, and stay there until ~/resume"

    def _resume(self) -> str:
        if not self.pace.paused:
            raise InputError("nothing is paused")
        self.pace.resume()
        return "motions go on"

    def _stop(self) -> str:
        if not self._has_goal():
            raise InputError("no goal is being worked on; nothing moves")
        self.stops += 1
        self._on_change()
        return "arms come to rest, and the goal ends as canceled"

    def _confirm(self) -> str:
        if not self._waits.is_set():
            raise InputError("no motion waits for a confirmation")
        self._confirmed.set()
        return "motions begin"
