"""The base class of all nodes: declared parameters, diagnostics, responses with errors, and a clean shutdown."""

import gc
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import TYPE_CHECKING, Any, Protocol

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException, ParameterException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from hmap.environment import LAUNCHER, ros_environment
from hmap.heartbeats import offer_heartbeat
from hmap.problem_log import ProblemLog
from hmap.spinning import MessageExecutor, Spinner, WorkExecutor, clock_executor
from hmap_core.compile_cache import ensure_compiled
from hmap_core.exceptions import HmapError
from hmap_core.garbage import collect_rarely
from hmap_msgs_py.checks import ConversionError
from hmap_msgs_py.errors import error_to_message

if TYPE_CHECKING:
    from hmap.warm_up import WarmUp

THREADS = 12  # per process; some callbacks wait for a response or for the end of a motion
DIAGNOSTICS_PERIOD = 1.0  # s
RETRY_PERIOD = 0.1  # s of waiting after an error that reached the executor
LOOK_PERIOD = 1.0  # s between two looks at whether the launcher lives and the nodes can go on
RCLError, UnknownROSArgsError = rclpy_implementation.RCLError, rclpy_implementation.UnknownROSArgsError
YES, NO, BAD_INPUT = 0, 1, 2  # exit codes
WARM_UP = "plan a small task while waiting, so that the first request is as fast as later ones"
STARTING = "starting"  # the first status

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
FEEDBACK = QoSProfile(depth=200)  # of ``manipulate``: a plan is told in bursts, and a busy client reads them late


def clock_time(node: Node) -> float | None:
    """The time of a node's clock in s; None while ``use_sim_time`` is set and no time has come on /clock."""
    return node.get_clock().now().nanoseconds * 1e-9 or None


