"""Executes plans: follows them, looks at the world between contacts, and goes on with a new plan where one is needed.

It knows neither ROS nor the simulation; both are behind :class:`hmap_core.execution.ports.Ports`.
"""

from collections.abc import Callable, Mapping

import numpy as np

from hmap_core.exceptions import Code, ExecutionError, MotionError
from hmap_core.execution.drift import DriftTolerance, drift_reason
from hmap_core.execution.failures import Blocked, Drifted
from hmap_core.execution.following import Following, OnStop
from hmap_core.execution.hands import Hands
from hmap_core.execution.pace import Pace
from hmap_core.execution.ports import Canceled, Ports
from hmap_core.execution.recovery import Recovery, RecoveryPolicy, Replanner
from hmap_core.execution.report import ClosedLoopReport, ExecutionReport
from hmap_core.execution.stretches import Stretch
from hmap_core.execution.watcher import STAY_LIMIT, planned_motion
from hmap_core.planner.interfaces import ToolGrasp
from hmap_core.planner.place_tool import grip_at, plan_place
from hmap_core.trajectory.samples import poses_at
from hmap_core.types import BodyKind, Plan

SLIP = DriftTolerance(0.004, float(np.deg2rad(3.0)))  # of a tool in the fingers; beyond, the hand does not keep it
STOPPED_ON_THE_WAY = (Code.TRACKING_LOST, Code.STALE_STATE)  # after these a hand brings back what it carries
PLACE_LIMIT = 20.0  # s to plan how a tool is placed

Progress = Callable[[float, float, str], None]  # planned time now and at the end (s), what is being done


