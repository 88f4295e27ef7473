"""Executes a plan through the controllers, stretch by stretch, and watches the objects between the stretches.

It stops where a body that the plan does not know comes in its way.
"""

from collections.abc import Callable, Mapping

import numpy as np

from hmap.supervision.clock import StretchClock
from hmap.supervision.controllers import Command, Controllers
from hmap.supervision.scene_monitor import SceneMonitor
from hmap_core import transforms
from hmap_core.exceptions import Code, ExecutionError, MotionError
from hmap_core.execution.drift import DriftTolerance, drift_reason
from hmap_core.execution.halt import Halt, halt
from hmap_core.execution.stretches import Stretch, check_executable, joint_trajectory, stretches
from hmap_core.planner.conflicts import Conflict, first_conflict, unknown_bodies
from hmap_core.planner.interruption import back_to, clear_sample, contact_at, good_until, release, stable_sample
from hmap_core.planner.place_tool import grip_at, plan_place, tools_used
from hmap_core.planner.planned_contacts import PlannedContact
from hmap_core.trajectory.measured import upright
from hmap_core.trajectory.samples import index_at, poses_at
from hmap_core.types import Body, BodyKind, JointTrajectory, Plan, SceneState

MOVING = 1e-6  # rad; a joint that moves less in a stretch stands still
OPENING_CHANGE = 1e-4  # m; a smaller change of the opening needs no command
EMPTY = 0.005  # m that the fingers may close beyond the planned opening when they hold something
LOST_POSITION, LOST_ANGLE = 0.05, np.deg2rad(30.0)  # m, rad off the plan at which a body counts as lost
HANG = 120.0  # s of real time for one stretch, beyond its planned duration
GRIP_LIMIT = 30.0  # s of real time for a gripper
STATE_PATIENCE = 5.0  # s for a world state
LEAD = 0.15  # s of real time that a command takes at most to reach its controller
TOLD = 0.01  # rad that joints may be from where they were told to be for that to count as their place
BACK_OFF = 0.2  # s of the plan before a place too near to a new body to which a hand goes back
SAME_TIME = 1e-6  # s
PLACE_LIMIT = 20.0  # s to plan how a tool is put back

OnProgress = Callable[[float, float, str], None]  # planned time now and at the end (s), what is done


class Blocked(ExecutionError):
    """A body that the plan does not know is in its way; robots stand, hands are free.

    Attributes:
        conflict: what meets what, and when.
        at: planned time (s) up to which the object went its way.
    """

    default_code = Code.WAY_BLOCKED

    def __init__(self, conflict: Conflict, at: float):
        super().__init__(f"{conflict.body!r} is in the way of {conflict.what!r} at {conflict.time:.2f} s of the plan")
        self.conflict, self.at = conflict, at


class _Stop(Exception):
    """The plan cannot be followed to the next place where the hands are free."""

    def __init__(self, conflict: Conflict):
        self.conflict = conflict


