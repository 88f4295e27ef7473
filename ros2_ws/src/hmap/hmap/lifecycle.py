"""Managed nodes: ROS 2's lifecycle, whose states an operator or a launch file changes (``ros2 lifecycle set``)."""

from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn

from hmap.node import HmapNode
from hmap_core.exceptions import Code, PlannerError

AUTOSTART = "configure and activate at the start; without it, `ros2 lifecycle set` does both"
UNCONFIGURED, INACTIVE, FINALIZED = "unconfigured", "inactive", "finalized"
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
RCLError = rclpy_implementation.RCLError


class ManagedNode(LifecycleNodeMixin, HmapNode):
    """A node that works while it is active, and answers everything else with SERVICE_UNAVAILABLE and its state.

    Its topics, services and parameters are there in every state, so that tools and other nodes find them. It is active
    from the start unless the parameter ``autostart`` is false.

    Attributes:
        active: whether it works.
    """

    def __init__(self, name: str):
        HmapNode.__init__(self, name)
        LifecycleNodeMixin.__init__(self, callback_group=self.group)
        self._autostarts = bool(self.parameter("autostart", True, AUTOSTART))
        self.active = self._autostarts
        self._answer_transitions()
        if not self._autostarts:
            self._show(UNCONFIGURED)

    def started(self) -> None:
        """Configure and activate, where the parameter says so."""
        super().started()
        if self._autostarts:
            self.trigger_configure()
            self.trigger_activate()

    def require_active(self) -> None:
        """Refuse work in other states.

        Raises:
            PlannerError: SERVICE_UNAVAILABLE.
        """
        if not self.active:
            name = self.get_fully_qualified_name()
            state = self._state_machine.current_state[1]
            remedies = {
                UNCONFIGURED: f"`ros2 lifecycle set {name} configure`, then `activate`",
                FINALIZED: "start it anew",
            }
            remedy = remedies.get(state, f"`ros2 lifecycle set {name} activate`")
            raise PlannerError(f"the node {name} is {state}: {remedy}", Code.SERVICE_UNAVAILABLE)

    # transitions, called by rclpy

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Nothing is left to do: parameters are read when the node is made."""
        if not self.active:
            self._show(INACTIVE)
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to work."""
        self.active = True
        if self._status[1] in (UNCONFIGURED, INACTIVE):
            self.set_status("running")
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """End what is being done, and refuse more."""
        self.active = False
        if not self.settled():
            self.active = True
            return FAILURE
        self._show(INACTIVE)
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Nothing is kept that has to be released."""
        self._show(UNCONFIGURED)
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """As deactivated, for good; the process goes on until it gets a signal."""
        self.active = False
        self.settled()
        self._show(FINALIZED)
        return super().on_shutdown(state)

    def settled(self) -> bool:
        """Wait until what was being done has ended, once the node is not active any more; False: it does not end."""
        return True

    def _show(self, state: str) -> None:
        self.set_status(state, DiagnosticStatus.WARN)

    def _answer_transitions(self) -> None:
        """Answer transitions that the state does not have; rclpy raises, so that who asked would wait for ever."""
        service = self._service_change_state
        change = service.callback

        def answer(request: Any, response: Any) -> Any:
            try:
                return change(request, response)
            except RCLError as error:
                self.get_logger().warning(f"change_state: {' '.join(str(error).split())}")
                response.success = False
                return response

        service.callback = answer
