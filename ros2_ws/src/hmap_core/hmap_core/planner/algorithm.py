"""Algorithm 1: waypoints, contacts, motions, and what happens when one of them fails."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from hmap_core.contacts.camera import Cloud
from hmap_core.exceptions import Code, ContactError, HmapError, InputError, MotionError, PlannerError
from hmap_core.plan_file import to_dict
from hmap_core.planner.assembly import assemble, scene_at, state_after
from hmap_core.planner.interfaces import Backend, Grip, Progress, ProgressCallback, RobotContact, SegmentMotion
from hmap_core.planner.local import LocalBackend
from hmap_core.planner.motion import standing_collision
from hmap_core.planner.tools import holding, tools_of
from hmap_core.types import BodyKind, Goal, Plan, Scene, SceneState, SegmentKind
from hmap_core.validation import check
from hmap_core.waypoints import ObjectPath

J_MAX = 40  # contacts tried at one waypoint before new waypoints are asked for (the paper's j_max)
WAYPOINT_ROUNDS = 6  # object paths tried
WAYPOINT_TIME = 10.0  # s for one of them
TOOLS_TRIED = 6  # holds on tools that are tried at one waypoint
GOAL_POSES = 4  # last poses of the object's path at which the goal has to be within reach
DEFAULT_TIME_LIMIT = 60.0  # s
_MAX_SEED = 2**31 - 1


@dataclass(frozen=True)
class _Progressed:
    """How far a plan has come: the state, the motions up to it, and the tool in a hand."""

    state: SceneState
    motions: list[SegmentMotion] = field(default_factory=list)
    grip: Grip | None = None

    def after(self, motion: SegmentMotion, *grip: Grip | None) -> "_Progressed":
        """With one motion more, and another grip where one is given."""
        held = grip[0] if grip else self.grip
        return _Progressed(state_after(self.state, motion), [*self.motions, motion], held)


def _put_back(state: SceneState, grip: Grip) -> SceneState:
    """The state in which a tool stands again where it was taken."""
    back = state.copy()
    back.poses[grip.tool] = grip.T_place
    return back


class Planner:
    """One planning job.

    Args:
        scene: the task.
        state: where everything is now; None: where the scene starts.
        seed: the only source of randomness.
        time_limit: seconds of wall-clock time.
        backend: who does the three phases.
        progress: called with a Progress whenever something new begins.
        canceled: asked between two steps; True stops the job.
        clouds: what cameras have seen of each object, in its own frame.
    """

    def __init__(
        self,
        scene: Scene,
        state: SceneState | None = None,
        seed: int = 0,
        time_limit: float = DEFAULT_TIME_LIMIT,
        backend: Backend | None = None,
        progress: ProgressCallback | None = None,
        canceled: Callable[[], bool] | None = None,
        clouds: Mapping[str, Cloud] | None = None,
    ):
        self.scene = scene if state is None else scene_at(scene, state)
        self.start = self.scene.start_state() if state is None else state.copy()
        self.backend = backend or LocalBackend()
        self.rng = np.random.default_rng(seed)
        self.began = time.monotonic()
        self.deadline = self.began + time_limit
        self.time_limit = time_limit
        self.clouds = dict(clouds or {})
        self._progress = progress or (lambda progress: None)
        self._canceled = canceled or (lambda: False)
        self.last_failure, self.last_code = "nothing was tried yet", Code.NO_MOTION
        self.counts = {"waypoint_plans": 0, "contact_proposals": 0, "contact_tries": 0}

    def plan(self) -> Plan:
        """The outer loop: waypoints until a path of segments is found for all of them."""
        goal = self.scene.goal
        self._check_goal(goal)
        self._check_start(goal)
        for attempt in range(WAYPOINT_ROUNDS):
            self._report("waypoints", text=f"path of '{goal.object}' to its goal")
            path = self._waypoints(goal, attempt)
            self.counts["waypoint_plans"] += 1
            found = self._segments(goal, path.poses)
            plan = self._finished(*found) if found is not None else None
            if plan is not None:
                return plan
            if self.last_code == Code.NO_CONTACT:
                self._check_reach(goal, path.poses[-GOAL_POSES:])
        raise PlannerError(
            f"no plan after {WAYPOINT_ROUNDS} object paths of '{goal.object}'; last: {self.last_failure}",
            self.last_code,
        )

    def _waypoints(self, goal: Goal, attempt: int) -> ObjectPath:
        """A path of the object. Where sliding and lifting are both allowed, every second attempt lifts."""
        scene = self.scene
        if scene.motion == "auto" and attempt % 2 == 1:
            scene = replace(scene, motion="spatial")
        limit = min(self._time_left(), WAYPOINT_TIME)
        return self.backend.plan_waypoints(scene, self.start, goal.object, goal, self._seed(), limit)

    def _segments(self, goal: Goal, poses: np.ndarray) -> tuple[list[SegmentMotion], np.ndarray] | None:
        """The main loop: contacts and motions until the object is at its goal; None when a waypoint cannot be left."""
        done, waypoints = _Progressed(self.start.copy()), []
        at = 0
        while at < len(poses) - 1:
            ahead = np.concatenate([done.state.poses[goal.object][None], poses[at + 1 :]])
            step = self._step(goal.object, done, ahead, at, len(poses) - 1)
            if step is None:
                return None
            done, reach = step
            at += reach
            waypoints.append(poses[at])
        done = self._put_down(done)
        return None if done is None else (done.motions, np.array(waypoints).reshape(-1, 7))

    def _step(self, object: str, done: "_Progressed", ahead: np.ndarray, at: int, total: int):
        """The inner loop: contacts at one waypoint until one gives a motion.

        By hand, else with the tool in the hand, else with another one. Returns (done, reach), or None.
        """
        free = done.state if done.grip is None else _put_back(done.state, done.grip)
        found = self._by_contacts(object, done, self.scene, free, tuple(self.scene.robots), ahead, at, total)
        if found is None and done.grip is not None:
            scene = holding(self.scene, done.grip)
            found = self._by_contacts(object, done, scene, done.state, (done.grip.robot,), ahead, at, total)
        return found or self._by_tool(object, done, ahead, at, total)

    def _by_contacts(self, object: str, done, scene: Scene, state: SceneState, robots, ahead, at: int, total: int):
        """Contacts in a scene, in which a robot may hold a tool, until one gives a motion."""
        tries = 0
        while tries < J_MAX:
            self._report("contacts", at, total, tries + 1, f"contacts on '{object}'")
            try:
                contacts = self.backend.propose_contacts(
                    scene, state, object, ahead, robots, self.clouds.get(object), J_MAX - tries, self._seed(),
                    self._time_left(),
                )  # fmt: skip
            except ContactError as error:
                self._failed(error)
                return None
            self.counts["contact_proposals"] += 1
            ready = done if scene is not self.scene else self._put_down(done)
            if ready is None:
                return None
            for contact in contacts:
                tries += 1
                self.counts["contact_tries"] += 1
                self._report(
                    "motion", at, total, tries, f"{contact.robot} carries '{object}' by {contact.contact.kind}"
                )
                motion = self._motion(scene, ready.state, object, contact, ahead[: contact.reach + 1])
                if motion is not None:
                    return ready.after(motion), contact.reach
        return None

    def _by_tool(self, object: str, done: "_Progressed", ahead: np.ndarray, at: int, total: int):
        """A tool that one robot takes, and with which it moves the object. Returns (done, reach), or None."""
        if not tools_of(self.scene, object):
            return None
        done = self._put_down(done)
        if done is None:
            return None
        self._report("contacts", at, total, text=f"tools for '{object}'")
        grips = self.backend.grips(self.scene, done.state, object, ahead, self._seed(), self._time_left())
        for grip, _ in grips[:TOOLS_TRIED]:
            scene = holding(self.scene, grip)
            self._report("contacts", at, total, text=f"contacts on '{object}' for {grip.robot} with '{grip.tool}'")
            try:
                self.backend.propose_contacts(
                    scene, done.state, object, ahead, (grip.robot,), self.clouds.get(object), 1, self._seed(),
                    self._time_left(),
                )  # fmt: skip
                taken = self.backend.take(self.scene, done.state, grip, self._seed(), self._time_left())
            except (ContactError, MotionError) as error:
                self._failed(error)
                continue
            ready = done.after(taken, grip)
            found = self._by_contacts(object, ready, scene, ready.state, (grip.robot,), ahead, at, total)
            if found is not None:
                return found
        return None

    def _put_down(self, done: "_Progressed") -> "_Progressed | None":
        """With nothing in the hand; None where the tool cannot be put back."""
        if done.grip is None:
            return done
        self._report("motion", text=f"{done.grip.robot} puts '{done.grip.tool}' down")
        try:
            motion = self.backend.put_down(self.scene, done.state, done.grip, self._seed(), self._time_left())
        except MotionError as error:
            self._failed(error)
            return None
        return done.after(motion, None)

    def _failed(self, error: HmapError) -> None:
        self.last_failure, self.last_code = str(error), error.code

    def _motion(self, scene, state, object: str, contact: RobotContact, poses: np.ndarray) -> SegmentMotion | None:
        try:
            return self.backend.solve_segment(scene, state, object, contact, poses, self._seed(), self._time_left())
        except MotionError as error:
            self._failed(error)
            return None

    def _finished(self, motions: list[SegmentMotion], waypoints: np.ndarray) -> Plan | None:
        """The plan, once the judge has accepted it; None when it has not."""
        planning_time = time.monotonic() - self.began
        kinds = [s.kind for m in motions for s in m.segments]
        stats = {
            "planning_time_s": planning_time,
            "waypoints": len(waypoints),
            "contacts": sum(kind != SegmentKind.TRANSIT for kind in kinds),
            "mode_switches": max(0, len(kinds) - 1),
            **self.counts,
        }
        plan = assemble(self.scene, self.start, motions, waypoints, stats)
        self._report("checking", len(waypoints), len(waypoints), text="the judge looks at the plan")
        report = check(to_dict(plan))
        if not report.valid:
            worst = report.violations[0]
            self.last_code = Code.PLAN_REJECTED
            self.last_failure = (
                f"the judge rejects the plan: {worst.kind} of {', '.join(worst.bodies)} at {worst.time:.2f} s, "
                f"{worst.amount:.4g} where {worst.limit:.4g} is allowed"
            )
            return None
        self._report("done", len(waypoints), len(waypoints), text=f"planned in {planning_time:.2f} s")
        return plan

    def _check_goal(self, goal: Goal) -> None:
        body = self.scene.bodies.get(goal.object)
        if body is None or body.kind == BodyKind.FIXED:
            movable = ", ".join(n for n, b in self.scene.bodies.items() if b.kind != BodyKind.FIXED)
            raise InputError(f"goal object '{goal.object}' cannot be moved; allowed: {movable}", Code.UNKNOWN_OBJECT)

    def _check_start(self, goal: Goal) -> None:
        """No robot may stand beyond its limits or in something."""
        for name, robot in self.scene.robots.items():
            q, limits = self.start.q[name], robot.model.position_limits
            for joint, value, low, high in zip(robot.model.joint_names, q, *limits, strict=True):
                if not low <= value <= high:
                    raise InputError(
                        f"robot '{name}' starts with {joint} at {value:.4f}; allowed: {low:.4f} to {high:.4f}",
                        Code.INVALID_INPUT,
                    )
            hit = standing_collision(self.scene, self.start, name, goal.object)
            if hit is not None:
                raise InputError(
                    f"robot '{name}' starts {hit[1] * 1e3:.1f} mm inside: {' and '.join(hit[0])} overlap",
                    Code.START_IN_COLLISION,
                )

    def _check_reach(self, goal: Goal, last_poses: np.ndarray) -> None:
        """Raises ContactError when no robot could bring the object along the last poses, whatever the way there."""
        there = self.start.copy()
        there.poses[goal.object] = last_poses[0]
        try:
            self.backend.propose_contacts(
                self.scene, there, goal.object, last_poses, tuple(self.scene.robots), None, 1, self._seed(),
                self._time_left(),
            )  # fmt: skip
        except ContactError as error:
            place = ", ".join(f"{v:.3f}" for v in goal.pose[:3])
            raise ContactError(
                f"the goal of '{goal.object}' at ({place}) is out of reach of {', '.join(self.scene.robots)}: "
                "no contact can bring it there",
                Code.OUT_OF_REACH,
            ) from error

    def _report(self, phase: str, waypoint: int = 0, waypoints: int = 0, attempt: int = 0, text: str = "") -> None:
        self._progress(Progress(phase, waypoint, waypoints, attempt, text))
        self._time_left()

    def _time_left(self) -> float:
        """Seconds left; raises PlannerError when there are none, or when the job was canceled."""
        if self._canceled():
            raise PlannerError("planning was canceled", Code.CANCELED)
        left = self.deadline - time.monotonic()
        if left <= 0.0:
            raise PlannerError(f"no plan within {self.time_limit:g} s; last: {self.last_failure}", Code.TIME_LIMIT)
        return left

    def _seed(self) -> int:
        return int(self.rng.integers(_MAX_SEED))


def plan(scene: Scene, state: SceneState | None = None, seed: int = 0, **options) -> Plan:
    """Plans a task; see :class:`Planner` for the options.

    Raises:
        HmapError: of the stage that failed, with the reason.
    """
    return Planner(scene, state, seed, **options).plan()
