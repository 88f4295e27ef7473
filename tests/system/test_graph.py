"""Bad input is answered and survived, a planner that is killed comes back, a cancel stops the motion."""

import os
import signal
import threading
import time

import numpy as np
import policy
import pytest

from hmap.action_client import ActionClient
from hmap_core.exceptions import Code
from hmap_core.scenes import load_scene
from hmap_msgs.action import Manipulate
from hmap_msgs.msg import Body, Scene, WorldState
from hmap_msgs.srv import (
    AddBody,
    CheckContacts,
    GetScene,
    LoadScene,
    MoveBody,
    PlanWaypoints,
    ProposeContacts,
    SolveSegment,
)
from hmap_msgs_py.poses import pose_to_message

TIME_LIMIT = 240.0  # s for planning on a busy machine
ANSWER_LIMIT = 60.0  # s for a service
PATIENCE = 0.1  # s between two looks at whether the nodes live
RESPAWN_LIMIT = 60.0  # s
SHIFT = 0.03  # m; more than an object may be off in the end, less than one is lost
STILL = 0.002  # rad that a standing arm may differ between two looks


def manipulate(graph, on_feedback=None, **fields):
    """The result of a goal."""
    graph.session.manipulate(time_limit=TIME_LIMIT, on_feedback=on_feedback, **fields)
    while not graph.session.is_done(timeout=PATIENCE):
        graph.check()
    return graph.session.result()


def answer(future):
    """The result of a future, which something else brings about."""
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    assert done.wait(ANSWER_LIMIT), "no answer"
    return future.result()


def call(graph, service, name, request):
    client = graph.session.node.create_client(service, name)
    assert client.wait_for_service(ANSWER_LIMIT), f"nobody offers {name}"
    return answer(client.call_async(request))


def all_alive(graph) -> bool:
    return all(node.process.poll() is None and node.starts == 1 for node in graph.nodes.values())


def test_planning_goes_before_simulation_where_processors_are_few(graph):
    ours = os.getpriority(os.PRIO_PROCESS, 0)
    for name, node in graph.nodes.items():
        behind = os.getpriority(os.PRIO_PROCESS, node.process.pid) - ours
        assert behind == (min(10, 19 - ours) if name in ("world", "perception") else 0), name
        assert os.getsid(node.process.pid) == os.getsid(0), "niceness says nothing between sessions"


@pytest.fixture(scope="module")
def world(graph):
    """What the services of the planners take."""
    return call(graph, GetScene, "get_scene", GetScene.Request())


def pose(*values):
    """A pose message that holds exactly these numbers."""
    message = pose_to_message(np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]))
    p, q = message.position, message.orientation
    p.x, p.y, p.z, q.x, q.y, q.z, q.w = values
    return message


NAN_POSE = (float("nan"), 0.25, 0.08, 0.0, 0.0, 0.0, 1.0)
LONG_QUATERNION = (0.5, 0.25, 0.08, 0.0, 0.0, 0.0, 2.0)
GOOD_POSE = (0.5, 0.25, 0.08, 0.0, 0.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("fields", "code"),
    [
        ({"task": "tunel"}, Code.UNKNOWN_TASK),
        ({"object": "baar", "pose": pose(*GOOD_POSE)}, Code.UNKNOWN_OBJECT),
        ({"object": "table", "pose": pose(*GOOD_POSE)}, Code.UNKNOWN_OBJECT),
        ({"object": "bar", "pose": pose(*NAN_POSE)}, Code.INVALID_POSE),
        ({"object": "bar", "pose": pose(*LONG_QUATERNION)}, Code.INVALID_POSE),
        ({"object": "bar", "pose": pose(0.5, 0.25, 0.0, 0.0, 0.0, 0.0, 1.0)}, Code.GOAL_IN_COLLISION),
        ({"position_tolerance": float("nan")}, Code.INVALID_INPUT),
        ({"rotation_tolerance": -1.0}, Code.INVALID_INPUT),
    ],
)
def test_a_wrong_goal_is_refused_with_its_code(graph, fields, code):
    client = ActionClient(graph.session.node, Manipulate, "manipulate")
    assert client.wait_for_server(ANSWER_LIMIT)
    goal = Manipulate.Goal(plan_only=True, time_limit=TIME_LIMIT, **fields)
    result = answer(answer(client.send_goal_async(goal)).get_result_async()).result
    client.destroy()
    assert not result.success
    assert Code(result.error.code) is code
    assert result.error.stage == "input" and result.error.reason
    assert all_alive(graph)


