"""The controllers of a plan executor over actions: commands to arms and grippers, waiting by events."""

import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from action_msgs.msg import GoalStatus
from control_msgs.action import FollowJointTrajectory, GripperCommand
from rclpy.action.client import ClientGoalHandle

from hmap.action_client import ActionClient
from hmap.naming import Naming
from hmap.node import HmapNode, clock_time
from hmap_core.exceptions import Code, ExecutionError, PlannerError
from hmap_core.execution.ports import Canceled, Feedback
from hmap_core.types import JointTrajectory, Robot
from hmap_msgs_py.checks import ConversionError
from hmap_msgs_py.times import joint_trajectory_to_message, seconds_from_message, time_to_message

POLL = 0.05  # s between looks at a cancel
START_TOGETHER = 0.5  # s of the controllers' clock in which the goals of several arms reach their controllers
CANCEL_TIMEOUT = 5.0  # s for a controller to come to rest after a cancel


class Command:
    """A goal that was sent to a controller."""

    def __init__(self, name: str, client: ActionClient, goal, news: threading.Event, joints: Sequence[str] = ()):
        """
        Args:
            news: set when it has ended.
            joints: names on the wire, in whose order reported positions are wanted.
        """
        self.name = name
        self.ended = threading.Event()
        self.feedback: tuple[Feedback, ...] = ()  # the first and the newest
        self.tracking_error = 0.0  # rad, the largest that was reported
        self.status = GoalStatus.STATUS_UNKNOWN
        self.result: Any = None  # of the action's type
        self.accepted = False
        self._handle: ClientGoalHandle | None = None
        self._cancel = False
        self._lock = threading.Lock()
        self._news, self._joints = news, list(joints)
        client.send_goal_async(goal, self._report).add_done_callback(self._answered)

    @property
    def done(self) -> bool:
        """Whether it has ended."""
        return self.ended.is_set()

    @property
    def opening(self) -> float:
        """Opening of a gripper when its command ended, m."""
        return float(self.result.position)

    def cancel(self) -> None:
        """Ask the controller to stop, now or as soon as it has taken the goal."""
        with self._lock:
            self._cancel = True
            handle = self._handle
        if handle is not None and not self.done:
            handle.cancel_goal_async()

    def _report(self, message) -> None:
        """Note the feedback of an arm's controller; parts that are missing or malformed are left out."""
        feedback, count = message.feedback, len(self._joints)
        if not self._joints or sorted(feedback.joint_names) != sorted(self._joints):
            return
        errors = np.abs(feedback.error.positions)
        if len(errors) == count and np.isfinite(errors).all():
            self.tracking_error = max(self.tracking_error, float(errors.max()))
        positions = np.array(feedback.desired.positions, float)
        if len(positions) != count or not np.isfinite(positions).all():
            return
        try:
            stamp = seconds_from_message(feedback.header.stamp)
        except ConversionError:
            return
        if self.feedback and stamp < self.feedback[-1].stamp:
            return  # overtaken by a newer one
        at = dict(zip(feedback.joint_names, positions, strict=True))
        entry = Feedback(time.monotonic(), stamp, np.array([at[name] for name in self._joints]))
        self.feedback = (*self.feedback[:1], entry)

    def _end(self) -> None:
        self.ended.set()
        self._news.set()

    def _answered(self, future) -> None:
        handle = future.result()
        if not handle.accepted:
            self._end()
            return
        self.accepted = True
        with self._lock:
            self._handle = handle
            cancel = self._cancel
        if cancel:
            handle.cancel_goal_async()
        handle.get_result_async().add_done_callback(self._finished)

    def _finished(self, future) -> None:
        response = future.result()
        self.status, self.result = response.status, response.result
        self._end()