class HmapNode(Node):
    """A node whose callbacks run concurrently in the reentrant group :attr:`group`.

    Attributes:
        waits: whether callbacks can wait for each other. A node without such callbacks runs them one by one, at a third
            of the cost.
        plans: whether it runs compiled code, which is compiled before the node starts.
        group: of all callbacks.
        problems: what is wrong with messages, named once per cause.
        stopping: set at the shutdown.
        failure: why the node cannot go on; its process ends with it. None while it can.
        spinner: spins the executor; None before the start.
    """

    waits = True
    plans = False

    def __init__(self, name: str):
        super().__init__(name)
        self.group = ReentrantCallbackGroup()
        self.problems = ProblemLog(
            lambda text: self.get_logger().warning(text),
            lambda text: self.get_logger().info(text),
        )
        self._errors = ProblemLog(
            lambda text: self.get_logger().error(text),
            lambda text: self.get_logger().info(text),
        )
        self.stopping = threading.Event()
        self.failure: HmapError | None = None
        self.spinner: Spinner | None = None
        self._clock_spinner: Spinner | None = None
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._status: tuple[bytes, str, dict[str, Any]] = (DiagnosticStatus.OK, STARTING, {})
        self._diagnostics = self.create_publisher(DiagnosticArray, "diagnostics", 10)
        self._heartbeat = offer_heartbeat(self, name)
        self._warm_up: WarmUp | None = None
        self._warms_up = self.plans and self.parameter("warm_up", False, WARM_UP)
        self.every(DIAGNOSTICS_PERIOD, self._publish_diagnostics)

    def start_spinning(self) -> None:
        """Run callbacks in threads from now on."""
        clock = clock_executor(self)
        if clock is not None:
            self._clock_spinner = Spinner(clock, self.callback_failed)
        executor = WorkExecutor(THREADS) if self.waits else MessageExecutor()
        executor.add_node(self)
        self.spinner = Spinner(executor, self.callback_failed)

    def stop_spinning(self) -> None:
        """Wait for running callbacks, and run no more."""
        for spinner in (self.spinner, self._clock_spinner):
            if spinner is not None:
                spinner.stop()

    def started(self) -> None:
        """Set the status "running", unless the node has set another one."""
        if self._status[1] == STARTING:
            self.set_status("running")
        if self._warms_up:
            from hmap.warm_up import WarmUp  # imports the planner, which some nodes do not need

            self._warm_up = WarmUp(self.get_logger().info)

    def undisturbed(self, limit: float) -> AbstractContextManager:
        """Pause the callbacks during a context, at most ``limit`` seconds, so that a computation ends earlier."""
        return nullcontext() if self.spinner is None else self.spinner.paused(limit)

    def close(self) -> None:
        """Release waiting callbacks; called before the shutdown of the executor."""
        self.stopping.set()
        if self._warm_up is not None:
            self._warm_up.end(wait=True)

    def needed(self) -> None:
        """End the warm-up: there is work to do."""
        if self._warm_up is not None:
            self._warm_up.end()

    def require_active(self) -> None:
        """Raise where the node does not work at the moment; see :mod:`hmap.lifecycle`."""

    def parameter(
        self, name: str, default: Any, description: str, low: float | None = None, high: float | None = None
    ) -> Any:
        """Declare a read-only parameter.

        Args:
            name: of the parameter.
            default: its value unless it is set.
            description: for users.
            low: smallest value of a number.
            high: largest value of a number.

        Returns:
            The value.
        """
        descriptor = ParameterDescriptor(description=description, read_only=True)
        if low is not None and high is not None:
            if isinstance(default, float):
                descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
            else:
                descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
        return self.declare_parameter(name, default, descriptor).value

    def every(self, period: float, callback: Callable[[], None]) -> None:
        """Call a function every ``period`` seconds of real time, independently of the simulated clock."""
        self.create_timer(period, self.guarded(callback), callback_group=self.group, clock=self._steady)

    def now(self) -> float | None:
        """The time of the node's clock in s; None while ``use_sim_time`` is set and no time has come on /clock."""
        return clock_time(self)

    def guarded(self, callback: Callable[..., Iterable[str] | None], source: str = "") -> Callable:
        """Wrap a callback so that its errors are logged; the content of a message must not stop the node.

        Errors are logged once per cause, and so are the problems that the callback returns.

        Args:
            callback: raises what is wrong with a message, or returns what is wrong with parts that it does not need.
            source: of the calls, such as a topic; default: the callback's name.
        """
        label = source or getattr(callback, "__name__", type(callback).__name__).strip("_")
        key = source or id(callback)

        def safe(*arguments) -> None:
            problems, errors = None, []
            try:
                problems = callback(*arguments)
            except (HmapError, ConversionError) as error:
                problems = [str(error)]
            except Exception as error:
                errors = [f"{error!r}\n{traceback.format_exc()}"]
            self.problems.update(key, problems or (), label)
            if not (errors and self.stopping.is_set()):
                self._errors.update(key, errors, label)

        return safe

    def subscribe(self, message_type: type, topic: str, callback: Callable, qos: QoSProfile | int = 10, **options):
        """Subscribe with a guarded callback.

        Args:
            message_type: of the topic.
            topic: its name.
            callback: called with each message; can return what is wrong with parts that it does not need.
            qos: quality of service, or the depth of the queue.
            options: further arguments of rclpy.

        Returns:
            The subscription.
        """
        return self.create_subscription(
            message_type, topic, self.guarded(callback, topic), qos, callback_group=self.group, **options
        )

    def serve(self, service_type: Any, name: str, handler: Callable[[Any, Any], None]):
        """Offer a service.

        Args:
            service_type: of the service.
            name: its name.
            handler: fills the response. Its exceptions become the response's error.

        Returns:
            The service.
        """

        def answer(request, response):
            began = time.monotonic()
            self.needed()
            try:
                self.require_active()
                handler(request, response)
            except Exception as error:
                response = service_type.Response()  # discards a partly filled response
                response.error = error_to_message(error)
                self.report_error(name, error)
            if hasattr(response, "planning_time"):
                response.planning_time = time.monotonic() - began
            return response

        return self.create_service(service_type, name, answer, callback_group=self.group)

    def set_status(self, text: str, level: bytes = DiagnosticStatus.OK, **values: Any) -> None:
        """Set the node's status on ``diagnostics``."""
        self._status = (level, text, values)

    def report_error(self, name: str, error: Exception) -> None:
        """Log an error that a response carries; unexpected errors with their trace."""
        if isinstance(error, HmapError | ConversionError):
            self.get_logger().info(f"{name}: {error}")
        else:
            self.get_logger().error(f"{name}: {''.join(traceback.format_exception(error))}")

    def callback_failed(self, error: Exception) -> None:
        """Log the exception of an unguarded callback, and wait a moment, because it can be raised again at once."""
        if not self.stopping.is_set():
            self.get_logger().error(f"{''.join(traceback.format_exception(error))}")
            self.stopping.wait(RETRY_PERIOD)

    def _publish_diagnostics(self) -> None:
        level, text, values = self._status
        problems = self.problems.active()
        if problems:
            level, values = max(level, DiagnosticStatus.WARN), values | {"problems": "; ".join(problems)}
        status = DiagnosticStatus(
            level=level,
            name=self.get_fully_qualified_name(),
            message=text,
            values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
        )
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)


