"""Execution that looks: between contacts it compares the world with the plan, and has it planned anew if need be."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np

from hmap_core.exceptions import Code, ExecutionError, HmapError
from hmap_core.execution.attached_tool import AttachedTool, attached_tools
from hmap_core.execution.drift import DriftTolerance, drift_reason
from hmap_core.execution.execute import Execution, Progress
from hmap_core.execution.report import Deviation, ExecutionReport
from hmap_core.execution.stretches import Stretch
from hmap_core.execution.watcher import STAY_LIMIT, planned_motion
from hmap_core.simulation.world import SimulatedWorld
from hmap_core.trajectory.measured import without_noise
from hmap_core.trajectory.samples import poses_at, state_at
from hmap_core.types import Plan, SceneState

# from a state, the how-manieth new plan it is (1, 2, ...), with these tools in hands; or HmapError
Replanner = Callable[[SceneState, int, tuple[AttachedTool, ...]], Plan]
SLIP = DriftTolerance(0.004, float(np.deg2rad(3.0)))  # of a tool in a hand; beyond, it is let go and taken anew
Between = Callable[[SimulatedWorld, Stretch], None]


@dataclass(frozen=True)
class Replan:
    """One time that a new plan was asked for.

    Attributes:
        time: simulated seconds since the execution began.
        reason: why the plan until then could not go on.
        planning_s: seconds of wall-clock time that planning took.
        failure: why there is no new plan; empty when there is one.
    """

    time: float
    reason: str
    planning_s: float
    failure: str = ""


@dataclass(frozen=True)
class ClosedLoopReport:
    """Whether an execution solved its task, with all new plans on the way.

    Attributes:
        last: the report on the plan that was executed last; its verdict and goal error are those of the whole.
        replans: every time that a new plan was asked for, in order.
        plans: what was executed, the first plan first; of all but the last only a part.
    """

    last: ExecutionReport
    replans: tuple[Replan, ...]
    plans: tuple[Plan, ...]

    @property
    def solved(self) -> bool:
        return self.last.solved

    @property
    def code(self) -> Code:
        return self.last.code

    @property
    def reason(self) -> str:
        """Why not solved, and why there was no new plan where one was asked for; empty when solved."""
        if self.solved or not (self.replans and self.replans[-1].failure):
            return self.last.reason
        return f"{self.replans[-1].reason}; no new plan: {self.replans[-1].failure}"

    @property
    def goal_error(self) -> Deviation:
        return self.last.goal_error

    def to_dict(self) -> dict:
        """The report as plain data for JSON, without the plans."""
        return self.last.to_dict() | {"reason": self.reason, "replans": [asdict(replan) for replan in self.replans]}


def execute_closed_loop(
    plan: Plan,
    replan: Replanner,
    max_replans: int,
    tolerance: DriftTolerance | None = None,
    on_progress: Progress | None = None,
    between: Between | None = None,
) -> ClosedLoopReport:
    """Execute a plan in a simulation of its own, and new plans where the world is not as planned.

    It looks whenever all robots have drawn back from a contact (:attr:`Stretch.apart`). A new plan is asked for when a
    body is off the plan, when the object misses its goal at the end, and when something slips from a gripper or blocks
    a robot, which then stops and lets go. The new plan begins with the tool that is in a hand, unless that has slipped
    by more than SLIP. What fell, or should have stayed and moved, is beyond repair.

    Args:
        plan: to begin with.
        replan: plans the rest from a measured state.
        max_replans: how often it is called; 0 follows the plan to its end, whatever happens.
        tolerance: of bodies between contacts; at the end it is the scene's execution tolerance for the goal's object.
        on_progress: as in :func:`hmap_core.execution.execute.execute`, of the plan that is being executed.
        between: called after every stretch, to disturb the world.

    Raises:
        InputError: the plan is kinematic, or inconsistent with its scene.
    """
    with SimulatedWorld(plan.scene) as world:
        loop = _ClosedLoop(world, replan, max_replans, tolerance or DriftTolerance(), on_progress, between)
        return loop.run(plan)


class _ClosedLoop:
    def __init__(self, world, replan, max_replans, tolerance, on_progress, between):
        self._world: SimulatedWorld = world
        self._replan: Replanner = replan
        self._max_replans: int = max_replans
        self._tolerance: DriftTolerance = tolerance
        self._on_progress: Progress | None = on_progress
        self._between: Between | None = between
        self._replans: list[Replan] = []
        self._tools: dict[str, AttachedTool] = {}  # robot -> what it has in its hand

    def run(self, plan: Plan) -> ClosedLoopReport:
        plans = [plan]
        places = poses_at(plan, 0)
        while True:
            execution = Execution(plans[-1], self._world, places)
            sample, report, reason = self._follow(execution)
            following = self._planned_anew(plans[-1], sample, reason) if reason else None
            if following is None:
                return ClosedLoopReport(report or execution.report(), tuple(self._replans), tuple(plans))
            places = self._places(plans[-1], sample, places)
            plans.append(following)

    @property
    def _may_replan(self) -> bool:
        return len(self._replans) < self._max_replans

    def _follow(self, execution: Execution) -> tuple[int, ExecutionReport | None, str]:
        """Follow a plan to its end or until another one is needed.

        Returns:
            the sample at which it stopped; the report, where it is over; why another plan is needed, or nothing.
        """
        moved = handled = False  # anything, anything but a tool since the last look
        for stretch in execution.stretches:
            try:
                self._progress(execution.plan, stretch)
                execution.follow(stretch)
                if self._between:
                    self._between(self._world, stretch)
                moved |= bool(stretch.touched)
                handled |= bool(stretch.touched) and not stretch.apart
                due = (moved and stretch.free) or (handled and stretch.apart)
                if due and stretch is not execution.stretches[-1] and self._may_replan:
                    moved = handled = False
                    execution.settle(stretch.last)
                    reason = self._drift(execution.plan, stretch.last)
                    if reason:
                        self._keep_tools(execution, stretch)
                        return stretch.last, None, reason
            except ExecutionError as failure:
                return self._failed(execution, stretch, failure)
        return self._ended(execution)

    def _ended(self, execution: Execution) -> tuple[int, ExecutionReport, str]:
        """The plan was followed to its end: another one is needed where the object missed its goal."""
        last = execution.stretches[-1]
        report = execution.report()
        self._tools = {}
        if report.code is not Code.GOAL_MISSED or report.moved or not self._may_replan:
            return last.last, report, ""
        try:
            execution.let_go(last)
        except ExecutionError as late:
            return last.last, execution.report(late), ""
        return last.last, report, report.reason

    def _keep_tools(self, execution: Execution, stretch: Stretch) -> None:
        """Go on with the tool in a hand where it is held as planned, else let go."""
        plan, sample = execution.plan, stretch.last
        self._tools = attached_tools(plan, sample, self._tools)
        poses = self._world.state().poses
        planned = {name: T for name, T in poses_at(plan, sample).items() if name in stretch.held.values()}
        if len(stretch.held) != len(self._tools) or len(self._tools) > 1 or drift_reason(planned, poses, SLIP):
            self._tools = {}
            execution.let_go(stretch)

    def _drift(self, plan: Plan, sample: int) -> str | None:
        return drift_reason(poses_at(plan, sample), self._world.state().poses, self._tolerance)

    def _failed(self, execution: Execution, stretch: Stretch, failure: ExecutionError):
        """Something went wrong in the middle: let go, unless that is no use any more."""
        self._tools = {}
        if execution.fell or not self._may_replan:
            return stretch.last, execution.report(failure), ""
        try:
            execution.let_go(stretch)
        except ExecutionError as late:
            return stretch.last, execution.report(late), ""
        return stretch.last, execution.report(failure), failure.reason

    def _planned_anew(self, plan: Plan, sample: int, reason: str) -> Plan | None:
        """A new plan from where everything is now, in as many attempts as are left; None when there is none."""
        state = without_noise(plan.scene, self._world.state(), state_at(plan, sample))
        while self._may_replan:
            began = time.monotonic()
            following, failure = None, ""
            try:
                following = self._replan(state, len(self._replans) + 1, tuple(self._tools.values()))
            except HmapError as error:
                failure = str(error)
            self._replans.append(Replan(self._world.time, reason, time.monotonic() - began, failure))
            if following is not None:
                return following
        return None

    def _places(self, plan: Plan, sample: int, places: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Where bodies belong that the next plan leaves alone: where the last one left them, if it moved them."""
        return {
            name: self._world.body_pose(name) if planned_motion(plan, name, sample + 1) >= STAY_LIMIT else pose
            for name, pose in places.items()
        }

    def _progress(self, plan: Plan, stretch: Stretch) -> None:
        if self._on_progress:
            planned = plan.trajectory.time
            self._on_progress(float(planned[stretch.first]), float(planned[-1]), stretch.label)