class PlanExecutor:
    """Executes plans, one at a time.

    It looks at all bodies whenever the robots have drawn back from a contact. A new plan is asked for when a body is
    off the plan, when a body comes in the way, when the object misses its goal at the end, and when something slips
    from a gripper or blocks a robot. Before that the hands become free: a tool that is held as planned stays attached
    where robots merely stand between contacts; else it is placed where it was picked, or, where no motion does that,
    let go like every other body. :class:`hmap_core.execution.recovery.Recovery` decides how often.
    """

    def __init__(
        self,
        ports: Ports,
        canceled: Canceled = lambda: False,
        on_progress: Progress | None = None,
        on_stop: OnStop = lambda text: None,
        on_stretch: Callable[[Stretch], None] | None = None,
        pace: Pace | None = None,
    ):
        """
        Args:
            ports: to controllers, world and clock.
            canceled: asked while waiting; true stops everything.
            on_progress: called at the begin of every stretch.
            on_stop: called with what is in the way when everything is about to stop.
            on_stretch: called after every stretch.
            pace: how fast everything moves; None: as planned.
        """
        self._ports, self._canceled = ports, canceled
        self._on_progress, self._on_stop, self._on_stretch = on_progress, on_stop, on_stretch
        self._hands = Hands(ports, canceled, pace)
        self._tools: dict[str, ToolGrasp] = {}  # robot -> the tool with which the present plan begins

    def run(
        self, plan: Plan, replan: Replanner | None = None, policy: RecoveryPolicy | None = None
    ) -> ClosedLoopReport:
        """Execute a plan, and new plans where the world is not as planned.

        Args:
            plan: to begin with.
            replan: plans the rest from a measured state; None: there are no new plans.
            policy: what is recovered from, and how often; None: the plan is followed to its end.

        Raises:
            InputError: the plan is kinematic, inconsistent with its scene, or refused by a controller; STALE_STATE.
            PlannerError: CANCELED; everything was stopped.
        """
        policy = policy or RecoveryPolicy()
        recovery = Recovery(policy, replan, self._ports, self._canceled)
        began, plans, places = self._ports.clock.now(), [plan], poses_at(plan, 0)
        while True:
            following = self.begin(plans[-1], places)
            report, failure = None, self._followed(following, recovery)
            if failure is None:
                report = following.report(began, policy.strict)
                failure = None if report.solved else ExecutionError(report.reason, report.code)
            new = None
            if failure is not None and recovery.accepts(failure, following.watcher.fell, following.watcher.moved):
                try:
                    new = self._new_plan(following, failure, recovery)
                except ExecutionError as late:
                    report, failure = None, late
            if new is None:
                last = report or self._report(following, failure, began, policy)
                return ClosedLoopReport(last, tuple(recovery.replans), tuple(plans), recovery.error)
            places = self._places(following, places)
            plans.append(new)

    def begin(self, plan: Plan, places: Mapping[str, np.ndarray] | None = None) -> Following:
        """Start to follow a plan; whoever calls this follows its stretches one by one.

        Args:
            plan: to follow.
            places: body -> the pose (7,) from which its motion counts where the plan leaves it alone; None: where the
                plan begins.

        Raises:
            InputError: the plan is kinematic, or inconsistent with its scene.
        """
        return Following(plan, self._ports, self._hands, self._free_tools, places, self._on_stop)

    def _followed(self, following: Following, recovery: Recovery) -> ExecutionError | None:
        """Follow a plan to its end, or until it cannot be followed on: then the reason."""
        moved = False  # anything since the last look
        plan = following.plan
        time = plan.trajectory.time
        try:
            if recovery.may_replan and self._tools:
                following.look_at_tools(0, {robot: grasp.tool for robot, grasp in self._tools.items()})
            for stretch, ahead in zip(following.stretches, (*following.stretches[1:], None), strict=True):
                if self._on_progress:
                    self._on_progress(float(time[stretch.first]), float(time[-1]), stretch.label)
                following.follow(stretch)
                look = recovery.may_replan and ahead is not None
                if look:
                    following.watcher.check_lost(following.sample)
                if self._on_stretch:
                    self._on_stretch(stretch)
                moved |= bool(stretch.touched)
                # not with a tool on the object: it is looked at before the tool comes to it
                apart = stretch.free or (stretch.apart and ahead is not None and ahead.apart)
                if look and moved and apart:
                    moved = False
                    following.watcher.check_drift(following.sample, recovery.policy.drift)
                    following.look_at_tools(following.sample, self._attached_tools(plan))
        except ExecutionError as failure:
            return failure
        return None

    def _new_plan(self, following: Following, failure: ExecutionError, recovery: Recovery) -> Plan | None:
        """Free the hands and ask for a new plan.

        A robot that is blocked, or not seen any more, brings what it carries back along the plan to where that stood.
        What slipped or fell is let go where it is.

        Raises:
            ExecutionError: a body is lost on the way, or the way back is blocked as well: then the hand keeps it.
            InputError: STALE_STATE; nothing is measured any more.
            PlannerError: CANCELED.
        """
        plan, tools = following.plan, {}
        if isinstance(failure, Drifted) and recovery.policy.keep_tools:
            tools = self._kept_tools(following)
        if not (isinstance(failure, Blocked) or tools):
            self._ports.controllers.stop()
            if failure.code is Code.STALE_STATE:
                self._ports.observation.state()  # hands keep what they hold until the world is seen again
            if not self._free_tools(plan, following.sample) and failure.code in STOPPED_ON_THE_WAY:
                following.back_off()
            self._hands.let_go(plan)
        new = recovery.new_plan(failure, plan, lambda: self._hands.start_state(plan, following.sample), tools.values())
        self._tools = tools
        return new

    def _report(
        self, following: Following, failure: ExecutionError | None, began: float, policy: RecoveryPolicy
    ) -> ExecutionReport:
        """The report on a plan that was not followed to its end; a drift alone is no failure."""
        return following.report(began, policy.strict, None if isinstance(failure, Drifted) else failure)

    def _attached_tools(self, plan: Plan) -> dict[str, str]:
        """Robot -> the tool that it holds."""
        goal, bodies = plan.scene.goal.object, plan.scene.bodies
        held = self._hands.held.items()
        return {robot: body for robot, body in held if bodies[body].kind is BodyKind.TOOL and body != goal}

    def _kept_tools(self, following: Following) -> dict[str, ToolGrasp]:
        """The tool that stays attached: if it is the only thing in hands, and held as planned."""
        plan, sample = following.plan, following.sample
        held = self._hands.held
        found = [(robot, self._tool_grasp(plan, sample, robot, body)) for robot, body in held.items()]
        grasps = {robot: grasp for robot, grasp in found if grasp is not None}
        if len(held) != 1 or len(grasps) != 1:
            return {}
        planned, poses = poses_at(plan, sample), self._ports.observation.state().poses
        slipped = drift_reason({grasp.tool: planned[grasp.tool] for grasp in grasps.values()}, poses, SLIP)
        return {} if slipped else grasps

    def _tool_grasp(self, plan: Plan, sample: int, robot: str, body: str) -> ToolGrasp | None:
        """The grasp of a tool that was picked; None of any other body."""
        if plan.scene.bodies[body].kind is not BodyKind.TOOL or body == plan.scene.goal.object:
            return None
        return grip_at(plan, robot, body, sample, self._tools.get(robot))

    def _free_tools(self, plan: Plan, sample: int) -> bool:
        """Place the tools that are attached at a sample of a plan where they were picked; else let them go.

        Returns:
            whether there were any.

        Raises:
            PlannerError: CANCELED.
            ExecutionError: TRACKING_LOST; an arm or gripper failed.
        """
        found = False
        for robot, body in dict(self._hands.held).items():
            grasp = self._tool_grasp(plan, sample, robot, body)
            if grasp is None:
                continue
            found = True
            try:
                state = self._hands.start_state(plan, sample)
                self._place(plan_place(self._ports.scene(), state, grasp, 0, PLACE_LIMIT))
            except (MotionError, ExecutionError):
                self._hands.open(plan.scene.robots[robot])
        return found

    def _place(self, plan: Plan) -> None:
        """Follow a plan that places a tool; what comes in its way ends it."""
        placing = Following(plan, self._ports, self._hands, lambda plan, sample: False)
        for stretch in placing.stretches:
            placing.follow(stretch)

    def _places(self, following: Following, places: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Where bodies belong that the next plan leaves alone: where the last one left them, if it moved them."""
        poses, plan = self._ports.observation.state().poses, following.plan
        return {
            name: poses[name] if planned_motion(plan, name, following.sample + 1) >= STAY_LIMIT else pose
            for name, pose in places.items()
            if name in poses
        }
