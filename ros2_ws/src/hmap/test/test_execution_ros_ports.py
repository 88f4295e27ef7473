"""The scripted executions of hmap_core's tests, over actions and topics: only the wire is replaced."""

import threading
from contextlib import contextmanager
from types import SimpleNamespace

import pytest
from action_msgs.msg import GoalStatus
from control_msgs.action import FollowJointTrajectory, GripperCommand
from execution_scenarios import ROBOT, SCENARIOS, Stage
from kinematic_world import STEP, KinematicCommand, KinematicWorld

from hmap.conversions import scene_to_message, state_to_message
from hmap.supervision import controllers as module
from hmap.supervision.controllers import Controllers
from hmap.supervision.ports import ros_ports
from hmap.supervision.scene_monitor import SceneMonitor
from hmap_core.types import JointTrajectory
from hmap_msgs.msg import BodyArray
from hmap_msgs_py.bodies import body_to_message
from hmap_msgs_py.times import joint_trajectory_from_message, seconds_from_message, time_to_message

PATIENCE = 30.0  # s on a busy machine
REAL_STEP = 0.005  # s of real time for one step of the world
MOMENT = 0.2  # s of real time


class Future:
    """A value that is there at once, or later."""

    def __init__(self):
        self._callbacks, self._value, self._lock = [], None, threading.Lock()

    def set(self, value) -> None:
        with self._lock:
            self._value = value
            callbacks = self._callbacks
        for callback in callbacks:
            callback(self)

    def result(self):
        return self._value

    def add_done_callback(self, callback) -> None:
        with self._lock:
            there = self._value is not None
            self._callbacks.append(callback)
        if there:
            callback(self)


class Graph(threading.Thread):
    """What the rest of the graph does: a world whose time passes, topics, and action servers."""

    def __init__(self, scene):
        super().__init__(daemon=True)
        self.world, self.lock, self.ended = KinematicWorld(scene), threading.RLock(), threading.Event()
        self.callbacks, self.stopping, self.group = {}, threading.Event(), None
        self._goals: list[tuple[KinematicCommand, object, Future]] = []
        self._base = scene

    # a node

    def subscribe(self, kind, topic, callback, qos=None) -> None:
        self.callbacks[topic] = callback

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=round(self.world.time * 1e9)))

    # the world

    def run(self) -> None:
        self.callbacks["scene"](scene_to_message(self._base))
        while not self.ended.wait(REAL_STEP):
            with self.lock:
                self.world.advance(STEP)
                state = state_to_message(self._base, self._known(), time_to_message(self.world.time))
                goals = list(self._goals)
            self.callbacks["world_state"](state)
            for goal in goals:
                self._serve(*goal)

    def add_body(self, body) -> None:
        with self.lock:
            self.world.add_body(body)
        self.callbacks["new_object"](BodyArray(bodies=[body_to_message(body)]))

    def remove_body(self, name: str) -> None:
        with self.lock:
            self.world.remove_body(name)
        self.callbacks["new_object"](BodyArray(bodies=[]))

    def move_body(self, name: str, pose) -> None:
        with self.lock:
            self.world.move_body(name, pose)

    def q(self):
        with self.lock:
            return self.world.now.q[ROBOT].copy()

    def _known(self):
        state = self.world.now.copy()
        state.poses = {name: pose for name, pose in state.poses.items() if name in self._base.bodies}
        return state

    # action servers

    def start_goal(self, goal, feedback_callback) -> Future:
        robot = self._base.robots[ROBOT]
        with self.lock:
            if isinstance(goal, GripperCommand.Goal):
                command = self.world.grip(robot, goal.command.position, goal.command.max_effort)
            else:
                samples = joint_trajectory_from_message(goal.trajectory, list(goal.trajectory.joint_names))
                start = seconds_from_message(goal.trajectory.header.stamp) or None
                motion = JointTrajectory(robot.model.joint_names, *samples)
                command = self.world.move(robot, motion, start)
            result, answer = Future(), Future()
            self._goals.append((command, lambda: self._feedback(goal, command, feedback_callback), result))
        handle = SimpleNamespace(
            accepted=True, get_result_async=lambda: result, cancel_goal_async=lambda: self._cancel(command)
        )
        answer.set(handle)
        return answer

    def _cancel(self, command: KinematicCommand) -> None:
        with self.lock:
            self.world.cancel(command)

    def _serve(self, command: KinematicCommand, feedback, result: Future) -> None:
        if not command.done:
            feedback()
            return
        with self.lock:
            self._goals = [goal for goal in self._goals if goal[0] is not command]
        status = GoalStatus.STATUS_CANCELED if command.canceled else GoalStatus.STATUS_SUCCEEDED
        gripper = command.motion is None
        answer = GripperCommand.Result(position=command.opening) if gripper else FollowJointTrajectory.Result()
        result.set(SimpleNamespace(status=status, result=answer))

    def _feedback(self, goal, command: KinematicCommand, callback) -> None:
        if command.motion is None or not command.feedback:
            return
        message = FollowJointTrajectory.Feedback(joint_names=list(goal.trajectory.joint_names))
        message.header.stamp = time_to_message(command.feedback[-1].stamp)
        message.desired.positions = command.feedback[-1].positions.tolist()
        message.error.positions = [0.0] * len(message.joint_names)
        callback(SimpleNamespace(feedback=message))


class DirectActionClient:
    """Hands goals to the graph without a wire."""

    def __init__(self, node: Graph, kind, name, callback_group=None):
        self._graph = node

    def wait_for_server(self, patience: float) -> bool:
        return True

    def send_goal_async(self, goal, feedback_callback) -> Future:
        return self._graph.start_goal(goal, feedback_callback)


NAMING = SimpleNamespace(
    arm_joints=lambda robot, model: [f"{robot}_{joint}" for joint in model.joint_names],
    arm_action=lambda robot: f"{robot}/arm",
    gripper_action=lambda robot: f"{robot}/gripper",
)


@pytest.fixture
def over_ros(monkeypatch):
    monkeypatch.setattr(module, "ActionClient", DirectActionClient)

    @contextmanager
    def stage_of(plan):
        graph = Graph(plan.scene)
        scene_monitor = SceneMonitor(graph, stale_after=PATIENCE)
        controllers = Controllers(graph, NAMING, scene_monitor)
        scene_monitor.on_change(controllers.news.set)
        graph.start()
        ports = ros_ports(controllers, scene_monitor, PATIENCE)
        ports.observation.state()
        yield Stage(ports, graph, graph.q, lambda: threading.Event().wait(MOMENT))
        graph.ended.set()
        graph.join()

    return stage_of


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda scenario: scenario.__name__)
def test_executions_over_ros_end_as_in_the_simulation(over_ros, scenario):
    scenario(over_ros)
