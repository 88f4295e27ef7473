"""A client of the graph for Python programs, in the manner of nav2's ``BasicNavigator``. See ``docs/python.md``."""

import os
import threading
import time
from collections.abc import Callable, Collection, Sequence
from pathlib import Path
from typing import Any, Self, cast

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Pose
from numpy.typing import ArrayLike
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.context import Context
from rclpy.exceptions import NameValidationException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from hmap.action_client import ActionClient
from hmap.conversions import scene_from_message, scene_to_message, state_from_message
from hmap.environment import ros_environment
from hmap.heartbeats import Heartbeat
from hmap.manipulation_goal import Feedback, GoalInProgress, Result
from hmap.node import FEEDBACK, LATCHED
from hmap.requests import error_from_message
from hmap.spinning import MessageExecutor, Spinner
from hmap_core.exceptions import Code, InputError, PlannerError
from hmap_core.types import Body, Scene, SceneState
from hmap_msgs.action import Manipulate
from hmap_msgs.msg import ErrorCode, PlannerStatus, WorldState
from hmap_msgs.msg import Scene as SceneMessage
from hmap_msgs.srv import AddBody, LoadScene, MoveBody, RemoveBody, Reset
from hmap_msgs_py.bodies import body_to_message
from hmap_msgs_py.checks import ConversionError
from hmap_msgs_py.measurements import Latest
from hmap_msgs_py.poses import pose_to_message
from hmap_msgs_py.times import seconds_from_message

READY_LIMIT = 60.0  # s to wait for the nodes
ANSWER_LIMIT = 30.0  # s to wait for the answer of a service
STATE_LIMIT = 10.0  # s to wait for a world state
STALE_AFTER = 2.0  # s; a world state that arrived longer ago is not handed out
CANCEL_LIMIT = 10.0  # s for a canceled goal to end when the session is closed
SERVICES = {  # node -> the service by which it is known to be ready
    "world": "get_scene",
    "waypoint_planner": "plan_waypoints",
    "contact_proposer": "propose_contacts",
    "komo_optimiser": "solve_segment",
}
PLANNING_NODES = ("supervisor", "perception", "waypoint_planner", "contact_proposer", "komo_optimiser")
BAD_ARGUMENTS = (
    rclpy_implementation.RCLError,
    rclpy_implementation.UnknownROSArgsError,
    NameValidationException,
)


