"""The node ``supervisor``: Algorithm 1 over the other nodes, then execution; the action ``manipulate``."""

import gc
import sys
import threading
import time
from dataclasses import dataclass, field, replace

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from visualization_msgs.msg import MarkerArray

from hmap.conversions import known_object, plan_to_message
from hmap.naming import Naming
from hmap.node import LATCHED, HmapNode, run
from hmap.remote_components import remote_components
from hmap.requests import Caller, time_limit
from hmap.supervision.controllers import Controllers
from hmap.supervision.follower import Blocked, Follower
from hmap.supervision.markers import markers_of
from hmap.supervision.scene_monitor import SceneMonitor
from hmap_core import planner, transforms
from hmap_core.contacts.camera import Cloud
from hmap_core.exceptions import Code, ExecutionError, HmapError, InputError, PlannerError
from hmap_core.planner import HmapPlanner, ManipulationPlanner, plugins
from hmap_core.planner.repair import plan_anew, rehearse
from hmap_core.types import Goal, Plan, Scene
from hmap_msgs.action import Manipulate
from hmap_msgs.msg import Plan as PlanMessage
from hmap_msgs.msg import PlannerStatus
from hmap_msgs.srv import LoadScene
from hmap_msgs_py.checks import ConversionError
from hmap_msgs_py.errors import error_to_message
from hmap_msgs_py.plans import statistics_to_messages
from hmap_msgs_py.poses import pose_from_message

FRAME = "world"
LOADING_LIMIT = 30.0  # s for a scene to be loaded
UNDISTURBED = 1.0  # s in which mending a plan does not share the interpreter with callbacks; a cancel waits as long
REHEARSAL_LIMIT = 30.0  # s
STOPPING, REPLANNING = "stopping", "replanning"  # phases beside those of PlannerStatus
NO_PLAN = (
    Code.START_IN_COLLISION,
    Code.GOAL_IN_COLLISION,
    Code.NO_OBJECT_PATH,
    Code.NO_CONTACT,
    Code.OUT_OF_REACH,
    Code.NO_MOTION,
    Code.TIME_LIMIT,
    Code.PLAN_REJECTED,
)
RECOVERABLE = (Code.TRACKING_LOST, Code.GOAL_MISSED, Code.OBJECT_DROPPED)


@dataclass
class Job:
    """A goal of ``manipulate`` being worked on."""

    handle: ServerGoalHandle
    began: float = field(default_factory=time.monotonic)
    replaced: threading.Event = field(default_factory=threading.Event)
    result: Manipulate.Result = field(default_factory=Manipulate.Result)
    plans: int = 0  # that were asked for
    blocked: int = 0  # how often a body came in the way
    replans: list[dict] = field(default_factory=list)  # how each new plan because of that was found

    @property
    def goal(self) -> Manipulate.Goal:
        return self.handle.request


