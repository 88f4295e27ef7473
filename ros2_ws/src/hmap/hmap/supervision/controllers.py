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
from hmap.supervision.gripper_position import GripperPosition
from hmap.supervision.progress import Progress, start_problem
from hmap.supervision.scene_monitor import SceneMonitor
from hmap_core.exceptions import Code, ExecutionError, PlannerError
from hmap_core.execution.ports import Canceled, Feedback
from hmap_core.types import JointTrajectory, Robot, SceneState
from hmap_msgs_py.checks import ConversionError
from hmap_msgs_py.times import joint_trajectory_to_message, seconds_from_message, time_to_message

POLL = 0.05  # s between looks at a cancel
START_TOGETHER = 0.5  # s of the controllers' clock in which the goals of several arms reach their controllers
CANCEL_TIMEOUT = 5.0  # s for a controller to come to rest after a cancel
SILENT_TIMEOUT = 0.5  # s, the same of a controller that has not answered or does not move
CONTROLLER_TIMEOUT = 5.0  # s
START_TOLERANCE = 0.03  # rad
START_PATIENCE = 1.5  # s; the measured state comes late


class Command:
    """A goal that was sent to a controller."""

    def __init__(
        self,
        name: str,
        client: ActionClient,
        goal,
        news: threading.Event,
        joints: Sequence[str] = (),
        progress: Progress | None = None,
        opening_of: Callable[[float], float] = float,
    ):
        """
        Args:
            news: set when it has ended.
            joints: names on the wire, in whose order reported positions are wanted.
            progress: compares it with what is measured.
            opening_of: the opening (m) of a gripper at a position that is reported.
        """
        self.name, self.progress = name, progress
        self.sent = time.monotonic()
        self._opening_of = opening_of
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
        return self._opening_of(float(self.result.position))

    def cancel(self) -> None:
        """Ask the controller to stop, now or as soon as it has taken the goal."""
        with self._lock:
            self._cancel = True
            handle = self._handle
        if handle is not None and not self.done:
            handle.cancel_goal_async()

    def give_up(self) -> None:
        """Wait for it no longer; it is canceled as soon as the controller answers."""
        self._end()

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

    def __init__(
        self,
        node: HmapNode,
        naming: Naming,
        monitor: SceneMonitor,
        timeout: float = CONTROLLER_TIMEOUT,
        start_tolerance: float = START_TOLERANCE,
        gripper_position: GripperPosition | None = None,
    ):
        """
        Args:
            node: that sends the commands.
            naming: of joints and actions.
            monitor: knows what is measured.
            timeout: s to wait for a controller that is not there, does not answer, or does not move.
            start_tolerance: rad that a joint may be off the start of a trajectory.
            gripper_position: what the positions of grippers mean; None: gaps.
        """
        self._node, self._naming, self._monitor = node, naming, monitor
        self._timeout, self._start_tolerance = timeout, start_tolerance
        self._gripper_position = gripper_position or GripperPosition()
        self._clients: dict[str, ActionClient] = {}
        self._sent: list[Command] = []  # under way, and those that have just ended
        self._tracking_error = 0.0
        self._accepted = 0  # commands that have ended
        self.locked = False  # nothing may be sent
        self.news = threading.Event()  # set when a command has ended, or by others, so that who waits looks again

    @property
    def tracking_error(self) -> float:
        """Largest deviation of any joint from its commanded position that was reported so far, rad."""
        return max([self._tracking_error, *(command.tracking_error for command in self._sent)])

    @property
    def accepted(self) -> int:
        """How many commands controllers have accepted so far."""
        return self._accepted + sum(command.accepted for command in self._sent)

    def move(self, robot: Robot, motion: JointTrajectory, start: float | None = None) -> Command:
        """Send an arm along a trajectory; its times count from ``start`` (s of the controller's clock), or from now.

        Raises:
            InputError: STALE_STATE; it is not known where the robot is.
            ExecutionError: SERVICE_UNAVAILABLE; TRACKING_LOST, the arm does not stand where the trajectory starts.
        """
        action = self._naming.arm_action(robot.name)
        if all(command.done for command in self._sent if command.name == action):  # else it replaces a running one
            self._check_start(robot, motion)
        names = self._naming.arm_joints(robot.name, robot.model)
        samples = motion.times, motion.positions, motion.velocities, motion.efforts
        trajectory = joint_trajectory_to_message(names, *samples)
        if start is not None:
            trajectory.header.stamp = time_to_message(start)
        goal = FollowJointTrajectory.Goal(trajectory=trajectory)
        progress = Progress(robot, self._timeout, motion, start)
        return self._send(FollowJointTrajectory, action, goal, names, progress=progress)

    def common_start(self) -> float | None:
        """START_TOGETHER from now on the node's clock; None where that has no time yet.

        It waits until the arms have been measured at rest, so that the goals can be sent without a delay afterwards.
        """
        began, until = clock_time(self._node), time.monotonic() + START_PATIENCE
        while began is not None and time.monotonic() < until and self._measured()[0] <= began:
            self._node.stopping.wait(POLL)
        now = clock_time(self._node)
        return None if now is None else now + START_TOGETHER

    def grip(self, robot: Robot, opening: float, force: float) -> Command:
        """Send a gripper to an opening (m) with at most ``force`` (N).

        Raises:
            ExecutionError: SERVICE_UNAVAILABLE.
        """
        goal, gripper = GripperCommand.Goal(), robot.model.require_gripper()
        goal.command.position = self._gripper_position.position(gripper, float(opening))
        goal.command.max_effort = float(force)
        return self._send(
            GripperCommand,
            self._naming.gripper_action(robot.name),
            goal,
            progress=Progress(robot, self._timeout),
            opening_of=lambda position: self._gripper_position.opening(gripper, position),
        )

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
            ExecutionError: TRACKING_LOST, one failed; CONTROLLER_LOST, one does not answer or does not move;
                STALE_STATE, nothing is measured any more. Everything was stopped.
        """
        until = time.monotonic() + limit
        while not all(command.done for command in commands):
            if canceled():
                self._stop(commands)
                raise PlannerError("canceled; the motion was stopped", Code.CANCELED)
            self._check_alive(commands)
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

    def _stop(self, commands: Sequence[Command], silent: Sequence[Command] = ()) -> None:
        """Cancel commands and wait until they have ended; those of silent controllers only for a moment."""
        for command in commands:
            command.cancel()
        began = time.monotonic()
        for command in commands:
            limit = CANCEL_TIMEOUT if command.accepted and command not in silent else SILENT_TIMEOUT
            if not command.ended.wait(max(0.0, began + limit - time.monotonic())):
                command.give_up()

    def _check_start(self, robot: Robot, motion: JointTrajectory) -> None:
        """Compare the start of a trajectory with where an arm is measured, as soon as a new measurement has come."""
        until = time.monotonic() + START_PATIENCE
        while problem := start_problem(robot, motion, self._measured()[1], self._start_tolerance):
            if time.monotonic() > until or self._node.stopping.wait(POLL):
                raise ExecutionError(problem, Code.TRACKING_LOST)

    def _measured(self) -> tuple[float, SceneState]:
        """The newest stamp (s) and state; waits for it as long as for a controller."""
        return self._monitor.state(self._timeout)

    def _check_alive(self, commands: Sequence[Command]) -> None:
        """Check that controllers answer and robots move, and that this is seen; else stop everything.

        Raises:
            ExecutionError: CONTROLLER_LOST, STALE_STATE.
        """
        running = [command for command in commands if not command.done]
        newest = self._monitor.newest()
        if self._monitor.silent():
            self._stop(commands)
            raise ExecutionError(
                "no world state comes any more, so the motion was stopped: is perception running, and do its sensors "
                "speak?",
                Code.STALE_STATE,
            )
        if newest is None:
            return  # a body has just come, and the next state tells of it
        for command in running:
            problem = self._problem(command, *newest)
            if problem and not command.done:
                self._stop(commands, silent=[command])
                raise ExecutionError(f"the controller {command.name!r} is lost: {problem}", Code.CONTROLLER_LOST)

    def _problem(self, command: Command, stamp: float, state: SceneState) -> str:
        if command.accepted:
            return command.progress.problem(stamp, state) if command.progress else ""
        waited = time.monotonic() - command.sent
        return f"it has not answered for {waited:.1f} s" if waited > self._timeout else ""

    def _send(self, kind: type, name: str, goal, joints: Sequence[str] = (), **options: Any) -> Command:
        if self.locked:
            raise ExecutionError(f"nothing is sent to {name!r} in a dry run", Code.SERVICE_UNAVAILABLE)
        if name not in self._clients:
            self._clients[name] = ActionClient(self._node, kind, name, callback_group=self._node.group)
        client = self._clients[name]
        if not client.wait_for_server(self._timeout):
            raise ExecutionError(
                f"no controller has offered the action {name!r} for {self._timeout:g} s", Code.SERVICE_UNAVAILABLE
            )
        command = Command(name, client, goal, self.news, joints, **options)
        self._tracking_error = self.tracking_error
        self._accepted += sum(sent.done and sent.accepted for sent in self._sent)
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