class Follower:
    """Follows plans; one at a time."""

    def __init__(
        self,
        controllers: Controllers,
        scene_monitor: SceneMonitor,
        canceled: Callable[[], bool],
        on_stop: Callable[[str], None] = lambda text: None,
    ):
        """
        Args:
            canceled: asked while waiting; true stops the motion.
            on_stop: called with what is in the way when everything is about to stop.
        """
        self._controllers, self._scene_monitor, self._canceled = controllers, scene_monitor, canceled
        self._on_stop = on_stop
        self._told: dict[str, np.ndarray] = {}  # robot -> where its joints were sent last
        self._held: dict[str, str] = {}  # robot -> what it grips
        self._at: tuple[Plan, int] | None = None  # what was followed, and up to which sample

    def follow(self, plan: Plan, on_progress: OnProgress) -> None:
        """Execute a plan from its start to its end.

        Raises:
            InputError: the plan cannot be executed at all.
            Blocked: a body that the plan does not know is in the way.
            ExecutionError: TRACKING_LOST, OBJECT_DROPPED, GOAL_MISSED.
            PlannerError: CANCELED; the motion was stopped.
        """
        check_executable(plan)
        time = plan.trajectory.time
        self._on_progress = on_progress
        self._openings: dict[str, float] = {}
        self._held = {}
        self._watched: Mapping[str, Body] | None = None
        self._until: tuple[float, Conflict] | None = None
        self._at = (plan, 0)
        tools, moved = tools_used(plan), False
        pieces = stretches(plan)
        for stretch in pieces:
            on_progress(float(time[stretch.first]), float(time[-1]), stretch.label)
            clock = StretchClock(plan, stretch, {})
            try:
                self._look(plan, clock)
                if self._until is not None and time[stretch.first] >= self._until[0] - SAME_TIME:
                    conflict = self._until[1]
                    self.free_hands()
                    raise Blocked(conflict, float(time[stretch.first]))
                self._grip(plan, stretch, clock)
                self._move(plan, stretch)
            except _Stop as stop:
                self._on_stop(f"{stop.conflict.body!r} is in the way of {stop.conflict.what!r}")
                at = getattr(stop, "at", float(time[stretch.first]))
                raise Blocked(stop.conflict, self._leave(plan, at)) from None
            self._at = (plan, stretch.last)
            self._watch(plan, stretch.last)
            if set(stretch.touched) - tools:
                moved = True
            elif moved and (stretch.free or stretch.held) and stretch is not pieces[-1]:
                self._watch_drift(plan, stretch.last)
                moved = False

    def told(self, state: SceneState) -> SceneState:
        """The state with the joints where they were told to be, so that what starts there starts without a jump.

        What is as high and as upright as planned, but for noise, is so.
        """
        state = state.copy()
        if self._at is not None:
            for name, planned in poses_at(*self._at).items():
                if name in state.poses:
                    state.poses[name] = upright(state.poses[name], planned)
        for robot, q in self._told.items():
            if robot in state.q and np.abs(q - state.q[robot]).max() <= TOLD:
                state.q[robot] = q.copy()
        return state

    def free_hands(self) -> None:
        """Put back the tools that are in hands; open what holds something else, or where that cannot be done."""
        if self._at is None:
            return
        plan, sample = self._at
        tools = tools_used(plan)
        for robot, body in dict(self._held).items():
            grip = grip_at(plan, robot, body, sample) if body in tools else None
            try:
                if grip is None:
                    raise MotionError(f"{body!r} in the hand of {robot!r} is no tool that was taken")
                state = self.told(self._scene_monitor.settled(STATE_PATIENCE))
                way = plan_place(self._scene_monitor.scene(), state, grip, 0, PLACE_LIMIT)
            except MotionError:
                gripper = plan.scene.robots[robot].model.gripper
                self._open(plan, robot, gripper.open_opening)
                continue
            self.follow(way, self._on_progress)

    # what comes in the way

    def _look(self, plan: Plan, clock: StretchClock) -> None:
        """Where bodies have come or moved: can the plan be followed on? Raises _Stop where it cannot."""
        scene = self._scene_monitor.scene()
        if scene is None or scene.bodies is self._watched:
            return
        self._watched = scene.bodies
        new = unknown_bodies(plan, scene.bodies)
        now = clock.now()
        conflict = first_conflict(plan, new, now)
        if conflict is None:
            self._until = None
            return
        until = good_until(plan, now, conflict)
        if until is None:
            raise _Stop(conflict)
        self._until = (until, conflict)

    def _stop(self, plan: Plan, stretch: Stretch, commands: dict[str, Command], clock: StretchClock) -> float:
        """Bring everything to rest along the path; the planned time (s) of the place."""
        ahead = clock.now() + LEAD * clock.rate
        stop = halt(plan, stretch, ahead)
        slowing = list(commands.values())
        if stop.rests < plan.trajectory.time[stretch.last] - SAME_TIME:  # else it ends before it could stop
            slowing = [
                self._send(plan, robot, _with_way_there(plan, robot, stretch, stop), clock.start) for robot in commands
            ]
        self._controllers.wait(slowing, self._canceled, HANG)
        return stop.rests

    def _leave(self, plan: Plan, at: float) -> float:
        """Let the hand come free of the object; the planned time (s) up to which the object went its way."""
        if set(self._held.values()) & tools_used(plan):
            self._at = (plan, index_at(plan.trajectory.time, at))
            self.free_hands()
            return at
        contact = contact_at(plan, at)
        if contact is None:
            return at
        time, robot = plan.trajectory.time, contact.segment.robot
        if at <= time[contact.begin] + SAME_TIME:
            sample = min(clear_sample(plan, contact, at), self._free_sample(plan, contact, at))
            if time[sample] < at - SAME_TIME:
                self._open(plan, robot, float(plan.trajectory.gripper[robot][sample]))
                self._go_back(plan, contact, sample, at)
            return float(time[contact.first])
        left = np.abs(plan.trajectory.joints[robot][index_at(time, at)] - plan.trajectory.joints[robot][contact.end])
        if at > time[contact.end] + SAME_TIME and left.max() > MOVING:
            return at
        sample = stable_sample(plan, contact, min(at, float(time[contact.end])))
        if time[sample] < at - 2.0 * (time[1] - time[0]):
            self._go_back(plan, contact, sample, at)
            at = float(time[sample])
        self._let_go(plan, contact)
        return at

    def _free_sample(self, plan: Plan, contact: PlannedContact, at: float) -> int:
        """The last sample on the way to a contact, up to ``at`` (s), before the way comes too near to a new body."""
        time = plan.trajectory.time
        new = unknown_bodies(plan, self._scene_monitor.scene().bodies)
        conflict = first_conflict(plan, new, float(time[contact.first]), at)
        until = at if conflict is None else conflict.time - BACK_OFF
        return max(contact.first, index_at(time, until))

    def _go_back(self, plan: Plan, contact: PlannedContact, sample: int, at: float) -> None:
        robot = contact.segment.robot
        state = self.told(self._scene_monitor.settled(STATE_PATIENCE))
        motion = back_to(plan, robot, sample, state.q[robot], at)
        if motion is not None:
            self._controllers.wait([self._send(plan, robot, motion)], self._canceled, HANG)

    def _let_go(self, plan: Plan, contact: PlannedContact) -> None:
        state = self.told(self._scene_monitor.settled(STATE_PATIENCE))
        opening, motion = release(self._scene_monitor.scene(), state, plan, contact)
        self._open(plan, contact.segment.robot, opening)
        if motion is not None:
            self._controllers.wait([self._send(plan, contact.segment.robot, motion)], self._canceled, HANG)

    def _open(self, plan: Plan, robot: str, opening: float) -> None:
        gripper = plan.scene.robots[robot].model.gripper
        if gripper is not None:
            command = self._controllers.grip(robot, opening, gripper.force)
            self._controllers.wait([command], self._canceled, GRIP_LIMIT)
        self._held.pop(robot, None)

    # the plan

    def _grip(self, plan: Plan, stretch: Stretch, clock: StretchClock) -> None:
        """Close on what is held from here, open what is let go, and wait until the fingers stand."""
        commands = {}
        for robot, placed in plan.scene.robots.items():
            gripper = placed.model.gripper
            if gripper is None:
                continue
            if robot in stretch.held:
                if self._held.get(robot) != stretch.held[robot]:
                    commands[robot] = self._controllers.grip(robot, gripper.min_opening, gripper.force)
                    self._openings.pop(robot, None)
                continue
            opening = float(plan.trajectory.gripper[robot][stretch.last])
            if abs(self._openings.get(robot, np.inf) - opening) > OPENING_CHANGE:
                commands[robot] = self._controllers.grip(robot, opening, gripper.force)
                self._openings[robot] = opening
        self._controllers.wait(list(commands.values()), self._canceled, GRIP_LIMIT)
        self._held = dict(stretch.held)
        for robot, command in commands.items():
            if robot in stretch.held:
                self._check_grip(plan, stretch, robot, command.result.position)
        self._look(plan, clock)

    def _check_grip(self, plan: Plan, stretch: Stretch, robot: str, opening: float) -> None:
        planned = float(plan.trajectory.gripper[robot][stretch.first])
        if opening < planned - EMPTY:
            raise ExecutionError(
                f"the gripper of {robot!r} closed to {opening:.3f} m without {stretch.held[robot]!r} between its "
                f"fingers; {planned:.3f} m were planned",
                Code.OBJECT_DROPPED,
            )

    def _move(self, plan: Plan, stretch: Stretch) -> None:
        commands, duration = {}, 0.0
        for robot in plan.scene.robots:
            motion = joint_trajectory(plan, robot, stretch)
            if np.ptp(motion.positions, axis=0).max() > MOVING:
                duration = float(motion.times[-1])
                commands[robot] = self._send(plan, robot, motion)
        clock = StretchClock(plan, stretch, commands)

        def look() -> None:
            if all(command.feedback for command in commands.values()):  # else nobody knows how far it is
                self._look(plan, clock)

        try:
            self._controllers.wait(list(commands.values()), self._canceled, duration + HANG, look)
        except _Stop as stop:
            stop.at = self._stop(plan, stretch, commands, clock)
            raise

    def _send(self, plan: Plan, robot: str, motion: JointTrajectory, start: float | None = None) -> Command:
        self._told[robot] = np.array(motion.positions[-1])
        return self._controllers.move(plan.scene, robot, motion, start)

    def _watch(self, plan: Plan, sample: int) -> None:
        """Raises ExecutionError where something is lost."""
        _, state = self._scene_monitor.state(STATE_PATIENCE)
        if _lost(plan, sample, state):
            state = self._scene_monitor.settled(STATE_PATIENCE)  # that state may be of before the end of the stretch
        for reason in _lost(plan, sample, state):
            raise ExecutionError(reason, Code.OBJECT_DROPPED)

    def _watch_drift(self, plan: Plan, sample: int) -> None:
        """Raises ExecutionError where the rest of the plan is of no use, with free hands."""
        _, state = self._scene_monitor.state(STATE_PATIENCE)
        if _drift(plan, sample, state) is None:
            return
        reason = _drift(plan, sample, self._scene_monitor.settled(STATE_PATIENCE))
        if reason is not None:
            self.free_hands()
            raise ExecutionError(reason, Code.GOAL_MISSED)