class Session:
    """A connection to the graph, best used as a context.

    Goals do not block: :meth:`manipulate` and :meth:`plan` return at once, :meth:`is_done`, :meth:`feedback` and
    :meth:`result` tell of the newest one. What fails raises, or is in the result as, an
    :class:`~hmap_core.exceptions.HmapError` with a stage, a code and a reason.

    Example:
        ::

            with Session() as hmap:
                hmap.wait_until_ready()
                hmap.manipulate(task="tunnel", seed=1)
                while not hmap.is_done(timeout=1.0):
                    print(hmap.feedback())
                result = hmap.result().check()
    """

    def __init__(
        self,
        node: Node | None = None,
        *,
        name: str = "hmap_session",
        namespace: str = "",
        args: Sequence[str] | None = None,
    ):
        """
        Args:
            node: a node of the program, which spins it in another thread than the one that waits here; by default the
                session has a node, an executor and a context of its own.
            name, namespace: of its own node.
            args: ROS arguments of its own node, such as ``["--ros-args", "-r", "__ns:=/cell"]``; those of the command
                line by default.

        Raises:
            InputError: wrong ROS arguments.
        """
        self._context: Context | None = None
        self._spinner: Spinner | None = None
        self._news = threading.Condition()
        self._scene: SceneMessage | None = None
        self._states: Latest[WorldState] = Latest("the world state")
        self._arrived = -float("inf")  # when the newest state did, s of the steady clock
        self._goal: GoalInProgress | None = None
        self.node: Node = self._own_node(name, namespace, args) if node is None else node
        self._group = ReentrantCallbackGroup()
        self._services: dict[str, Client] = {}
        self._client = ActionClient(
            self.node, Manipulate, "manipulate", callback_group=self._group, feedback_sub_qos_profile=FEEDBACK
        )
        self._supervisor = Heartbeat(self.node, "supervisor", self._group)
        topics = (
            (SceneMessage, "scene", self._take_scene, LATCHED),
            (WorldState, "world_state", self._take_state, 1),
            (PlannerStatus, "planner_status", self._notify, LATCHED),  # with diagnostics: nodes come and go
            (DiagnosticArray, "diagnostics", self._notify, 10),
        )
        self._subscriptions = [self.node.create_subscription(*topic, callback_group=self._group) for topic in topics]
        if self._context is not None:
            executor = MessageExecutor(context=self._context)
            executor.add_node(self.node)
            self._spinner = Spinner(executor, lambda error: self.node.get_logger().error(repr(error)))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Cancel the goal where it is not done, and let go of the graph; a node that was given stays."""
        goal = self._goal
        if goal is not None and not goal.done:
            goal.cancel()
            if self.node.executor is not None:
                self._wait(lambda: self._ended(goal), CANCEL_LIMIT)
        if self._spinner is not None:
            self._spinner.stop()
        self._client.destroy()
        for client in self._services.values():
            self.node.destroy_client(client)
        for subscription in (*self._subscriptions, self._supervisor.subscription):
            self.node.destroy_subscription(subscription)
        if self._context is not None:
            self.node.destroy_node()
            rclpy.shutdown(context=self._context, uninstall_handlers=False)

    # the graph

    def ready(self, nodes: Collection[str] = PLANNING_NODES) -> list[str]:
        """Those of the nodes that are ready for work."""
        services = {name for name, _ in self.node.get_service_names_and_types()}
        names = set(self.node.get_node_names())
        found = {"perception": self._state() is not None, "supervisor": self._client.server_is_ready()}
        found |= {node: self.node.resolve_service_name(service) in services for node, service in SERVICES.items()}
        return [name for name in nodes if found.get(name, name in names)]

    def wait_until_ready(self, timeout: float = READY_LIMIT, nodes: Collection[str] = PLANNING_NODES) -> None:
        """Wait until a goal can be given.

        Args:
            timeout: s.
            nodes: that are needed.

        Raises:
            PlannerError: SERVICE_UNAVAILABLE; names the nodes that are not ready in time.
        """
        if not self._wait(lambda: len(self.ready(nodes)) == len(nodes), timeout):
            up = self.ready(nodes)
            missing = ", ".join(name for name in nodes if name not in up)
            raise PlannerError(f"not ready after {timeout:g} s: {missing}", Code.SERVICE_UNAVAILABLE)

    # the world

    def scene(self, timeout: float = STATE_LIMIT) -> Scene:
        """The loaded scene, with the bodies that were added.

        Raises:
            PlannerError: SERVICE_UNAVAILABLE; no node has told of one within ``timeout`` seconds.
        """
        if not self._wait(lambda: self._scene is not None, timeout):
            raise PlannerError(
                f"no scene within {timeout:g} s: is a world or perception running?", Code.SERVICE_UNAVAILABLE
            )
        return scene_from_message(self._scene)

    def world_state(self, timeout: float = STATE_LIMIT) -> SceneState:
        """Where everything of :meth:`scene` is now.

        Raises:
            InputError: STALE_STATE; there is no fresh one within ``timeout`` seconds.
        """
        self.scene(timeout)
        if not self._wait(self._has_fresh_state, timeout):
            raise InputError(
                f"no fresh world state within {timeout:g} s: is perception running, and do its sensors speak?",
                Code.STALE_STATE,
            )
        return state_from_message(scene_from_message(self._scene), self._state())

    def load_scene(self, task: str | Path | Scene, seed: int = 0, timeout: float = ANSWER_LIMIT) -> Scene:
        """Load a scene in place of the current one, and wait until everything of it is seen.

        Args:
            task: a task's name, the path of a task file, or a scene, such as a
                :class:`~hmap_core.scenes.SceneBuilder` makes.
            seed: of the task's randomisation; a scene has its own.
            timeout: s.

        Raises:
            InputError: UNKNOWN_TASK, INVALID_SCENE and what else is wrong with the task; STALE_STATE as
                :meth:`world_state`.
            PlannerError: SERVICE_UNAVAILABLE, TIME_LIMIT.
        """
        if isinstance(task, Scene):
            text = scene_to_message(task)
            request = LoadScene.Request(task=text.task, seed=text.seed, text=text.text)
        else:
            request = LoadScene.Request(task=_task_name(task), seed=_count("seed", seed))
        response = self._call(LoadScene, "load_scene", request, timeout)
        loaded = (response.scene.task, response.scene.seed)
        with self._news:
            self._scene = response.scene
            self._states.clear()

        def is_of_it() -> bool:
            state = self._state()
            return state is not None and (state.task, state.seed) == loaded

        if not self._wait(is_of_it, timeout):
            raise InputError(f"no world state of {loaded[0]!r} within {timeout:g} s", Code.STALE_STATE)
        return scene_from_message(response.scene)

    def reset(self, timeout: float = ANSWER_LIMIT) -> None:
        """Put everything back to the start of the loaded scene; added bodies go, and the state is forgotten.

        Raises:
            PlannerError: SERVICE_UNAVAILABLE, TIME_LIMIT.
        """
        self._call(Reset, "reset", Reset.Request(), timeout)
        with self._news:
            self._states.clear()

    def add_body(self, body: Body, timeout: float = ANSWER_LIMIT) -> None:
        """Add a body to the loaded scene.

        Raises:
            InputError: it is malformed, or its name is taken.
            PlannerError: SERVICE_UNAVAILABLE, TIME_LIMIT.
        """
        try:
            message = body_to_message(body)
        except ConversionError as error:
            raise InputError(str(error), Code.INVALID_SCENE) from error
        self._call(AddBody, "add_body", AddBody.Request(body=message), timeout)

    def move_body(self, name: str, pose: ArrayLike, timeout: float = ANSWER_LIMIT) -> None:
        """Move a body that was added, or a movable one that nothing holds.

        Args:
            pose: (7,) T_world_body.
            timeout: s.

        Raises:
            InputError: UNKNOWN_OBJECT, INVALID_POSE, or the body is fixed.
            PlannerError: SERVICE_UNAVAILABLE, TIME_LIMIT.
        """
        self._call(MoveBody, "move_body", MoveBody.Request(name=name, pose=_pose(pose)), timeout)

    def remove_body(self, name: str, timeout: float = ANSWER_LIMIT) -> None:
        """Remove a body from the loaded scene.

        Raises:
            InputError: UNKNOWN_OBJECT.
            PlannerError: SERVICE_UNAVAILABLE, TIME_LIMIT.
        """
        self._call(RemoveBody, "remove_body", RemoveBody.Request(name=name), timeout)

    # goals

    def manipulate(
        self,
        task: str | Path = "",
        *,
        object: str = "",
        pose: ArrayLike | None = None,
        position_tolerance: float = 0.0,
        rotation_tolerance: float = 0.0,
        seed: int = 0,
        plan_only: bool = False,
        time_limit: float = 0.0,
        on_feedback: Callable[[Feedback], None] | None = None,
    ) -> None:
        """Give a goal, and return at once. It takes the place of the one before.

        Args:
            task: a task's name or file, loaded where it is not what is loaded already; empty: the loaded scene.
            object: to bring to ``pose``; empty: the goal of the task.
            pose: (7,) T_world_object.
            position_tolerance, rotation_tolerance: m, rad; 0: the task's.
            seed: of the task and of the planner.
            plan_only: do not execute the plan.
            time_limit: s for planning; 0: the supervisor's own.
            on_feedback: called with every feedback, from the thread that spins the node; must not wait.

        Raises:
            InputError: an argument is wrong by itself; anything else is told by the result.
            PlannerError: SERVICE_UNAVAILABLE; there is no supervisor. :meth:`wait_until_ready` waits for it.
        """
        if bool(object) != (pose is not None):
            raise InputError("object and pose go together: give both, or neither for the goal of the task")
        message = Manipulate.Goal(
            task=_task_name(task) if task else "",
            object=object,
            position_tolerance=float(position_tolerance),
            rotation_tolerance=float(rotation_tolerance),
            seed=_count("seed", seed),
            plan_only=bool(plan_only),
            time_limit=float(time_limit),
        )
        if pose is not None:
            message.pose = _pose(pose)
        if not self._client.server_is_ready():
            raise PlannerError("there is no supervisor; wait_until_ready() waits for it", Code.SERVICE_UNAVAILABLE)
        self._goal = GoalInProgress(self._client, message, self._notify, on_feedback)

    def plan(self, task: str | Path = "", **options: Any) -> None:
        """Give a goal that is only planned, and return at once; options and errors as of :meth:`manipulate`."""
        self.manipulate(task, plan_only=True, **options)

    def is_done(self, timeout: float = 0.0) -> bool:
        """Whether the goal has ended; waits up to ``timeout`` seconds for that."""
        goal = self._current()
        return self._wait(lambda: self._ended(goal), timeout)

    def feedback(self) -> Feedback | None:
        """The newest feedback of the goal; None before the first."""
        return self._current().feedback

    def result(self, timeout: float | None = None) -> Result:
        """How the goal ended; waits for that.

        Args:
            timeout: s; None: as long as it takes.

        Raises:
            InputError: no goal was given.
            PlannerError: TIME_LIMIT; it has not ended in time. It goes on.
        """
        goal = self._current()
        if not self._wait(lambda: self._ended(goal), timeout):
            raise PlannerError(f"the goal has not ended within {timeout:g} s", Code.TIME_LIMIT)
        return goal.result()

    def cancel(self) -> None:
        """Ask for the end of the goal, and return at once; its result then tells CANCELED, once the robots stand."""
        self._current().cancel()

    # inside

    def _own_node(self, name: str, namespace: str, args: Sequence[str] | None) -> Node:
        os.environ.update(ros_environment())
        self._context = Context()
        try:
            rclpy.init(
                args=None if args is None else list(args),
                context=self._context,
                signal_handler_options=SignalHandlerOptions.NO,
            )
            return Node(name, context=self._context, namespace=namespace)
        except BAD_ARGUMENTS as error:
            self._context.try_shutdown()
            raise InputError(f"ROS arguments: {' '.join(str(error).split())}") from error

    def _take_scene(self, message: SceneMessage) -> None:
        with self._news:
            self._scene = message
            self._news.notify_all()

    def _take_state(self, message: WorldState) -> None:
        now = time.monotonic()
        with self._news:
            if now - self._arrived > STALE_AFTER:  # a simulation that was started anew begins with older stamps
                self._states.clear()
            if self._states.add(seconds_from_message(message.header.stamp), message):
                self._arrived = now
                self._news.notify_all()

    def _state(self) -> WorldState | None:
        """The world state with the newest stamp."""
        newest = self._states.newest()
        return None if newest is None else newest[1]

    def _notify(self, *_: Any) -> None:
        with self._news:
            self._news.notify_all()

    def _wait(self, ready: Callable[[], bool], timeout: float | None) -> bool:
        """Whether something is so, asked again at every message of the graph, within ``timeout`` seconds."""
        if self.node.executor is None and timeout != 0.0:
            raise PlannerError(
                f"the node {self.node.get_name()!r} is in no executor; spin it in another thread",
                Code.SERVICE_UNAVAILABLE,
            )
        with self._news:
            return self._news.wait_for(ready, timeout)

    def _has_fresh_state(self) -> bool:
        state, scene = self._state(), scene_from_message(self._scene)
        return (
            state is not None
            and time.monotonic() - self._arrived <= STALE_AFTER
            and {body.name for body in state.bodies} == set(scene.bodies)
        )

    def _current(self) -> GoalInProgress:
        if self._goal is None:
            raise InputError("no goal was given yet: call manipulate() or plan()")
        return self._goal

    def _ended(self, goal: GoalInProgress) -> bool:
        if not goal.done:
            goal.check(self._client.server_is_ready(), self._supervisor.lost)
        return goal.done

    def _call(self, service_type: type, name: str, request: Any, timeout: float) -> Any:
        """The response of a service.

        Raises:
            PlannerError: SERVICE_UNAVAILABLE, TIME_LIMIT.
            HmapError: of the stage and code that the response names.
        """
        if name not in self._services:
            self._services[name] = self.node.create_client(service_type, name, callback_group=self._group)
        client = self._services[name]
        if not self._wait(client.service_is_ready, timeout):
            raise PlannerError(f"no node offers the service {name!r}", Code.SERVICE_UNAVAILABLE)
        future = client.call_async(request)
        future.add_done_callback(self._notify)
        if not self._wait(future.done, timeout):
            client.remove_pending_request(future)
            raise PlannerError(f"the service {name!r} did not answer within {timeout:g} s", Code.TIME_LIMIT)
        response = future.result()
        if response.error.code != ErrorCode.SUCCESS:
            raise error_from_message(response.error)
        return response


def _task_name(task: str | Path) -> str:
    """A task as another process understands it: a file by its absolute path."""
    if str(task).endswith((".yaml", ".yml")):
        return str(Path(task).expanduser().absolute())
    return str(task)


def _count(name: str, value: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 0:
        raise InputError(f"{name} = {value!r}: must be an integer, 0 or larger")
    return int(value)


def _pose(value: ArrayLike) -> Pose:
    """A pose (7,) as a message.

    Raises:
        InputError: INVALID_POSE.
    """
    try:
        return pose_to_message(cast(np.ndarray, value), "pose")  # which checks it
    except ConversionError as error:
        raise InputError(str(error), Code.INVALID_POSE) from error
