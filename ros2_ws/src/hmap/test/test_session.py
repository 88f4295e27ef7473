"""The client of the graph, against nodes that only answer what they are told to."""

import os
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future

from hmap.conversions import body_from_message, plan_to_message, scene_from_message, scene_to_message, state_to_message
from hmap.manipulation_goal import GoalInProgress
from hmap.node import LATCHED
from hmap.session import Session
from hmap.spinning import Spinner
from hmap_core.exceptions import Code, ContactError, ExecutionError, InputError, PlannerError
from hmap_core.scenes import SceneBuilder, load_scene
from hmap_core.types import Plan, Segment, SegmentKind, Trajectory
from hmap_msgs.action import Manipulate
from hmap_msgs.msg import PlannerStatus, WorldState
from hmap_msgs.msg import Scene as SceneMessage
from hmap_msgs.srv import AddBody, LoadScene, MoveBody, RemoveBody, Reset
from hmap_msgs_py.errors import error_to_message
from hmap_msgs_py.poses import pose_from_message

FIRST_DOMAIN, DOMAINS = 20, 90  # ROS_DOMAIN_ID; each process of tests takes its own
LONG = 60.0  # s; a test that waits so long has failed
STATE_PERIOD = 0.05  # s
NAMESPACE = "/cell"


class FakeGraph(Node):
    """Stands in for supervisor, world and perception.

    Attributes:
        answers: what the next goals end with: an error, or None for success. "wait" waits for a cancel.
        goals: that were given.
    """

    def __init__(self, context: Context):
        super().__init__("supervisor", context=context, namespace=NAMESPACE)
        group = ReentrantCallbackGroup()
        self.scene, self.answers, self.goals, self.moved = load_scene("bolt", 0), [], [], {}
        self._scenes = self.create_publisher(SceneMessage, "scene", LATCHED)
        self._states = self.create_publisher(WorldState, "world_state", 10)
        self._scenes.publish(scene_to_message(self.scene))
        self.create_timer(STATE_PERIOD, self._publish_state, callback_group=group)
        services = {
            LoadScene: ("load_scene", self._load),
            AddBody: ("add_body", self._add),
            MoveBody: ("move_body", self._move),
            RemoveBody: ("remove_body", self._remove),
            Reset: ("reset", lambda request: None),
        }
        for kind, (name, handler) in services.items():
            self.create_service(kind, name, self._answering(handler), callback_group=group)
        self.server = ActionServer(
            self,
            Manipulate,
            "manipulate",
            self._execute,
            callback_group=group,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def destroy_node(self) -> None:
        self.server.destroy()
        super().destroy_node()

    def _publish_state(self) -> None:
        state = self.scene.start_state()
        state.poses |= self.moved
        self._states.publish(state_to_message(self.scene, state))

    def _answering(self, handler):
        def answer(request, response):
            try:
                handler(request)
            except InputError as error:
                response.error = error_to_message(error)
            if hasattr(response, "scene"):
                response.scene = scene_to_message(self.scene)
            return response

        return answer

    def _load(self, request) -> None:
        message = SceneMessage(text=request.text)
        self.scene = scene_from_message(message) if request.text else load_scene(request.task, request.seed)
        self._scenes.publish(scene_to_message(self.scene))

    def _change(self, bodies) -> None:
        self.scene = replace(self.scene, bodies=bodies)
        self._scenes.publish(scene_to_message(self.scene))

    def _add(self, request) -> None:
        body = body_from_message(request.body)
        self._change(self.scene.bodies | {body.name: body})

    def _remove(self, request) -> None:
        if request.name not in self.scene.bodies:
            raise InputError(f"no body {request.name!r}", Code.UNKNOWN_OBJECT)
        self._change({name: body for name, body in self.scene.bodies.items() if name != request.name})

    def _move(self, request) -> None:
        self.moved[request.name] = pose_from_message(request.pose)

    def _execute(self, handle) -> Manipulate.Result:
        self.goals.append(handle.request)
        answer = self.answers.pop(0) if self.answers else None
        status = PlannerStatus(phase="contacts", waypoint=1, waypoint_count=3, attempt=2, elapsed=0.5, text="busy")
        handle.publish_feedback(Manipulate.Feedback(status=status))
        until = time.monotonic() + LONG
        while answer == "wait" and time.monotonic() < until:
            if handle.is_cancel_requested:
                answer = PlannerError("canceled", Code.CANCELED)
            time.sleep(0.01)
        answer = None if answer == "wait" else answer
        result = Manipulate.Result(success=answer is None, error=error_to_message(answer), position_error=0.001)
        if answer is None:
            result.plan = plan_to_message(still(self.scene))
            result.executed = not handle.request.plan_only
            handle.succeed()
        else:
            handle.canceled() if answer.code is Code.CANCELED else handle.abort()
        return result


def still(scene) -> Plan:
    """A plan in which nothing moves."""
    time, robot = np.array([0.0, 1.0]), next(iter(scene.robots))
    state = scene.start_state()
    trajectory = Trajectory(
        time,
        {name: np.tile(q, (2, 1)) for name, q in state.q.items()},
        {name: np.full(2, opening) for name, opening in state.gripper.items()},
        {scene.goal.object: np.tile(state.poses[scene.goal.object], (2, 1))},
    )
    segment = Segment(0.0, 1.0, robot, "hand", None, SegmentKind.TRANSIT)
    return Plan(scene, trajectory, (segment,), scene.goal.pose[None], {"contact_tries": 4})


@pytest.fixture(scope="module", autouse=True)
def domain():
    before = os.environ.get("ROS_DOMAIN_ID")
    os.environ["ROS_DOMAIN_ID"] = str(FIRST_DOMAIN + os.getpid() % DOMAINS)
    yield
    del os.environ["ROS_DOMAIN_ID"]
    if before is not None:
        os.environ["ROS_DOMAIN_ID"] = before


def spinning(make):
    """A node in a context and an executor of its own; to be driven by ``yield from``."""
    context = Context()
    context.init()
    node = make(context)
    executor = MultiThreadedExecutor(context=context)
    executor.add_node(node)
    errors: list[Exception] = []
    spinner = Spinner(executor, errors.append)
    yield node
    spinner.stop()
    node.destroy_node()
    context.try_shutdown()
    assert not errors


@pytest.fixture
def graph():
    yield from spinning(FakeGraph)


@pytest.fixture
def session(graph):
    with Session(namespace=NAMESPACE) as session:
        session.wait_until_ready(LONG, ["supervisor", "perception"])
        yield session


def test_a_goal_does_not_block_and_its_result_is_typed(graph, session) -> None:
    graph.answers = ["wait", None]
    seen = []
    session.manipulate("bolt", seed=3, time_limit=7.0, on_feedback=seen.append)
    assert not session.is_done()
    assert session._wait(lambda: session.feedback() is not None, LONG)
    feedback = session.feedback()
    assert (feedback.phase, feedback.waypoint, feedback.waypoints, feedback.attempt) == ("contacts", 1, 3, 2)
    assert feedback.text == "busy" and seen == [feedback]
    with pytest.raises(PlannerError) as error:
        session.result(timeout=0.05)
    assert error.value.code is Code.TIME_LIMIT
    session.cancel()
    assert session.result(LONG).error.code is Code.CANCELED

    session.manipulate()
    result = session.result(LONG).check()
    assert session.is_done() and result.success and result.executed and result.position_error == 0.001
    assert result.plan.segments[0].kind is SegmentKind.TRANSIT and result.plan.stats["contact_tries"] == 4
    first, second = graph.goals
    assert (first.task, first.seed, first.time_limit, first.plan_only) == ("bolt", 3, 7.0, False)
    assert (second.task, second.object) == ("", "")


def test_a_goal_is_passed_on_as_it_is_given(graph, session, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    pose = np.array([0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0])
    session.plan("mine.yaml", object="bolt", pose=pose, position_tolerance=0.01, rotation_tolerance=0.2)
    assert not session.result(LONG).executed
    (goal,) = graph.goals
    assert goal.plan_only and goal.task == str(tmp_path / "mine.yaml") and goal.object == "bolt"
    assert (goal.position_tolerance, goal.rotation_tolerance) == (0.01, 0.2)
    np.testing.assert_array_equal(pose_from_message(goal.pose), pose)


@pytest.mark.parametrize(
    "error",
    [
        InputError("no such task", Code.UNKNOWN_TASK),
        ContactError("none in reach", Code.OUT_OF_REACH),
        ExecutionError("dropped", Code.OBJECT_DROPPED),
    ],
)
def test_a_failure_is_the_error_it_was(graph, session, error) -> None:
    graph.answers = [error]
    session.manipulate()
    result = session.result(LONG)
    assert not result.success and result.plan is None and type(result.error) is type(error)
    assert (result.error.stage, result.error.code, result.error.reason) == (error.stage, error.code, error.reason)
    with pytest.raises(type(error)):
        result.check()


def test_what_is_wrong_with_a_goal_by_itself_is_told_at_once(graph, session) -> None:
    with pytest.raises(InputError, match="no goal was given"):
        session.result()
    for options, code in (
        ({"object": "bolt"}, Code.INVALID_INPUT),
        ({"pose": np.zeros(7)}, Code.INVALID_INPUT),
        ({"object": "bolt", "pose": np.zeros(7)}, Code.INVALID_POSE),
        ({"object": "bolt", "pose": [0.0, 0.0, np.nan, 0, 0, 0, 1]}, Code.INVALID_POSE),
        ({"object": "bolt", "pose": [0.0, 0.0]}, Code.INVALID_POSE),
        ({"seed": -1}, Code.INVALID_INPUT),
        ({"seed": 0.5}, Code.INVALID_INPUT),
    ):
        with pytest.raises(InputError) as error:
            session.manipulate(**options)
        assert error.value.code is code, options
    assert not graph.goals


def test_the_world_is_seen_and_changed(graph, session) -> None:
    assert session.scene().task == "bolt"
    moved = np.array([0.3, 0.1, 0.5, 0.0, 0.0, 0.0, 1.0])
    session.move_body("bolt", moved, LONG)
    assert session._wait(lambda: np.allclose(session.world_state().poses["bolt"], moved), LONG)

    body = replace(next(iter(session.scene().bodies.values())), name="newcomer")
    session.add_body(body, LONG)
    assert session._wait(lambda: "newcomer" in session.scene().bodies, LONG)
    assert "newcomer" in session.world_state(LONG).poses
    session.remove_body("newcomer", LONG)
    with pytest.raises(InputError) as error:
        session.remove_body("newcomer", LONG)
    assert error.value.code is Code.UNKNOWN_OBJECT
    session.reset(LONG)


def stamped(scene, seconds: int, x: float) -> WorldState:
    state = scene.start_state()
    state.poses["bolt"] = np.array([x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    return state_to_message(scene, state, Time(sec=seconds))


def test_an_older_state_that_arrives_late_replaces_nothing(monkeypatch) -> None:
    """Until the newest one is stale: a simulation that was started anew begins with stamps from 0."""
    scene = load_scene("bolt", 0)
    with Session(namespace="/elsewhere") as session:
        session._take_scene(scene_to_message(scene))
        for seconds, x in ((7, 0.1), (6, 0.2), (7, 0.3), (5, 0.4)):
            session._take_state(stamped(scene, seconds, x))
        assert session.world_state().poses["bolt"][0] == 0.3
        session._take_state(stamped(scene, 8, 0.5))
        assert session.world_state().poses["bolt"][0] == 0.5
        monkeypatch.setattr("hmap.session.STALE_AFTER", 0.05)
        time.sleep(0.1)
        session._take_state(stamped(scene, 1, 0.6))
        monkeypatch.setattr("hmap.session.STALE_AFTER", LONG)
        assert session.world_state().poses["bolt"][0] == 0.6


def test_a_scene_is_loaded_by_name_or_as_it_is(graph, session) -> None:
    assert session.load_scene("puck_move", seed=2, timeout=LONG).seed == 2
    assert (session.scene().task, session.world_state(LONG).q.keys()) == ("puck_move", graph.scene.robots.keys())
    scene = SceneBuilder.from_yaml("bolt", "built").add_box("wall", [0.1, 0.1, 0.1], [2, 2, 0.05])
    assert "wall" in session.load_scene(scene.build(5), timeout=LONG).bodies
    assert (graph.scene.task, graph.scene.seed) == ("built", 5) and "wall" in session.world_state(LONG).poses
    with pytest.raises(InputError) as error:
        session.load_scene("bolts", timeout=LONG)
    assert error.value.code is Code.UNKNOWN_TASK and "Did you mean" in error.value.reason


def test_a_supervisor_that_goes_away_ends_the_goal(graph, session) -> None:
    graph.answers = [None]
    session.manipulate()
    session.result(LONG)
    session._client.server_is_ready = lambda: False
    with pytest.raises(PlannerError) as error:
        session.manipulate()
    assert error.value.code is Code.SERVICE_UNAVAILABLE
    del session._client.server_is_ready
    graph.answers = ["wait"]
    session.manipulate()
    session._client.server_is_ready = lambda: False
    result = session.result(LONG)
    assert result.error.code is Code.SERVICE_UNAVAILABLE and result.error.stage == "planner"
    del session._client.server_is_ready
    session.cancel()
    assert session._wait(lambda: session._goal._response is not None, LONG)  # the fake's goal has ended, too


def test_a_result_that_was_lost_is_asked_for_again(graph, session, monkeypatch) -> None:
    monkeypatch.setattr("hmap.manipulation_goal.RESULT_REPEAT", 0.2)
    graph.answers = [None]
    lost = []
    answered = GoalInProgress._answered
    monkeypatch.setattr(
        GoalInProgress, "_answered", lambda goal, future: answered(goal, future) if lost else lost.append(future)
    )
    session.manipulate()
    assert session._wait(lambda: lost, LONG)
    session._goal._take_feedback(SimpleNamespace(feedback=SimpleNamespace(status=PlannerStatus(phase="done"))))
    assert session.result(LONG).success


def test_a_goal_that_is_worked_on_is_not_given_up_when_its_acceptance_was_lost(graph, session, monkeypatch) -> None:
    monkeypatch.setattr("hmap.manipulation_goal.RESULT_REPEAT", 0.2)
    monkeypatch.setattr(GoalInProgress, "_accepted", lambda goal, future: None)
    graph.answers = [None]
    session.manipulate()
    session._goal._take_feedback(SimpleNamespace(feedback=SimpleNamespace(status=PlannerStatus(phase="done"))))
    assert session.result(LONG).success


def test_a_goal_that_nobody_takes_ends(graph, session, monkeypatch) -> None:
    monkeypatch.setattr("hmap.manipulation_goal.ACCEPT_LIMIT", 0.2)
    monkeypatch.setattr(session._client, "send_goal_async", lambda *_: Future())
    session.manipulate()
    error = session.result(LONG).error
    assert error.code is Code.SERVICE_UNAVAILABLE and "did not take the goal" in error.reason


def test_leaving_the_context_cancels_the_goal(graph) -> None:
    graph.answers = ["wait"]
    with Session(namespace=NAMESPACE) as session:
        session.wait_until_ready(LONG, ["supervisor"])
        session.manipulate()
    assert session.result(0.0).error.code is Code.CANCELED


def test_names_can_be_remapped(graph) -> None:
    with Session(args=["--ros-args", "-r", f"__ns:={NAMESPACE}", "-r", "world_state:=/elsewhere"]) as session:
        assert session.node.resolve_topic_name("world_state") == "/elsewhere"
    with Session(args=["--ros-args", "-r", f"__ns:={NAMESPACE}", "-r", "__node:=mine"]) as session:
        assert session.node.get_name() == "mine"
        session.wait_until_ready(LONG, ["supervisor", "perception"])
        session.manipulate()
        assert session.result(LONG).success


def test_a_node_of_the_program_is_used_and_stays(graph) -> None:
    def make(context: Context) -> Node:
        return Node("program", context=context, namespace=NAMESPACE)

    program = spinning(make)
    node = next(program)
    with Session(node) as session:
        session.wait_until_ready(LONG, ["supervisor", "perception"])
        session.manipulate()
        assert session.result(LONG).success
    assert node.get_name() == "program" and not list(node.clients)
    for _ in program:
        pass


def test_a_node_that_nobody_spins_is_told() -> None:
    context = Context()
    context.init()
    node = Node("idle", context=context)
    with Session(node) as session, pytest.raises(PlannerError, match="'idle' is in no executor"):
        session.wait_until_ready(LONG)
    node.destroy_node()
    context.shutdown()


def test_nobody_there_is_told_with_the_names() -> None:
    with Session(namespace="/nowhere") as session:
        assert session.ready() == []
        with pytest.raises(PlannerError, match="not ready after 0.2 s: supervisor, perception, waypoint_planner"):
            session.wait_until_ready(0.2)
        for ask in (session.scene, lambda t: session.load_scene("bolt", timeout=t)):
            with pytest.raises(PlannerError) as error:
                ask(0.1)
            assert error.value.code is Code.SERVICE_UNAVAILABLE


@pytest.mark.parametrize("options", [{"args": ["--ros-args", "-r", "no remapping"]}, {"name": "no name"}])
def test_wrong_ros_arguments_are_input_errors(options) -> None:
    with pytest.raises(InputError, match="ROS arguments"):
        Session(**options)