class Supervisor(HmapNode):
    """Plans and executes one goal at a time; a new goal takes the place of the one before."""

    def __init__(self):
        super().__init__("supervisor")
        self._naming = Naming(self, "arm_joint", "arm_action", "gripper_action")
        self._time_limit = self.parameter(
            "time_limit", 120.0, "s for planning, of a goal that names none", 0.1, 86400.0
        )
        self._planner = self.parameter("planner", plugins.DEFAULT_PLANNER, "the method; see `hmap plugins`")
        self._patience = self.parameter("service_patience", 30.0, "s to wait for a node that is away", 0.0, 3600.0)
        self._state_patience = self.parameter("state_patience", 10.0, "s to wait for a world state", 0.0, 3600.0)
        self._replans = self.parameter("replans", 2, "new plans after an execution that went wrong", 0, 1000)
        text = "new plans because a body came in the way"
        self._obstacle_replans = self.parameter("obstacle_replans", 20, text, 0, 1000)
        text = "s of real time to wait for bodies to move on when they leave no plan"
        self._obstacle_patience = self.parameter("obstacle_patience", 10.0, text, 0.0, 3600.0)
        stale = self.parameter("stale_after", 2.0, "s of real time; an older world state is not used", 0.05, 3600.0)
        self._plan_topic = self.create_publisher(PlanMessage, "plan", LATCHED)
        self._markers = self.create_publisher(MarkerArray, "markers", LATCHED)
        self._status_topic = self.create_publisher(PlannerStatus, "planner_status", LATCHED)
        self._scene_monitor = SceneMonitor(self, stale)
        self._remote = Caller(self, self._patience)
        self._controllers = Controllers(self, self._naming, self._patience)
        self._scene_monitor.on_change(self._controllers.news.set)
        self._turn, self._jobs = threading.Lock(), threading.Lock()
        self._job: Job | None = None
        self._server = ActionServer(
            self,
            Manipulate,
            "manipulate",
            self._execute,
            callback_group=self.group,
            goal_callback=lambda _: GoalResponse.ACCEPT,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )
        self._say(None, PlannerStatus.IDLE, "waiting for a goal")

    # one goal

    def _execute(self, handle: ServerGoalHandle) -> Manipulate.Result:
        job = Job(handle)
        with self._jobs:
            if self._job is not None:
                self._job.replaced.set()
            self._job = job
        with self._turn:
            error = self._attempt(job)
        job.result.error = error_to_message(error)
        job.result.success = error is None
        if error is None:
            self._say(job, PlannerStatus.DONE, "done")
            handle.succeed()
        else:
            self._say(job, PlannerStatus.FAILED, str(error))
            self.report_error("manipulate", error)
            canceled = isinstance(error, HmapError) and error.code is Code.CANCELED and handle.is_cancel_requested
            handle.canceled() if canceled else handle.abort()
        return job.result

    def _attempt(self, job: Job) -> Exception | None:
        try:
            self._manipulate(job)
        except Exception as error:  # becomes the result's error
            return error
        return None

    def _manipulate(self, job: Job) -> None:
        limit = time_limit(job.goal, self._time_limit)
        scene = self._goal_scene(job)
        follower = self._follower(job)
        failures, old = 0, None
        while True:
            try:
                plan = self._plan(job, scene, follower, limit, old)
            except HmapError as error:
                failures += 1
                if failures == 1 or error.code not in NO_PLAN or failures > self._replans:
                    raise
                self._say(job, REPLANNING, str(error))
                continue
            if job.goal.plan_only:
                self._compare(job, plan.scene.goal, plan.trajectory.objects[plan.scene.goal.object][-1])
                return
            try:
                self._follow(job, follower, plan)
                return
            except Blocked as blocked:
                job.blocked += 1
                if job.blocked > self._obstacle_replans:
                    raise
                old = (plan, blocked.at)
                reason = str(blocked)
            except ExecutionError as error:
                failures += 1
                if error.code not in RECOVERABLE or failures > self._replans:
                    raise
                follower.free_hands()
                old = None
                reason = str(error)
            self.get_logger().warning(f"{reason}; planning anew from where everything is")
            self._say(job, REPLANNING, reason)

    def _follower(self, job: Job) -> Follower:
        return Follower(
            self._controllers,
            self._scene_monitor,
            lambda: self._canceled(job),
            lambda text: self._say(job, STOPPING, text),
        )

    def _canceled(self, job: Job) -> bool:
        return job.handle.is_cancel_requested or job.replaced.is_set() or self.stopping.is_set()

    # the goal

    def _goal_scene(self, job: Job) -> Scene:
        """The scene with the goal that is asked for."""
        goal = job.goal
        loaded = self._scene_monitor.scene()
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
        return self._scene_monitor.wait_for_scene(goal.task, int(goal.seed), self._state_patience)

    def _caller(self, job: Job) -> Caller:
        return self._remote.until(lambda: self._canceled(job))

    # planning

    def _plan(
        self, job: Job, scene: Scene, follower: Follower, limit: float, old: tuple[Plan, float] | None = None
    ) -> Plan:
        """A plan from where everything is.

        Args:
            scene: with the goal; its bodies are taken as they are now.
            old: a plan, and the planned time (s) up to which it was followed, when a body has come in its way. It is
                mended, or where that cannot be, another one is sought; where there is none, the bodies get time to move
                on.
        """
        while True:
            changed = self._scene_monitor.changed()
            try:
                return self._plan_once(job, scene, follower, limit, old)
            except HmapError as error:
                if old is None or error.code not in NO_PLAN or not self._move_on(job, changed, error):
                    raise

    def _move_on(self, job: Job, since: float, error: HmapError) -> bool:
        """Whether the bodies have moved, or do so within the patience."""
        self._say(job, REPLANNING, f"waiting for the way to become free: {error.reason}")
        moved = self._scene_monitor.wait_for_change(since, self._obstacle_patience, lambda: self._canceled(job))
        return moved and not self._canceled(job)

    def _plan_once(self, job: Job, scene: Scene, follower: Follower, limit: float, old) -> Plan:
        state = follower.told(self._scene_monitor.settled(self._state_patience))
        now, changed = self._scene_monitor.scene(), self._scene_monitor.changed()
        scene = replace(now, goal=scene.goal)
        job.plans += 1
        began, cpu = time.monotonic(), time.thread_time()
        seed = int(job.goal.seed) + job.plans - 1
        limits = {
            "time_limit": limit,
            "progress": lambda p: self._show_planning(job, p),
            "cancel": lambda: self._canceled(job),
        }
        clouds = self._scene_monitor.clouds()
        try:
            if old is None:
                method = self._method(job, clouds)
                plan, kept = method.plan(scene, state, seed, **limits), {}
            else:  # in this process, as every moment counts
                with self.undisturbed(UNDISTURBED):
                    plan, kept = plan_anew(*old, scene, state, seed, HmapPlanner(clouds=clouds), **limits)
        except HmapError as error:
            if error.search is not None:
                job.result.statistics = statistics_to_messages({"search": error.search})
            raise
        if self._canceled(job):
            raise PlannerError("canceled", Code.CANCELED)
        ended = time.monotonic()
        stats = {"planning_time_s": ended - began, **plan.stats, "plans": job.plans, "blocked": job.blocked}
        if old is not None:
            job.replans.append(
                {
                    "planning_s": stats["planning_time_s"],
                    "planning_cpu_s": plan.stats.get("planning_cpu_s"),
                    "with_judge_s": ended - began,
                    "with_judge_cpu_s": time.thread_time() - cpu,
                    "after_seen_s": ended - changed,
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
        self._plan_topic.publish(job.result.plan)
        self._markers.publish(markers_of(plan, stamp, FRAME))
        return plan

    def _method(self, job: Job, clouds: dict[str, Cloud]) -> ManipulationPlanner:
        """The planner that the parameter names; H-MaP's phases are done by the other nodes."""
        method = plugins.create(plugins.PLANNERS, self._planner)
        if isinstance(method, HmapPlanner):
            return replace(method, components=remote_components(self._caller(job)), clouds=clouds)
        return method

    def _show_planning(self, job: Job, p: planner.Progress) -> None:
        phase = PlannerStatus.CHECKING if p.phase == PlannerStatus.DONE else p.phase  # planned, but not yet executed
        self._say(job, phase, p.text, p.waypoint, p.waypoints, p.attempt)

    # execution

    def _follow(self, job: Job, follower: Follower, plan: Plan) -> None:
        def show(now: float, end: float, label: str) -> None:
            self._say(job, PlannerStatus.EXECUTION, f"{now:.1f} of {end:.1f} s, {label}")

        job.result.executed = True
        if job.plans == 1:
            threading.Thread(target=self._rehearse, args=(plan,), name="rehearsal", daemon=True).start()
        follower.follow(plan, show)
        goal = plan.scene.goal
        self._compare(job, goal, self._scene_monitor.settled(self._state_patience).poses[goal.object])
        allowed = plan.scene.execution_tolerance
        if job.result.position_error > allowed[0] or job.result.rotation_error > allowed[1]:
            raise ExecutionError(
                f"{goal.object!r} ends {job.result.position_error:.3f} m and "
                f"{np.rad2deg(job.result.rotation_error):.1f} deg from its goal; {allowed[0]:.3f} m and "
                f"{np.rad2deg(allowed[1]):.1f} deg are allowed",
                Code.GOAL_MISSED,
            )

    def _rehearse(self, plan: Plan) -> None:
        """Load what mending a plan takes while there is time for it."""
        began = time.monotonic()
        rehearse(plan, REHEARSAL_LIMIT)
        gc.collect()
        gc.freeze()  # nor is all of that looked through again while planning
        self.get_logger().info(f"ready to mend the plan after {time.monotonic() - began:.1f} s")

    def _compare(self, job: Job, goal: Goal, pose: np.ndarray) -> None:
        job.result.position_error, job.result.rotation_error = transforms.distance(goal.pose, pose)

    # status

    def _say(self, job: Job | None, phase: str, text: str, i: int = 0, count: int = 0, attempt: int = 0) -> None:
        status = PlannerStatus(phase=phase, waypoint=int(i), waypoint_count=int(count), attempt=int(attempt), text=text)
        status.header.stamp = self.get_clock().now().to_msg()
        if job is not None:
            status.elapsed = time.monotonic() - job.began
            if job.handle.is_active:
                job.handle.publish_feedback(Manipulate.Feedback(status=status))
        self._status_topic.publish(status)
        level = DiagnosticStatus.WARN if phase == PlannerStatus.FAILED else DiagnosticStatus.OK
        self.set_status(f"{phase}: {text}" if text else phase, level)


def _tolerance(name: str, value: float, default: float) -> float:
    if not (np.isfinite(value) and value >= 0.0):
        raise ConversionError(f"{name} = {value}: must be 0 (the task's) or more")
    return float(value) or default


def main(args: list[str] | None = None) -> int:
    return run(Supervisor, args)


if __name__ == "__main__":
    sys.exit(main())
