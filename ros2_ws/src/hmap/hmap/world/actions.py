"""The controllers' actions: FollowJointTrajectory and GripperCommand, as in ros2_control."""

import numpy as np
from control_msgs.action import FollowJointTrajectory, GripperCommand
from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle

from hmap.naming import Naming
from hmap.node import HmapNode
from hmap.supervision.gripper_position import GripperPosition
from hmap.world.loop import Motion, WorldLoop
from hmap_core.exceptions import HmapError, InputError
from hmap_core.simulation.controllers import Outcome, Tolerances
from hmap_core.types import JointTrajectory, Robot
from hmap_msgs_py.checks import ConversionError, finite
from hmap_msgs_py.measurements import ReceiverClock
from hmap_msgs_py.times import (
    joint_efforts_from_message,
    joint_trajectory_from_message,
    seconds_from_message,
    time_to_message,
)

START_AHEAD = 60.0  # s; a trajectory that starts later than this was stamped by another clock
POLL = 0.05  # s of real time between checks for a cancel request, and between feedback messages

ERROR_CODES = {
    Outcome.PATH_TOLERANCE_VIOLATED: FollowJointTrajectory.Result.PATH_TOLERANCE_VIOLATED,
    Outcome.GOAL_TOLERANCE_VIOLATED: FollowJointTrajectory.Result.GOAL_TOLERANCE_VIOLATED,
}
ENDED_WELL = (Outcome.SUCCEEDED, Outcome.STALLED)  # a gripper that has grasped an object stalls


class ControllerActions:
    """The action servers of one robot.

    Args:
        node: the node that offers them.
        loop: the simulation.
        naming: names of joints and actions.
        robot: the robot.
        gripper_position: what the positions of gripper commands mean.
    """

    def __init__(
        self, node: HmapNode, loop: WorldLoop, naming: Naming, robot: Robot, gripper_position: GripperPosition
    ):
        self._node, self._loop, self._robot, self._gripper_position = node, loop, robot, gripper_position
        self._joints = dict(zip(naming.arm_joints(robot.name, robot.model), robot.model.joint_names, strict=True))
        self._servers = [
            self._server(FollowJointTrajectory, naming.arm_action(robot.name), self._follow),
        ]
        if robot.model.gripper:
            self._servers.append(self._server(GripperCommand, naming.gripper_action(robot.name), self._grip))

    def destroy(self) -> None:
        """Remove the servers."""
        for server in self._servers:
            server.destroy()

    def _server(self, action: type, name: str, execute) -> ActionServer:
        return ActionServer(
            self._node,
            action,
            name,
            execute,
            callback_group=self._node.group,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def _follow(self, handle: ServerGoalHandle) -> FollowJointTrajectory.Result:
        result = FollowJointTrajectory.Result()
        try:
            trajectory, tolerances = self._command(handle.request)
            start = seconds_from_message(handle.request.trajectory.header.stamp) or None  # 0: now
            ReceiverClock(lambda: self._loop.world.time, START_AHEAD).check("the trajectory", start or 0.0)
            motion = self._loop.follow(self._robot.name, trajectory, tolerances, start)
        except (HmapError, ConversionError) as error:
            result.error_code, result.error_string = FollowJointTrajectory.Result.INVALID_GOAL, str(error)
            handle.abort()
            return result
        self._wait(handle, motion, lambda: self._loop.cancel_arm(self._robot.name), self._tracking)
        result.error_code = ERROR_CODES.get(motion.outcome, FollowJointTrajectory.Result.SUCCESSFUL)
        result.error_string = motion.reason
        _end(handle, motion)
        return result

    def _command(self, goal: FollowJointTrajectory.Goal) -> tuple[JointTrajectory, Tolerances]:
        samples = joint_trajectory_from_message(goal.trajectory, list(self._joints))
        efforts = joint_efforts_from_message(goal.trajectory, list(self._joints))
        return JointTrajectory(self._robot.model.joint_names, *samples, efforts), self._tolerances(goal)

    def _tolerances(self, goal: FollowJointTrajectory.Goal) -> Tolerances:
        """The goal's own tolerances, or the defaults; a negative tolerance means unlimited."""
        default = Tolerances()
        goal_time = seconds_from_message(goal.goal_time_tolerance)
        return Tolerances(
            path=self._per_joint("path_tolerance", goal.path_tolerance, default.path),
            goal=self._per_joint("goal_tolerance", goal.goal_tolerance, default.goal),
            goal_time=goal_time or default.goal_time,
        )

    def _per_joint(self, what: str, entries, default: float | np.ndarray) -> np.ndarray:
        given: dict[str, float] = {}
        for entry in entries:
            joint = self._joints.get(entry.name, entry.name)
            if joint not in self._robot.model.joint_names:
                raise InputError(f"{what} names the joint {entry.name!r}; the arm has {', '.join(self._joints)}")
            if joint in given:
                raise InputError(f"{what} names the joint {entry.name!r} twice")
            given[joint] = float(finite(f"{what} of joint {entry.name!r}", entry.position, ()))
        names = self._robot.model.joint_names
        defaults = np.broadcast_to(default, len(names))
        values = [given.get(name, 0.0) or default for name, default in zip(names, defaults, strict=True)]
        return np.array([value if value > 0.0 else np.inf for value in values])

    def _grip(self, handle: ServerGoalHandle) -> GripperCommand.Result:
        command, gripper = handle.request.command, self._robot.model.require_gripper()
        try:
            if not np.isfinite(command.max_effort):
                raise InputError(f"gripper max_effort {command.max_effort} N; it has to be finite")
            opening = self._gripper_position.opening(gripper, command.position)
            motion = self._loop.grip(self._robot.name, opening, max(0.0, command.max_effort))
        except HmapError as error:
            self._node.get_logger().warning(str(error))
            handle.abort()
            return GripperCommand.Result()
        self._wait(handle, motion, lambda: self._loop.cancel_gripper(self._robot.name), None)
        result = GripperCommand.Result()
        if motion.state is not None:
            result.position = self._gripper_position.position(gripper, float(motion.state.opening))
            result.effort = float(motion.state.effort)
        result.stalled = motion.outcome is Outcome.STALLED
        result.reached_goal = motion.outcome is Outcome.SUCCEEDED
        _end(handle, motion)
        return result

    def _wait(self, handle: ServerGoalHandle, motion: Motion, cancel, feedback) -> None:
        asked = False
        while not motion.done.wait(POLL):
            if handle.is_cancel_requested and not asked:
                asked = True
                cancel()
            if feedback and motion.state is not None:
                handle.publish_feedback(feedback(motion.state))

    def _tracking(self, tracking) -> FollowJointTrajectory.Feedback:
        message = FollowJointTrajectory.Feedback(joint_names=list(self._joints))
        message.header.stamp = time_to_message(self._loop.world.time)  # the same clock as the joint states
        message.desired.positions, message.desired.velocities = tracking.q.tolist(), tracking.qd.tolist()
        message.actual.positions, message.actual.velocities = tracking.q_actual.tolist(), tracking.qd_actual.tolist()
        message.error.positions = tracking.error.tolist()
        return message


def _end(handle: ServerGoalHandle, motion: Motion) -> None:
    if motion.outcome in ENDED_WELL:
        handle.succeed()
    elif motion.outcome is Outcome.CANCELED and handle.is_cancel_requested:
        handle.canceled()
    else:
        handle.abort()
