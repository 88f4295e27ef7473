"""Stand-ins of a cell's drivers, that speak as the real ones do, with faults on demand.

Run as ``python drivers.py --ros-args ...``: one node in place of the drivers of arms, grippers and motion capture.

* Arms, as ros2_control's joint_trajectory_controller: goals are rejected whose joints are not exactly the arm's, whose
  times do not increase, whose last velocity is not zero, or that end in the past; a cancel holds abruptly; a stamp in
  the header is a start of the system's clock. As franka_ros2: a start that is not where the arm is told to be is a
  reflex, after which goals are rejected until ``recover``.
* Grippers, as franka_gripper: ``position`` is what the parameter says.
* Joint states, as the joint_state_broadcaster of franka_ros2: 30 Hz, best effort.
* Motion capture, as vicon_receiver and vrpn_mocap: 100 Hz, best effort, in a frame of its own that /tf_static connects
  with the world, with noise and latency.

The topic ``fault`` (std_msgs/String) sets or ends faults: ``poses jump``, ``arm reflex``, ``clear`` and others below.
"""

import sys
import threading
import time
from collections import deque

import numpy as np
from control_msgs.action import FollowJointTrajectory
from geometry_msgs.msg import PoseStamped, TransformStamped
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage

from hmap.naming import Naming
from hmap.node import HmapNode, run
from hmap.supervision.gripper_position import DESCRIPTION, GAP, PARAMETER, GripperPosition
from hmap.world.actions import ControllerActions
from hmap.world.loop import WorldLoop
from hmap_core import transforms
from hmap_core.exceptions import HmapError
from hmap_core.scenes import load_scene
from hmap_core.types import BodyKind
from hmap_msgs_py.poses import pose_to_message
from hmap_msgs_py.times import seconds_from_message, time_to_message

JOINT_RATE, POSE_RATE = 30.0, 100.0  # Hz
LATENCY, NOISE = 0.02, 0.0003  # s, m of motion capture
MOCAP = transforms.pose((0.4, -0.2, 0.1), (0.0, 0.0, np.sin(0.35), np.cos(0.35)))  # T_world_mocap
FRAME = "mocap"
SENSOR = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
JUMP = np.array([0.3, 0.0, 0.0])  # m
OLD = 10.0  # s