def requests(world):
    """(service, name, request, code) for requests that are wrong in one way each."""
    good = {"scene": world.scene, "world": world.world, "object": "bar"}
    poses = [pose(*GOOD_POSE), pose(*GOOD_POSE)]
    broken_scene = Scene(task="tunnel", seed=0, mode="physical", text="{")
    empty = WorldState(task="tunnel", seed=0, mode="physical")
    nan_pose, long_quaternion = pose(*NAN_POSE), pose(*LONG_QUATERNION)
    planning = PlanWaypoints.Request
    yield PlanWaypoints, "plan_waypoints", planning(**good | {"object": "nix"}, goal=poses[0]), Code.UNKNOWN_OBJECT
    yield PlanWaypoints, "plan_waypoints", planning(**good, goal=nan_pose), Code.INVALID_POSE
    yield PlanWaypoints, "plan_waypoints", planning(**good, goal=long_quaternion), Code.INVALID_POSE
    yield PlanWaypoints, "plan_waypoints", planning(**good, goal=poses[0], time_limit=-1.0), Code.INVALID_INPUT
    yield PlanWaypoints, "plan_waypoints", planning(**good | {"scene": broken_scene}, goal=poses[0]), Code.INVALID_SCENE
    yield PlanWaypoints, "plan_waypoints", planning(**good | {"world": empty}, goal=poses[0]), Code.UNKNOWN_ROBOT
    proposing = ProposeContacts.Request
    yield ProposeContacts, "propose_contacts", proposing(**good, object_poses=[nan_pose] * 2), Code.INVALID_POSE
    unknown = proposing(**good, object_poses=poses, robots=["r2d2"])
    yield ProposeContacts, "propose_contacts", unknown, Code.UNKNOWN_ROBOT
    yield CheckContacts, "check_contacts", CheckContacts.Request(**good), Code.INVALID_INPUT
    yield SolveSegment, "solve_segment", SolveSegment.Request(**good, object_poses=poses), Code.UNKNOWN_ROBOT
    yield LoadScene, "load_scene", LoadScene.Request(task="nix"), Code.UNKNOWN_TASK
    yield LoadScene, "load_scene", LoadScene.Request(text="{}"), Code.INVALID_SCENE
    yield MoveBody, "move_body", MoveBody.Request(name="nix", pose=poses[0]), Code.UNKNOWN_OBJECT
    yield MoveBody, "move_body", MoveBody.Request(name="bar", pose=nan_pose), Code.INVALID_POSE
    yield MoveBody, "move_body", MoveBody.Request(name="table", pose=poses[0]), Code.INVALID_INPUT
    shapeless = Body(name="ghost", kind="movable", pose=poses[0])
    yield AddBody, "add_body", AddBody.Request(body=shapeless), Code.INVALID_SCENE


def test_wrong_requests_are_answered_with_their_codes(graph, world):
    for service, name, request, code in requests(world):
        error = call(graph, service, name, request).error
        assert Code(error.code) is code, f"{name}: {error}"
        assert error.stage and error.reason
    assert all_alive(graph)


def test_nonsense_on_topics_is_survived(graph):
    from geometry_msgs.msg import PoseStamped
    from sensor_msgs.msg import JointState

    node = graph.session.node
    joints = node.create_publisher(JointState, "joint_states", 10)
    bodies = node.create_publisher(PoseStamped, "vicon/bar/bar", 10)
    states = node.create_publisher(WorldState, "world_state", 10)
    for _ in range(5):
        joints.publish(JointState(name=["panda_1_panda_joint1"], position=[float("nan")]))
        joints.publish(JointState(name=["panda_1_panda_joint1"], position=[]))
        bodies.publish(PoseStamped(pose=pose(*NAN_POSE)))
        states.publish(WorldState(task="nix"))
    assert call(graph, GetScene, "get_scene", GetScene.Request()).error.code == Code.SUCCESS
    assert all_alive(graph)
    for publisher in (joints, bodies, states):
        node.destroy_publisher(publisher)


