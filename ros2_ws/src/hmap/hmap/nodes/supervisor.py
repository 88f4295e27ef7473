"""The node ``supervisor``: Algorithm 1 over the other nodes, then execution; the action ``manipulate``."""

import gc
import sys
import threading
import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle

from hmap.conversions import known_object, plan_to_message
from hmap.heartbeats import Heartbeat, runs_already, was_there_before
from hmap.lifecycle import ManagedNode
from hmap.naming import Naming
from hmap.node import FEEDBACK, LATCHED, LOOK_PERIOD, run
from hmap.perception.pose_filter import POSE_NOISE
from hmap.remote_components import remote_components
from hmap.requests import OFFERED_BY, Caller, time_limit
from hmap.supervision.controllers import CONTROLLER_TIMEOUT, START_TOLERANCE, Controllers
from hmap.supervision.gripper_position import DESCRIPTION, GAP, PARAMETER, GripperPosition
from hmap.supervision.operator_controls import OperatorControls
from hmap.supervision.plan_topics import PlanTopics
from hmap.supervision.ports import ros_ports
from hmap.supervision.scene_monitor import SceneMonitor
from hmap_core import planner, transforms
from hmap_core.contacts.camera import Cloud
from hmap_core.exceptions import Code, ExecutionError, HmapError, InputError, PlannerError
from hmap_core.execution.plan_executor import PlanExecutor
from hmap_core.execution.recovery import RecoveryPolicy, ReplanRequest
from hmap_core.execution.stretches import check_executable
from hmap_core.planner import HmapPlanner, ManipulationPlanner, PlannerComponents, plugins
from hmap_core.planner.interfaces import ToolGrasp
from hmap_core.planner.repair import plan_anew, rehearse
from hmap_core.types import Goal, Plan, Scene
from hmap_msgs.action import Manipulate
from hmap_msgs.msg import PlannerStatus
from hmap_msgs.srv import LoadScene
from hmap_msgs_py.checks import ConversionError
from hmap_msgs_py.errors import error_to_message
from hmap_msgs_py.plans import statistics_to_messages
from hmap_msgs_py.poses import pose_from_message

FRAME = "world"
SCENE_PATIENCE = 3.0  # s for the published scene to be received, by a supervisor that has just started
LOADING_LIMIT = 30.0  # s for a scene to be loaded
UNDISTURBED = 1.0  # s in which plan repair does not share the interpreter with callbacks; a cancellation waits as long
REHEARSAL_LIMIT = 30.0  # s
SETTLE_LIMIT = 30.0  # s for a goal to end when the node is deactivated
STOPPING, REPLANNING = "stopping", "replanning"  # phases beside those of PlannerStatus
PAUSED, CONFIRMING = "paused", "confirming"
SECOND = (
    "another supervisor runs on this cell already (a node 'supervisor' in the same namespace and ROS domain), and two "
    "would move the same arms; end one of them, or start it in another namespace"
)


@dataclass
class Job:
    """A goal of ``manipulate`` being worked on."""

    handle: ServerGoalHandle
    began: float = field(default_factory=time.monotonic)
    replaced: threading.Event = field(default_factory=threading.Event)
    result: Manipulate.Result = field(default_factory=Manipulate.Result)
    phase: str = PlannerStatus.LOADING  # the last one that was told
    plans: int = 0  # that were asked for
    blocked: int = 0  # how often a body came in the way
    last_blocked: tuple[Plan, float] | None = None  # the last blocked plan, and up to which time (s)
    stops: int = 0  # how often the operator had asked to stop when it began
    moves: bool = False  # whether its plan is executed
    ended: bool = False
    doing: str = ""  # what is executed
    replans: list[dict] = field(default_factory=list)  # how each new plan because of that was found
    key: bytes = field(init=False)  # of the goal

    def __post_init__(self) -> None:
        self.key = bytes(self.handle.goal_id.uuid)

    @property
    def goal(self) -> Manipulate.Goal:
        """The request of the action."""
        return self.handle.request