class NodeClass(Protocol):
    """What :func:`run` needs of a class of nodes."""

    plans: bool

    def __call__(self) -> HmapNode: ...


def run(make_node: NodeClass, args: list[str] | None = None) -> int:
    """Run a node until SIGINT or SIGTERM, or until its launcher has died.

    Args:
        make_node: the class of the node.
        args: ROS arguments; default: those of the process.

    Returns:
        The exit code.
    """
    return run_nodes(lambda: [make_node()], make_node.plans, args)


def run_nodes(make_nodes: Callable[[], Sequence[HmapNode]], plans: bool, args: list[str] | None = None) -> int:
    """Run nodes in this process until SIGINT or SIGTERM, until the launcher has died, or until a node cannot go on.

    Each node has its own executor.

    rclpy's own signal handlers would shut the context down while callbacks run. Here the order is: callbacks, executor,
    node, context.

    Args:
        make_nodes: makes the nodes; an executor looks at all entities of its nodes whenever one of them has news.
        plans: whether they run compiled code, which is compiled before they start.
        args: ROS arguments; default: those of the process.

    Returns:
        The exit code.
    """
    collect_rarely()
    if plans:
        ensure_compiled(lambda text: print(text, file=sys.stderr, flush=True))
    os.environ.update(ros_environment())
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except (RCLError, UnknownROSArgsError) as error:  # a missing parameter file, a malformed remapping
        print("ROS arguments:", *str(error).split(), file=sys.stderr)
        return BAD_INPUT
    try:
        nodes = make_nodes()
    except (HmapError, ParameterException, InvalidParameterTypeException, InvalidParameterValueException) as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        rclpy.shutdown()
        return BAD_INPUT
    except Exception:
        traceback.print_exc()
        rclpy.shutdown()
        return NO
    for node in nodes:
        node.start_spinning()
    for node in nodes:
        node.started()
    while not stop.wait(LOOK_PERIOD) and not launcher_died() and not any(node.failure for node in nodes):
        pass
    failures = [node.failure for node in nodes if node.failure is not None]
    for node in nodes:
        node.close()
    for node in nodes:
        node.stop_spinning()
    for node in nodes:
        node.destroy_node()
    del nodes, node
    gc.collect()  # what refers to itself would keep the middleware's participant, and its shared memory, to the end
    rclpy.shutdown()
    for failure in failures:
        print(failure, file=sys.stderr)
    return BAD_INPUT if failures else YES


def launcher_died() -> bool:
    """Whether this process was started by a launcher that does not live any more, so that nobody would end it."""
    launcher = os.environ.get(LAUNCHER)
    return launcher is not None and os.getppid() != int(launcher)