class JointTrajectoryController(ControllerActions):
    """One arm and its gripper; arms as ros2_control has them."""

    def __init__(self, node: "Drivers", loop: WorldLoop, naming: Naming, robot, position: GripperPosition):
        self._drivers, self._active = node, True
        super().__init__(node, loop, naming, robot, position)

    def recover(self) -> None:
        """After a reflex: error recovery, hardware and controllers active again."""
        self._active = True

    def _server(self, action: type, name: str, execute) -> ActionServer:
        arm = action is FollowJointTrajectory
        return ActionServer(
            self._node,
            action,
            name,
            execute,
            callback_group=self._node.group,
            goal_callback=self._accepts if arm else lambda _: GoalResponse.ACCEPT,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def _accepts(self, goal: FollowJointTrajectory.Goal) -> GoalResponse:
        """As validate_trajectory_msg of the joint_trajectory_controller."""
        while "arm mute" in self._drivers.faults:
            time.sleep(0.05)
        points, names = goal.trajectory.points, goal.trajectory.joint_names
        times = [seconds_from_message(point.time_from_start) for point in points]
        stamp = seconds_from_message(goal.trajectory.header.stamp)
        wrong = (
            not self._active
            or sorted(names) != sorted(self._joints)
            or not points
            or (np.diff(times) <= 0.0).any()
            or any(len(point.positions) != len(names) for point in points)
            or (len(points[-1].velocities) and np.abs(points[-1].velocities).max() > np.finfo(np.float32).eps)
            or (stamp > 0.0 and stamp + times[-1] < time.time())
        )
        if wrong:
            self._node.get_logger().warning("goal rejected")
        return GoalResponse.REJECT if wrong else GoalResponse.ACCEPT

    def _follow(self, handle) -> FollowJointTrajectory.Result:
        result, robot = FollowJointTrajectory.Result(), self._robot.name
        trajectory, tolerances = self._command(handle.request)
        stamp = seconds_from_message(handle.request.trajectory.header.stamp)
        if "arm stand" in self._drivers.faults:
            while not handle.is_cancel_requested and "arm stand" in self._drivers.faults:
                time.sleep(0.02)
            handle.canceled() if handle.is_cancel_requested else handle.abort()
            return result
        try:
            start = None if stamp == 0.0 else self._loop.world.time + (stamp - time.time())
            motion = self._loop.follow(robot, trajectory, tolerances, start)
        except HmapError as error:  # a leap, which Franka answers with a reflex
            self._active = False
            result.error_string = f"reflex: joint_motion_generator_velocity_discontinuity ({error})"
            handle.abort()
            return result
        while not motion.done.wait(0.02):
            if handle.is_cancel_requested or "arm reflex" in self._drivers.faults:
                self._hold(robot)
                break
            if motion.state is not None:
                handle.publish_feedback(self._tracking(motion.state))
        if "arm reflex" in self._drivers.faults:
            self._active = False
            result.error_string = "reflex: cartesian_reflex"
            handle.abort()
        elif handle.is_cancel_requested:
            handle.canceled()
        elif motion.outcome == "succeeded":
            handle.succeed()
        else:
            result.error_string = motion.reason
            handle.abort()
        return result

    def _hold(self, robot: str) -> None:
        """Abruptly, as without decelerate_on_cancel."""

        def hold() -> None:
            arm = self._loop._arms[robot]
            arm.hold(arm.tracking.q)

        self._loop.call(hold)

    def _tracking(self, tracking) -> FollowJointTrajectory.Feedback:
        message = super()._tracking(tracking)
        message.header.stamp = time_to_message(time.time())
        return message


class Drivers(HmapNode):
    """All drivers of a cell."""

    def __init__(self):
        super().__init__("drivers")
        self.faults: set[str] = set()
        self._naming = Naming(self, "arm_joint", "finger_joint", "arm_action", "gripper_action", "body_pose")
        scene = load_scene(self.parameter("task", "tunnel", "that is simulated"), self.parameter("seed", 0, "of it"))
        position = GripperPosition(self.parameter(PARAMETER, GAP, DESCRIPTION))
        self._rng, self._lock = np.random.default_rng(0), threading.Lock()
        self._truth: tuple[dict, dict] = {}, {}
        self._late: deque[tuple[float, dict]] = deque()
        self._loop = WorldLoop(scene, 1.0, 1.0, self._note)
        self._arms = {
            name: JointTrajectoryController(self, self._loop, self._naming, robot, position)
            for name, robot in scene.robots.items()
        }
        self._scene = scene
        self._joints = self.create_publisher(JointState, "joint_states", SENSOR)
        bodies = [name for name, body in scene.bodies.items() if body.kind is not BodyKind.FIXED]
        self._poses = {n: self.create_publisher(PoseStamped, self._naming.body_pose(n), SENSOR) for n in bodies}
        self._tf = self.create_publisher(TFMessage, "/tf_static", LATCHED)
        transform = TransformStamped(header=Header(frame_id="world"), child_frame_id=FRAME)
        pose = pose_to_message(MOCAP)
        t, transform.transform.rotation = transform.transform.translation, pose.orientation
        t.x, t.y, t.z = pose.position.x, pose.position.y, pose.position.z
        self._tf.publish(TFMessage(transforms=[transform]))
        self.subscribe(String, "fault", self._set)
        self.create_service(Trigger, "~/error_recovery", self._recover, callback_group=self.group)
        self.every(1.0 / JOINT_RATE, self._publish_joints)
        self.every(1.0 / POSE_RATE, self._publish_poses)
        self._loop.start()

    def close(self) -> None:
        """Stop the simulation."""
        super().close()
        self.faults.clear()
        self._loop.stop()

    def _set(self, message: String) -> None:
        if message.data == "clear":
            self.faults.clear()
            for arm in self._arms.values():
                arm.recover()
        else:
            self.faults.add(message.data)

    def _recover(self, _, response):
        for arm in self._arms.values():
            arm.recover()
        response.success = True
        return response

    def _note(self, world) -> None:
        """In the simulation's thread."""
        poses = {name: world.body_pose(name).copy() for name in self._poses}
        with self._lock:
            self._truth = world.joint_states(), poses

    def _publish_joints(self) -> None:
        with self._lock:
            states, _ = self._truth
        if not states or "joints drop" in self.faults:
            return
        message = JointState(header=Header(stamp=time_to_message(time.time())))
        for name, state in states.items():
            model = self._scene.robots[name].model
            message.name.extend(self._naming.arm_joints(name, model) + self._naming.finger_joints(name, model))
            message.position.extend(state.positions.tolist())
            message.velocity.extend(state.velocities.tolist())
        if "joints nan" in self.faults:
            message.position = [float("nan")] * len(message.name)
        if "joints names" in self.faults:
            message.name = [f"other_{name}" for name in message.name]
        self._joints.publish(message)

    def _publish_poses(self) -> None:
        now = time.time()
        with self._lock:
            self._late.append((now, self._truth[1]))
        while len(self._late) > 1 and self._late[1][0] <= now - LATENCY:
            self._late.popleft()
        at, poses = self._late[0]
        if "poses drop" in self.faults:
            return
        for name, T in poses.items():
            T_world = T.copy()
            T_world[:3] += self._rng.normal(0.0, NOISE, 3) + (JUMP if "poses jump" in self.faults else 0.0)
            T_mocap = transforms.multiply(transforms.inverse(MOCAP), T_world)
            if "poses nan" in self.faults:
                T_mocap[0] = np.nan
            if "poses unnormalised" in self.faults:
                T_mocap[3:] *= 1.2
            if "poses w first" in self.faults:
                T_mocap = np.concatenate([T_mocap[:3], np.roll(T_mocap[3:], 1)])
            if "poses old" in self.faults:
                at = now - OLD
            if "poses ahead" in self.faults:
                at = now + OLD
            if "poses unstamped" in self.faults:
                at = 0.0
            frame = "elsewhere" if "poses frame" in self.faults else FRAME
            message = PoseStamped(header=Header(stamp=time_to_message(at), frame_id=frame))
            p, q = message.pose.position, message.pose.orientation
            p.x, p.y, p.z, q.x, q.y, q.z, q.w = (float(v) for v in T_mocap)
            self._poses[name].publish(message)


if __name__ == "__main__":
    sys.exit(run(Drivers))