class Supervisor(ManagedNode):
    """Plans and executes one goal at a time; a new goal takes the place of the one before."""

    plans = True

    def __init__(self, components: PlannerComponents | None = None):
        """
        Args:
            components: of planning, in this process; None: the services of other nodes.

        Raises:
            InputError: another supervisor runs already.
        """
        if runs_already("supervisor"):
            raise InputError(SECOND)
        super().__init__("supervisor")
        self._began = time.monotonic()
        self._others = Heartbeat(self, "supervisor", self.group)
        self._naming = Naming(self, "arm_joint", "arm_action", "gripper_action")
        self._time_limit = self.parameter(
            "time_limit", 120.0, "s for planning, of a goal that names none", 0.1, 86400.0
        )
        self._planner = self.parameter("planner", plugins.DEFAULT_PLANNER, "the method; see `hmap plugins`")
        if self._planner.startswith(f"{plugins.DEFAULT_PLANNER}:"):
            raise InputError(f"the parameter 'planner' is '{self._planner}'; name the proposer by 'proposer' instead")
        text = "orders robots, tools and their holds, if it can; see `hmap plugins`"
        self._proposer = plugins.create(
            plugins.CONTACT_PROPOSERS, self.parameter("proposer", plugins.DEFAULT_PROPOSER, text)
        )
        self._patience = self.parameter(
            "service_patience", 5.0, "s to wait for a node that is away or has died", 0.0, 3600.0
        )
        self._state_patience = self.parameter("state_patience", 10.0, "s to wait for a world state", 0.0, 3600.0)
        replans = self.parameter("replans", 2, "new plans after an execution that went wrong", 0, 1000)
        text = "new plans because a body came in the way"
        obstacle_replans = self.parameter("obstacle_replans", 20, text, 0, 1000)
        text = "s of real time to wait for bodies to move on when they leave no plan"
        obstacle_patience = self.parameter("obstacle_patience", 10.0, text, 0.0, 3600.0)
        keeps_tools = self._planner == plugins.DEFAULT_PLANNER  # others cannot begin with a tool attached
        self._policy = RecoveryPolicy(
            replans, obstacle_replans, obstacle_patience, strict=False, keep_tools=keeps_tools
        )
        stale = self.parameter("stale_after", 2.0, "s of real time; an older world state is not used", 0.05, 3600.0)
        self._plans = PlanTopics(self, self._naming, FRAME)
        self._status_topic = self.create_publisher(PlannerStatus, "planner_status", LATCHED)
        text = "m, standard deviation of measured positions; bodies within four of it of a support stand on it"
        noise = self.parameter("pose_noise", POSE_NOISE, text, 0.0, 0.1)
        self._components = components
        self._remote = Caller(self, self._patience, OFFERED_BY)
        self._scene_monitor = SceneMonitor(self, stale, noise, lambda: self._remote.lost("load_scene"))
        text = "s after which a controller that is not there, does not answer, or does not move is lost"
        timeout = self.parameter("controller_timeout", CONTROLLER_TIMEOUT, text, 0.1, 3600.0)
        text = "rad that a joint may be measured off the start of a trajectory that is sent"
        tolerance = self.parameter("start_tolerance", START_TOLERANCE, text, 1e-4, 1.0)
        position = GripperPosition(self.parameter(PARAMETER, GAP, DESCRIPTION))
        self._controllers = Controllers(self, self._naming, self._scene_monitor, timeout, tolerance, position)
        self._scene_monitor.on_change(self._controllers.news.set)
        self._turn, self._jobs = threading.Lock(), threading.Lock()
        self._job: Job | None = None
        self._cancels: set[bytes] = set()  # keys of goals that clients asked to cancel; to ask the handles takes longer
        self._operator = OperatorControls(self, self._has_goal, self._paced)
        self._controllers.locked = self._operator.dry_run
        self._server = ActionServer(
            self,
            Manipulate,
            "manipulate",
            self._execute,
            callback_group=self.group,
            feedback_pub_qos_profile=FEEDBACK,
            goal_callback=lambda _: GoalResponse.ACCEPT,
            cancel_callback=self._cancel,
        )
        self.every(LOOK_PERIOD, self._make_way)
        self._say(None, PlannerStatus.IDLE, "waiting for a goal")

    def _make_way(self) -> None:
        """End where another supervisor was there before."""
        if was_there_before(self._others, self._began):
            self.failure = InputError(SECOND)

    def settled(self) -> bool:
        """Wait until the goal, if there is one, has ended as canceled and arms are at rest."""
        self._controllers.news.set()
        ended = self._turn.acquire(timeout=SETTLE_LIMIT)
        if ended:
            self._turn.release()
        return ended

    # the operator

    def _has_goal(self) -> bool:
        with self._jobs:
            return self._job is not None and not self._job.ended

    def _cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        self._cancels.add(bytes(handle.goal_id.uuid))
        self._controllers.news.set()  # who waits looks again
        return CancelResponse.ACCEPT

    def _paced(self) -> None:
        """The operator has changed something: who waits for a motion looks again, and everybody is told."""
        self._controllers.news.set()
        with self._jobs:
            job = self._job
        if job is not None and not job.ended and job.moves:
            paused = self._operator.pace.paused
            self._say(job, PAUSED if paused else PlannerStatus.EXECUTION, "by the operator" if paused else job.doing)

    # one goal

    def _execute(self, handle: ServerGoalHandle) -> Manipulate.Result:
        self.needed()
        job = Job(handle, stops=self._operator.stops)
        with self._jobs:
            if self._job is not None:
                self._job.replaced.set()
            self._job = job
        with self._turn:
            error = self._error_of(job)
        job.result.error = error_to_message(error)
        job.result.success = error is None
        job.ended = True
        if error is None:
            self._say(job, PlannerStatus.DONE, "done")
            handle.succeed()
        else:
            self._say(job, PlannerStatus.FAILED, str(error))
            self.report_error("manipulate", error)
            canceled = isinstance(error, HmapError) and error.code is Code.CANCELED and handle.is_cancel_requested
            handle.canceled() if canceled else handle.abort()
        self._cancels.discard(job.key)
        return job.result

    def _error_of(self, job: Job) -> Exception | None:
        """Do the job; the exception that ended it, or None."""
        try:
            self._manipulate(job)
        except Exception as error:  # becomes the result's error
            return error
        return None

    def _manipulate(self, job: Job) -> None:
        self.require_active()
        if self._others.alive:  # both were started at the same time
            raise InputError(SECOND)
        limit = time_limit(job.goal, self._time_limit)
        scene = self._goal_scene(job)
        state = self._scene_monitor.settled(self._state_patience, lambda: self._canceled(job))
        changed = self._scene_monitor.changed()
        scene = replace(self._scene_monitor.scene() or scene, goal=scene.goal)
        plan = self._plan(job, ReplanRequest(scene, state, 1, changed=changed), limit)
        if job.goal.plan_only or self._operator.dry_run:
            self._compare(job, plan.scene.goal, plan.trajectory.objects[plan.scene.goal.object][-1])
            return
        check_executable(plan)
        threading.Thread(target=self._rehearse, args=(plan,), name="rehearsal", daemon=True).start()
        before = self._controllers.accepted
        self._operator.wait_for_confirmation(lambda: self._canceled(job), lambda text: self._say(job, CONFIRMING, text))
        job.moves = True
        try:
            report = self._executor(job).run(plan, lambda request: self._replan(job, request, limit), self._policy)
        finally:
            job.result.executed = self._controllers.accepted > before
        job.result.position_error = report.goal_error.position_m
        job.result.rotation_error = float(np.deg2rad(report.goal_error.rotation_deg))
        if report.error is not None:
            raise report.error
        if not report.solved:
            raise ExecutionError(report.reason, report.code)

    def _executor(self, job: Job) -> PlanExecutor:
        def show(now: float, end: float, label: str) -> None:
            job.doing = f"{now:.1f} of {end:.1f} s, {label}"
            self._say(job, PAUSED if self._operator.pace.paused else PlannerStatus.EXECUTION, job.doing)

        return PlanExecutor(
            ros_ports(self._controllers, self._scene_monitor, self._state_patience),
            lambda: self._canceled(job),
            on_progress=show,
            on_stop=lambda text: self._say(job, STOPPING, text),
            pace=self._operator.pace,
        )

    def _canceled(self, job: Job) -> bool:
        stopped = self._operator.stops > job.stops or not self.active
        canceled = job.key in self._cancels and job.handle.is_cancel_requested
        return stopped or canceled or job.replaced.is_set() or self.stopping.is_set()

    # the goal

    def _goal_scene(self, job: Job) -> Scene:
        """The scene with the goal that is asked for."""
        goal = job.goal
        loaded = self._scene_monitor.scene(SCENE_PATIENCE)
        if goal.task and (loaded is None or (loaded.task, loaded.seed) != (goal.task, int(goal.seed))):
            loaded = self._load(job)
        if loaded is None:
            raise InputError("no scene is loaded and the goal names no task", Code.UNKNOWN_TASK)
        target = loaded.goal
        if goal.object:
            pose = pose_from_message(goal.pose, "pose of the goal")
            target = replace(target, object=known_object(loaded, goal.object), pose=pose)
        position = _tolerance("position_tolerance", goal.position_tolerance, target.position_tolerance)
        rotation = _tolerance("rotation_tolerance", goal.rotation_tolerance, target.rotation_tolerance)
        return loaded.with_goal(replace(target, position_tolerance=position, rotation_tolerance=rotation))

    def _load(self, job: Job) -> Scene:
        goal = job.goal
        self._say(job, PlannerStatus.LOADING, f"task {goal.task!r}, seed {goal.seed}")
        request = LoadScene.Request(task=goal.task, seed=goal.seed)
        self._caller(job).call(LoadScene, "load_scene", request, LOADING_LIMIT)
        canceled = lambda: self._canceled(job)  # noqa: E731
        return self._scene_monitor.wait_for_scene(goal.task, int(goal.seed), self._state_patience, canceled)

    def _caller(self, job: Job) -> Caller:
        return self._remote.until(lambda: self._canceled(job), lambda text: self._say(job, job.phase, text))

    # planning

    def _replan(self, job: Job, request: ReplanRequest, limit: float) -> Plan:
        """A new plan during the execution."""
        self.get_logger().warning(f"{request.reason}; planning anew from where everything is")
        self._say(job, REPLANNING, request.reason)
        if request.blocked is not None and request.blocked is not job.last_blocked:
            job.last_blocked = request.blocked
            job.blocked += 1
        try:
            return self._plan(job, request, limit)
        except HmapError as error:
            waits = "waiting for the way to become free: " if request.blocked is not None else ""
            self._say(job, REPLANNING, f"{waits}{error.reason}")
            raise

    def _plan(self, job: Job, request: ReplanRequest, limit: float) -> Plan:
        """A plan from where everything is: a repaired one where a body came in the way, else one by Algorithm 1."""
        scene, state = request.scene, request.state
        job.plans += 1
        began, cpu = time.monotonic(), time.thread_time()
        seed = int(job.goal.seed) + job.plans - 1
        limits: dict[str, Any] = {
            "time_limit": limit,
            "progress": lambda p: self._show_planning(job, p),
            "cancel": lambda: self._canceled(job),
        }
        clouds = self._scene_monitor.clouds()
        try:
            if request.blocked is None:
                method = self._method(job, clouds, next(iter(request.tools), None))
                plan, kept = method.plan(scene, state, seed, **limits), dict[str, int]()
            else:  # in this process, as every moment counts
                with self.undisturbed(UNDISTURBED):
                    plan, kept = plan_anew(*request.blocked, scene, state, seed, HmapPlanner(clouds=clouds), **limits)
        except HmapError as error:
            if error.search is not None:
                job.result.statistics = statistics_to_messages({"search": error.search})
                self._plans.search_ended(error.search)
            raise
        if self._canceled(job):
            raise PlannerError("canceled", Code.CANCELED)
        ended = time.monotonic()
        for note in plan.stats.get("notes", ()):
            self.get_logger().warning(note)
        stats = {"planning_time_s": ended - began, **plan.stats, "plans": job.plans, "blocked": job.blocked}
        if request.blocked is not None:
            job.replans.append(
                {
                    "planning_s": stats["planning_time_s"],
                    "planning_cpu_s": plan.stats.get("planning_cpu_s"),
                    "with_judge_s": ended - began,
                    "with_judge_cpu_s": time.thread_time() - cpu,
                    "after_seen_s": ended - request.changed,
                    "kept": kept,
                }
            )
            self.get_logger().info(f"planned anew: {job.replans[-1]}")
        if job.replans:
            stats["obstacle_replans"] = list(job.replans)
        plan = replace(plan, stats=stats)
        stamp = self.get_clock().now().to_msg()
        job.result.plan = plan_to_message(plan, stamp)
        job.result.statistics = statistics_to_messages(plan.stats)
        self._plans.publish(plan, job.result.plan, stamp)
        return plan

    def _method(self, job: Job, clouds: dict[str, Cloud], attached: ToolGrasp | None) -> ManipulationPlanner:
        """The planner that the parameter names; H-MaP's phases are done by the components, or by the other nodes."""
        method = plugins.create(plugins.PLANNERS, self._planner)
        if isinstance(method, HmapPlanner):
            components = self._components or remote_components(self._caller(job), self._proposer)
            return replace(method, components=components, clouds=clouds, tool_grasp=attached)
        return method

    def _show_planning(self, job: Job, p: planner.Progress) -> None:
        phase = PlannerStatus.CHECKING if p.phase == PlannerStatus.DONE else p.phase  # planned, but not yet executed
        self._say(job, phase, p.text, p.waypoint, p.waypoints, p.attempt)
        self._plans.searching(p.search)

    # execution

    def _rehearse(self, plan: Plan) -> None:
        """Load the code for plan repair while there is time for it."""
        began = time.monotonic()
        rehearse(plan, REHEARSAL_LIMIT)
        gc.collect()
        gc.freeze()  # garbage collection during planning skips these objects
        self.get_logger().info(f"ready to repair the plan after {time.monotonic() - began:.1f} s")

    def _compare(self, job: Job, goal: Goal, pose: np.ndarray) -> None:
        job.result.position_error, job.result.rotation_error = transforms.distance(goal.pose, pose)

    # status

    def _say(self, job: Job | None, phase: str, text: str, i: int = 0, count: int = 0, attempt: int = 0) -> None:
        status = PlannerStatus(phase=phase, waypoint=int(i), waypoint_count=int(count), attempt=int(attempt), text=text)
        status.header.stamp = self.get_clock().now().to_msg()
        if job is not None:
            job.phase = phase
            status.elapsed = time.monotonic() - job.began
            if job.handle.is_active:
                job.handle.publish_feedback(Manipulate.Feedback(status=status))
        self._status_topic.publish(status)
        level = DiagnosticStatus.WARN if phase == PlannerStatus.FAILED else DiagnosticStatus.OK
        self.set_status(f"{phase}: {text}" if text else phase, level, **self._operator.state())


def _tolerance(name: str, value: float, default: float) -> float:
    if not (np.isfinite(value) and value >= 0.0):
        raise ConversionError(f"{name} = {value}: must be 0 (the task's) or more")
    return float(value) or default


def main(args: list[str] | None = None) -> int:
    """Run the node; its exit code."""
    return run(Supervisor, args)


if __name__ == "__main__":
    sys.exit(main())