def test_a_cancel_stops_the_planning(graph):
    session = graph.session

    def cancel(feedback):
        if feedback.phase == "contacts":
            session.cancel()

    assert manipulate(graph, cancel, plan_only=True).error.code is Code.CANCELED
    result = manipulate(graph, task="tunel")
    assert result.error.code is Code.UNKNOWN_TASK  # the supervisor is free again


@pytest.mark.slow
def test_a_killed_optimiser_comes_back_and_the_plan_is_found(graph):
    node = graph.nodes["komo_optimiser"]
    os.killpg(node.process.pid, signal.SIGKILL)
    until = time.monotonic() + RESPAWN_LIMIT
    while node.starts < 2:
        assert time.monotonic() < until, "it was not started again"
        time.sleep(0.1)
    graph.wait_until_up()
    result = manipulate(graph, plan_only=True)
    assert result.success, result.error
    assert result.plan.segments and result.plan.scene.task == "tunnel"
    assert not result.executed


@pytest.mark.slow
def test_a_cancel_stops_the_motion(graph):
    start = np.concatenate([robot.q for robot in load_scene("tunnel", 0).robots.values()])
    session = graph.session
    session.manipulate(time_limit=TIME_LIMIT)
    while np.abs(joints(graph) - start).max() <= 2.0 * STILL:  # until an arm is on its way
        graph.check()
        assert not session.is_done(timeout=PATIENCE), session.result().error
    session.cancel()
    assert session.result(ANSWER_LIMIT).error.code is Code.CANCELED
    first, second = (joints(graph), time.sleep(1.0), joints(graph))[::2]
    assert np.abs(second - first).max() < STILL
    assert np.abs(first - start).max() > STILL  # it had been moving


@pytest.mark.slow
def test_an_object_that_was_shifted_is_brought_to_its_goal_by_a_new_plan(graph):
    graph.session.reset(ANSWER_LIMIT)
    graph.wait_until_up()
    shifted = []

    def shift(feedback):
        if feedback.phase == "execution" and not shifted:
            shifted.append(True)
            threading.Thread(target=push_aside, args=(graph,)).start()

    result = manipulate(graph, shift)
    assert result.success, result.error
    assert shifted and result.executed
    assert result.statistics["plans"] == 2
    assert result.position_error < load_scene("tunnel", 0).execution_tolerance[0]


def push_aside(graph) -> None:
    """Shift the bar along the tunnels, farther than it may be off at the end."""
    start = load_scene("tunnel", 0).bodies["bar"].pose
    graph.session.move_body("bar", start + np.array([-SHIFT, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]), ANSWER_LIMIT)


def joints(graph) -> np.ndarray:
    world = call(graph, GetScene, "get_scene", GetScene.Request()).world
    return np.concatenate([robot.position for robot in world.robots])


# allowed beside what these nodes do here: parts of the graph that are not always there, and native ROS
NOT_HERE = (
    "subscribe /clock",
    "subscribe /parameter_events",
    "get_type_description",
    # of the watchdog in perception, without a world
    "_arm_controller/follow_joint_trajectory/_action/cancel_goal",
    "subscribe /supervisor/heartbeat",
    "request /check_contacts",  # with the parameter check_remotely, and of tools
    "subscribe /komo_optimiser/heartbeat",
    "request /load_scene",
)


@pytest.mark.slow
def test_the_security_policy_allows_what_the_nodes_do_and_no_more(graph):
    """After those in which robots were moved, so that all clients are there."""
    for name, parameters in (("recorder", {"path": graph.folder / "bag"}), ("viewer", {"port": 0})):
        graph.start(name, parameters)
    graph.wait_until_up()
    allowed = policy.policy()
    for name in graph.nodes:
        own, until = allowed[f"/hmap/{name}"], time.monotonic() + ANSWER_LIMIT
        while True:  # what a node that has just started offers and takes is discovered one by one
            done = policy.endpoints(graph.session.node, [name])
            left = [text for text in policy.unused(own, done) if not text.endswith(NOT_HERE)]
            if not left or time.monotonic() > until:
                break
            time.sleep(0.2)
        assert not left, name
        assert not policy.not_allowed(own, done), name


def test_every_node_ends_cleanly(graph):
    """Last in this file: it ends the graph."""
    from conftest import no_traces

    graph.end()
    assert set(graph.exit_codes().values()) == {0}
    assert no_traces(graph.folder)