def _drift(plan: Plan, sample: int, state: SceneState) -> str | None:
    """What is too far off the plan.

    The goal's object may be as far off as in the end, once the plan leaves it alone; a tool in any way, once nothing
    more is done with it.
    """
    planned, goal, now = poses_at(plan, sample), plan.scene.goal, plan.trajectory.time[sample]
    ahead = [segment for segment in plan.segments if segment.start >= now - SAME_TIME]
    for tool in tools_used(plan) - {segment.manipulator for segment in ahead}:
        del planned[tool]
    if not any(segment.object == goal.object for segment in ahead):
        del planned[goal.object]
        allowed = DriftTolerance(*plan.scene.execution_tolerance)
        reason = drift_reason({goal.object: goal.pose}, state.poses, allowed)
        if reason is not None:
            return reason
    return drift_reason(planned, state.poses)


def _with_way_there(plan: Plan, robot: str, stretch: Stretch, halted: Halt) -> JointTrajectory:
    """The motion of a robot in a stretch that ends in a stop; a controller leaves out what is past."""
    planned, stop = joint_trajectory(plan, robot, stretch), halted.motions[robot]
    rows = planned.times < stop.times[0] - SAME_TIME
    parts = [(planned.times[rows], stop.times), (planned.positions[rows], stop.positions)]
    parts.append((planned.velocities[rows], stop.velocities))
    return JointTrajectory(planned.names, *(np.concatenate(pair) for pair in parts))


def _lost(plan: Plan, sample: int, state: SceneState) -> list[str]:
    """What has become of the bodies that are far from where the plan has them."""
    reasons = []
    for name, body in plan.scene.bodies.items():
        if body.kind is BodyKind.FIXED or name not in state.poses:
            continue
        distance, angle = transforms.distance(plan.trajectory.objects[name][sample], state.poses[name])
        if distance > LOST_POSITION or angle > LOST_ANGLE:
            reasons.append(
                f"{name!r} is {distance:.3f} m and {np.rad2deg(angle):.0f} deg off the plan at "
                f"{plan.trajectory.time[sample]:.2f} s; {LOST_POSITION} m, {np.rad2deg(LOST_ANGLE):.0f} deg allowed"
            )
    return reasons