class Controllers:
    """The arms and grippers of a scene; implements :class:`hmap_core.execution.ports.ControllerPort`."""

    def __init__(self, node: HmapNode, naming: Naming, patience: float):
        """
        Args:
            patience: s to wait for a controller that is not there.
        """
        self._node, self._naming, self._patience = node, naming, patience
        self._clients: dict[str, ActionClient] = {}
        self._sent: list[Command] = []  # under way, and those that have just ended
        self._tracking_error = 0.0
        self.news = threading.Event()  # set when a command has ended, or by others, so that who waits looks again

    @property
    def tracking_error(self) -> float:
        """Largest deviation of any joint from its commanded position that was reported so far, rad."""
        return max([self._tracking_error, *(command.tracking_error for command in self._sent)])

    def move(self, robot: Robot, motion: JointTrajectory, start: float | None = None) -> Command:
        """Send an arm along a trajectory; its times count from ``start`` (s of the controller's clock), or from now.

        Raises:
            ExecutionError: SERVICE_UNAVAILABLE.
        """
        names = self._naming.arm_joints(robot.name, robot.model)
        samples = motion.times, motion.positions, motion.velocities, motion.efforts
        trajectory = joint_trajectory_to_message(names, *samples)
        if start is not None:
            trajectory.header.stamp = time_to_message(start)
        goal = FollowJointTrajectory.Goal(trajectory=trajectory)
        return self._send(FollowJointTrajectory, self._naming.arm_action(robot.name), goal, names)

    def common_start(self) -> float | None:
        """START_TOGETHER from now on the node's clock; None where that has no time yet."""
        now = clock_time(self._node)
        return None if now is None else now + START_TOGETHER

    def grip(self, robot: Robot, opening: float, force: float) -> Command:
        """Send a gripper to an opening (m) with at most ``force`` (N).

        Raises:
            ExecutionError: SERVICE_UNAVAILABLE.
        """
        goal = GripperCommand.Goal()
        goal.command.position, goal.command.max_effort = float(opening), float(force)
        return self._send(GripperCommand, self._naming.gripper_action(robot.name), goal)

    def wait(
        self,
        commands: Sequence[Command],
        limit: float,
        canceled: Canceled,
        look: Callable[[], None] | None = None,
    ) -> None:
        """Wait until all have ended.

        Args:
            commands: what is waited for.
            limit: s of real time without an end after which a controller is taken to hang.
            canceled: asked while waiting; true stops all commands.
            look: called whenever there is news, and now and then; what it raises ends the waiting, not the commands.

        Raises:
            PlannerError: CANCELED; everything stands.
            ExecutionError: TRACKING_LOST; one failed or hangs, the others were stopped.
        """
        until = time.monotonic() + limit
        while not all(command.done for command in commands):
            if canceled():
                self._stop(commands)
                raise PlannerError("canceled; the motion was stopped", Code.CANCELED)
            failed = next((c for c in commands if c.done and _failure(c)), None)
            if failed or time.monotonic() > until:
                self._stop(commands)
                reason = _failure(failed) if failed else f"no controller finished within {limit:g} s"
                raise ExecutionError(reason, Code.TRACKING_LOST)
            if look is not None:
                look()
            self.news.wait(POLL)
            self.news.clear()
        for command in commands:
            if reason := _failure(command):
                raise ExecutionError(reason, Code.TRACKING_LOST)

    def stop(self) -> None:
        """Cancel every command that is under way, and wait until it has ended."""
        self._stop([command for command in self._sent if not command.done])

    def _stop(self, commands: Sequence[Command]) -> None:
        for command in commands:
            command.cancel()
        for command in commands:
            command.ended.wait(CANCEL_TIMEOUT)

    def _send(self, kind: type, name: str, goal, joints: Sequence[str] = ()) -> Command:
        if name not in self._clients:
            self._clients[name] = ActionClient(self._node, kind, name, callback_group=self._node.group)
        client = self._clients[name]
        if not client.wait_for_server(self._patience):
            raise ExecutionError(f"no controller offers the action {name!r}", Code.SERVICE_UNAVAILABLE)
        command = Command(name, client, goal, self.news, joints)
        self._tracking_error = self.tracking_error
        self._sent = [*(sent for sent in self._sent if not sent.done), command]
        return command


def _failure(command: Command) -> str:
    """Why a command that has ended failed; empty where it did not."""
    if not command.accepted:
        return f"{command.name} refused the goal"
    if command.status == GoalStatus.STATUS_SUCCEEDED:
        return ""
    detail = getattr(command.result, "error_string", "") or f"status {command.status}"
    return f"{command.name}: {detail}"
