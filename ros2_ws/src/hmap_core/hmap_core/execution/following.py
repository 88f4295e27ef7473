"""One plan followed stretch by stretch: gripping, moving, watching, stopping, and the verdict at the end."""

from collections.abc import Callable, Mapping

import numpy as np

from hmap_core.exceptions import Code, ExecutionError
from hmap_core.execution.failures import Blocked
from hmap_core.execution.hands import Hands
from hmap_core.execution.obstacles import MOVING, ObstacleMonitor, StopNow
from hmap_core.execution.ports import Ports
from hmap_core.execution.report import Deviation, ExecutionReport
from hmap_core.execution.stretch_clock import StretchClock
from hmap_core.execution.stretches import Stretch, check_executable, joint_trajectory, stretches
from hmap_core.execution.tool_offsets import ToolOffsets
from hmap_core.execution.watcher import MOVED_LIMIT, Watcher, deviation
from hmap_core.trajectory.samples import index_at
from hmap_core.types import Plan

OnStop = Callable[[str], None]  # called with what is in the way when everything is about to stop


class Following:
    """A plan that is being followed.

    Attributes:
        plan: what is followed.
        stretches: its stretches, in order.
        sample: up to which it was followed; in a stretch that failed, the end of the stretch.
        watcher: of the bodies.
    """

    def __init__(
        self,
        plan: Plan,
        ports: Ports,
        hands: Hands,
        free_tools: Callable[[Plan, int], bool],
        places: Mapping[str, np.ndarray] | None = None,
        on_stop: OnStop = lambda text: None,
    ):
        """
        Args:
            plan: to follow.
            ports: to controllers and world.
            hands: the arms and grippers.
            free_tools: frees the hands that hold tools at a sample of a plan; whether there were any.
            places: body -> the pose (7,) from which its motion counts where the plan leaves it alone.
            on_stop: called before everything stops.

        Raises:
            InputError: the plan is kinematic, or inconsistent with its scene.
        """
        check_executable(plan)
        self.plan, self.stretches, self.sample = plan, stretches(plan), 0
        self._stretch = self.stretches[0]
        self.watcher = Watcher(plan, ports, places)
        self._ports, self._hands, self._on_stop = ports, hands, on_stop
        self._tools = ToolOffsets(plan)
        self._obstacles = ObstacleMonitor(plan, ports, hands, lambda sample: free_tools(plan, sample))

    def look_at_tools(self, sample: int, tools: Mapping[str, str]) -> None:
        """At rest: see how tools are held; from now on the hands move so that the tools follow the plan.

        Args:
            sample: of the plan, up to which it was followed.
            tools: robot -> the tool that it holds.

        Raises:
            InputError: STALE_STATE; there is no state.
        """
        if tools:
            state = self._ports.observation.settled()
            for robot, tool in tools.items():
                self._tools.look(robot, tool, sample, state)

    def follow(self, stretch: Stretch) -> None:
        """Execute one stretch: grip or let go, then move. Where a body comes in the way, stop and free the hands.

        Raises:
            InputError: a controller refuses a command.
            Blocked: a body that the plan does not know is in the way.
            ExecutionError: TRACKING_LOST; OBJECT_DROPPED, a gripper closes on nothing, or a body slips or falls.
            PlannerError: CANCELED; everything was stopped.
        """
        self._stretch = stretch
        self.sample, at = stretch.last, float(self.plan.trajectory.time[stretch.first])
        clock = StretchClock(self.plan, stretch)
        try:
            self._obstacles.look(clock)
            self._obstacles.check(stretch)
            self._hands.grip(self.plan, stretch, lambda: self._watch(stretch.first))
            self._obstacles.look(clock)
            self.watcher.mark(stretch.first, self._ports.observation.state())
            stopped = self._move(stretch)
        except StopNow as stop:
            stopped = stop.conflict, at
        if stopped is not None:
            conflict, at = stopped
            self._on_stop(f"{conflict.body!r} is in the way of {conflict.what!r}")
            self.sample = index_at(self.plan.trajectory.time, at)
            raise Blocked(conflict, self._obstacles.leave(at))
        self.watcher.mark(stretch.last, self._ports.observation.state())

    def back_off(self) -> None:
        """Bring what a blocked robot carries back along the plan to where it stood, and let it go there.

        Raises:
            PlannerError: CANCELED.
            ExecutionError: TRACKING_LOST; the way back is blocked: the hands keep it.
        """
        held, plan = self._hands.held, self.plan
        if not held:
            return
        q, rows = self._ports.observation.settled().q, slice(self._stretch.first, self._stretch.last + 1)
        off = np.array([np.abs(plan.trajectory.joints[robot][rows] - q[robot]).max(axis=1) for robot in held])
        at = self._stretch.first + int(off.max(axis=0).argmin())
        self.sample = index_at(plan.trajectory.time, self._obstacles.leave(float(plan.trajectory.time[at])))

    def report(self, began: float, strict: bool, failure: ExecutionError | None = None) -> ExecutionReport:
        """Stop, let everything come to rest, and judge the outcome.

        Args:
            began: when the execution began, s of the executor's clock.
            strict: whether bodies that moved although they should stay count.
            failure: why the plan was not followed to its end.
        """
        self._ports.controllers.stop()
        state = self._ports.observation.settled()
        if failure is None and strict:
            failure = self._fallen_at_the_end()
        goal = self.plan.scene.goal
        error = deviation(goal.pose, state.poses[goal.object])
        code, reason = self._verdict(error, strict, failure)
        return ExecutionReport(
            solved=code is Code.SUCCESS,
            goal_error=error,
            code=code,
            reason=reason,
            drift=self.watcher.segment_drift(),
            fell=tuple(self.watcher.fell),
            moved=tuple(self.watcher.moved),
            tracking_error_max=self._ports.controllers.tracking_error,
            duration=self._ports.clock.now() - began,
        )

    def _move(self, stretch: Stretch):
        """Move the arms to the end of a stretch, or until something is in the way: then the conflict and the time."""
        robots = self.plan.scene.robots
        motions = {name: joint_trajectory(self.plan, name, stretch) for name in robots}
        motions = {name: own for name, own in motions.items() if np.ptp(own.positions, axis=0).max() > MOVING}
        motions = {name: self._tools.corrected(name, own, name in stretch.held) for name, own in motions.items()}
        moving = self._hands.start(robots, motions)
        clock = StretchClock(self.plan, stretch, moving.clock_now)

        def look() -> None:
            self._watch(index_at(self.plan.trajectory.time, clock.now()))
            if moving.known:  # else nobody knows how far it is
                self._obstacles.look(clock)

        try:
            moving.follow(look)
        except StopNow as stop:
            return stop.conflict, float(self.plan.trajectory.time[stretch.first]) + moving.brake()
        return None

    def _watch(self, sample: int) -> None:
        self.watcher.look(sample, self._hands.held)

    def _fallen_at_the_end(self) -> ExecutionError | None:
        try:
            self.watcher.look(len(self.plan.trajectory.time) - 1, {})
        except ExecutionError as fall:
            return fall
        return None

    def _verdict(self, error: Deviation, strict: bool, failure: ExecutionError | None) -> tuple[Code, str]:
        if failure is not None:
            return failure.code, failure.reason
        for name, distance in self.watcher.moved.items() if strict else ():
            return Code.GOAL_MISSED, f"'{name}' should stay and moved by {distance:.3f} m; {MOVED_LIMIT} m are allowed"
        distance, angle = self.plan.scene.execution_tolerance
        if not (error.position_m <= distance and error.rotation_deg <= np.rad2deg(angle)):  # nor when not a number
            return Code.GOAL_MISSED, (
                f"'{self.plan.scene.goal.object}' ends {error.position_m:.3f} m and {error.rotation_deg:.1f} deg from "
                f"its goal; {distance:.3f} m and {np.rad2deg(angle):.1f} deg are allowed"
            )
        return Code.SUCCESS, ""
