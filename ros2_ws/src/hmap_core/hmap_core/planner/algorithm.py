"""Algorithm 1: waypoints, contacts, motions, and what happens when one of them fails."""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from hmap_core.contacts.camera import Cloud
from hmap_core.contacts.grippable import grippable
from hmap_core.contacts.hand import hand_of
from hmap_core.contacts.push_path import PushPlanner, final_pushes
from hmap_core.exceptions import Code, ContactError, HmapError, MotionError, PlannerError
from hmap_core.plan_file import to_dict
from hmap_core.planner import preconditions
from hmap_core.planner.assembly import assemble, scene_at
from hmap_core.planner.attached_path import attached_paths
from hmap_core.planner.diagnosis import why_no_contact
from hmap_core.planner.filters import Considerate, InHand, Reminded, Whole
from hmap_core.planner.interfaces import (
    AttachedPath,
    Backend,
    Progress,
    ProgressCallback,
    RobotContact,
    SubTrajectory,
    ToolGrasp,
)
from hmap_core.planner.local import PHYSICAL_MIN_DISTANCE, LocalBackend, placed_bodies
from hmap_core.planner.obstacle_removal import ObstacleRemoval, RemovalError, SolutionSequence, Subgoal, may_go
from hmap_core.planner.obstruction import CONTACT_ROOM, RelaxedSolution, in_motions, met, without
from hmap_core.planner.sweep import motion_sweeps, object_sweep
from hmap_core.planner.tools import attach_tool, tools_of, with_tool_attached, with_tool_placed
from hmap_core.transforms import inverse, multiply, quaternion_multiply
from hmap_core.types import ContactPoint, Goal, Plan, Scene, SceneState, SegmentKind, TaskMode
from hmap_core.validation import check
from hmap_core.waypoints import NoObjectPath, ObjectPath, ObjectPathProblem, slide_then_lift

J_MAX = 40  # contacts tried at one waypoint before new waypoints are asked for (the paper's j_max)
WAYPOINT_ROUNDS = 6  # object paths tried
BLOCKED_ROUNDS = 2  # of these, in which an obstacle could not be put out of the way
PATHS_AT_FIRST = 3  # object paths before others are sought for a hand, as long as they lead to no contact at all
HANDS_TRIED = 3  # of a robot, with which a path is sought
REMOVAL_ROUNDS = 2  # of an obstacle: sliding where it can, and lifted
WAYPOINT_CHECKS = 500_000  # motions for one of them, some 5 s
PLACE_CHECKS = 100_000  # motions for the path of an obstacle to one of several places
PUSHED_PATHS = 3  # of pushes, for one object path
REACH_TRIES = 2  # samplings of contacts without success, after which the goal counts as out of reach
TOOLS_TRIED = 6  # holds on tools that are tried at one waypoint
LITTLE = 8  # poses of the path: contacts by hand that serve for less are not worth much where there are tools
SAMPLINGS = 3  # of contacts by hand at one waypoint before tools are thought of, which takes ten times as long
TRIES_WITH_TOOL = 4  # contacts tried with one hold on a tool before another hold is
REACH_TURNS = 2  # of an object that slides, in which it is asked about, too
LEVEL_PATH = 1e-3  # m that a path may rise where the object slides
GOAL_SHARE = 0.5  # of the goal's tolerance that a plan may use so that the object need not be turned
GOAL_TURN = float(np.deg2rad(45.0))  # rad by which the goal is turned at most, where its tolerance allows it
LEVEL = 1e-3  # rad of tilt that does not count
GOAL_POSES = 4  # last poses of the object's path at which the goal has to be within reach
DEFAULT_TIME_LIMIT = 60.0  # s
_MAX_SEED = 2**31 - 1


def unturned(goal: Goal, T_start: np.ndarray) -> Goal:
    """The goal with the object turned about the vertical as at T_start (7,), where half the tolerance allows it."""
    turn = multiply(np.r_[np.zeros(3), goal.pose[3:]], inverse(np.r_[np.zeros(3), T_start[3:]]))
    angle = 2.0 * np.arccos(np.clip(abs(turn[6]), 0.0, 1.0))
    tilt = 2.0 * np.arcsin(min(1.0, float(np.hypot(turn[3], turn[4]))))
    if angle > GOAL_SHARE * goal.rotation_tolerance or tilt > LEVEL:
        return goal
    return replace(goal, pose=np.concatenate([goal.pose[:3], T_start[3:]]))


def turned(goal: Goal, share: float) -> Goal:
    """The goal turned about the vertical by a share in [-1, 1] of GOAL_TURN, where half the tolerance allows that."""
    if GOAL_SHARE * goal.rotation_tolerance < GOAL_TURN:
        return goal
    return replace(goal, pose=_about_vertical(goal.pose, share * GOAL_TURN))


def _about_vertical(T: np.ndarray, angle: float) -> np.ndarray:
    turn = np.array([0.0, 0.0, np.sin(0.5 * angle), np.cos(0.5 * angle)])
    return np.concatenate([T[:3], quaternion_multiply(turn, T[3:])])


def nearest_first(scene: Scene, object: str, state: SceneState, robots: Sequence[str]) -> tuple[str, ...]:
    """Robots in the order in which they should be asked for contacts on an object: the nearest first."""
    place = state.poses[object][:2]
    return tuple(sorted(robots, key=lambda name: float(np.linalg.norm(scene.robots[name].base_pose[:2] - place))))


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
        grip: on the tool that a robot has in its hand at the start.
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
        grip: ToolGrasp | None = None,
    ):
        self._as_written = state is None and grip is None
        if grip is not None:
            state = with_tool_attached(scene, scene.start_state() if state is None else state, grip)
        self.scene = scene if state is None else scene_at(scene, state)
        self.start = self.scene.start_state() if state is None else state.copy()
        self.grip = grip
        self.backend = backend or LocalBackend()
        self.rng = np.random.default_rng(seed)
        self.began = time.monotonic()
        self.deadline = self.began + time_limit
        self.time_limit = time_limit
        self.clouds = dict(clouds or {})
        self._progress = progress or (lambda progress: None)
        self._canceled = canceled or (lambda: False)
        self.last_failure, self.last_code = "nothing was tried yet", Code.NO_MOTION
        self.removal = ObstacleRemoval(self)
        self.counts = {"waypoint_plans": 0, "contact_proposals": 0, "contact_tries": 0}

    def plan(self) -> Plan:
        """The outer loop: object paths until segments are found for all of one, and the judge accepts them."""
        goal = self.scene.goal
        preconditions.check_goal(self.scene, goal)
        if self._as_written:
            preconditions.check_bodies(self.scene, goal)
        held = self.scene if self.grip is None else attach_tool(self.scene, self.grip)
        preconditions.check_robots(held, self.start, goal.object)
        preconditions.check_reach(self.scene, self.start, goal)
        blocked = 0
        for attempt in range(WAYPOINT_ROUNDS):
            self.removal.begun = 0
            try:
                found = self._attempt(Subgoal(goal), SolutionSequence(self.start, grip=self.grip), attempt)
            except RemovalError:
                blocked += 1
                if blocked == BLOCKED_ROUNDS:
                    raise
                continue
            except NoObjectPath:
                if attempt == 0:
                    raise
                continue  # the object has a path, and the last failure tells why it led nowhere
            plan = self._finished(*found) if found is not None else None
            if plan is not None:
                return plan
        raise PlannerError(
            f"no plan after {WAYPOINT_ROUNDS} object paths of '{goal.object}'; last: {self.last_failure}",
            self.last_code,
        )

    def bring(self, subgoal: Subgoal, solution: SolutionSequence) -> SolutionSequence:
        """The algorithm for an obstacle: its object is brought to its goal, from where the solution has come to.

        Raises:
            HmapError: there is no way, or it could not be gone; the last failure as reason.
        """
        self.last_failure, self.last_code = "nothing was tried yet", Code.NO_MOTION
        for attempt in range(REMOVAL_ROUNDS):
            found = self._attempt(subgoal, solution, attempt)
            if found is not None:
                return found[0]
        raise PlannerError(self.last_failure, self.last_code)

    def _attempt(
        self, subgoal: Subgoal, solution: SolutionSequence, attempt: int
    ) -> tuple[SolutionSequence, np.ndarray] | None:
        """One object path, what is in its way put aside, and its segments; None when something of it fails.

        Raises WaypointError or InputError when there is no path, RemovalError when what is in its way cannot go,
        ContactError when the task's goal is out of reach.
        """
        tries, known = self.counts["contact_tries"], []
        for _ in range(PATHS_AT_FIRST if attempt == 0 else 1):
            self._report("waypoints", text=f"path of '{subgoal.goal.object}' {subgoal.reason}")
            try:
                poses, blockers = self._way(subgoal, solution, attempt)
            except NoObjectPath:
                if not known:
                    raise
                break
            if any(np.array_equal(poses, other) for other in known):
                continue  # and the next one may differ
            known.append(poses)
            self.counts["waypoint_plans"] += 1
            ready = self._cleared(subgoal, solution, poses, blockers)
            found = ready and self._segments(subgoal, ready[0], poses, ready[1])
            if found or blockers or self.counts["contact_tries"] > tries:
                break
        found = found or self._with_a_hand(subgoal, solution, attempt)
        for other in self._on_the_support(subgoal, ready[0], poses, attempt) if ready and found is None else ():
            found = self._segments(subgoal, ready[0], other)
            if found is not None:
                break
        return self._stuck(subgoal, poses) if found is None else found

    def _cleared(self, subgoal: Subgoal, solution: SolutionSequence, poses: np.ndarray, blockers: tuple[str, ...]):
        """The solution once bodies on a path are out of the way, and what is known of contacts there; None: no use.

        Raises RemovalError.
        """
        if not blockers:
            return solution, None
        subgoal.raise_if_alone(blockers[0])
        _, known = self._relaxed(subgoal, solution, poses, blockers)
        if known is None:
            return None
        solution = self._place_tool(solution)
        if solution is None:
            return None
        blockers = met(self.scene, solution.state, subgoal.goal.object, poses, blockers)
        return self.removal.clear(subgoal, solution, known.more_than(blockers), known.ways), known

    def _with_a_hand(
        self, subgoal: Subgoal, solution: SolutionSequence, attempt: int
    ) -> tuple[SolutionSequence, np.ndarray] | None:
        """What :meth:`_attempt` makes of paths that are sought for the object and a hand that holds it."""
        for held in self._attached_paths(subgoal, solution, attempt):
            self.counts["waypoint_plans"] += 1
            own = replace(subgoal, held=held)
            try:
                ready = self._cleared(own, solution, held.poses, held.blockers)
            except RemovalError as error:
                self._failed(error)
                continue
            found = ready and self._segments(own, ready[0], held.poses, ready[1])
            if found is not None:
                return found
        return None

    def _attached_paths(self, subgoal: Subgoal, solution: SolutionSequence, attempt: int) -> Iterator[AttachedPath]:
        """Such paths, of one robot after the other."""
        object, state = subgoal.goal.object, with_tool_placed(solution.state, solution.grip)
        goal, scene = self._goal_of(subgoal, state, attempt), self._path_scene(subgoal, solution, attempt)
        self._report("waypoints", text=f"path of '{object}' in a hand {subgoal.reason}")
        for robot in nearest_first(scene, object, state, tuple(scene.robots)):
            hands = [(robot, contact) for contact in self._hands(scene, state, goal, robot)]
            yield from attached_paths(self.backend, scene, state, goal, hands, self.rng, self._time_left())

    def _hands(self, scene: Scene, state: SceneState, goal: Goal, robot: str) -> list[ContactPoint]:
        bare = without(scene, scene.removable)
        return self.backend.contacts_at_both_ends(bare, state, goal.object, goal.pose, robot, HANDS_TRIED, self._seed())

    def _stuck(self, subgoal: Subgoal, poses: np.ndarray) -> None:
        """Looks why the task's object got stuck: raises ContactError when its goal is out of reach."""
        if subgoal.depth == 0 and self.last_code == Code.NO_CONTACT:
            self._check_reach(subgoal.goal, poses[-GOAL_POSES:])

    def _way(self, subgoal: Subgoal, solution: SolutionSequence, attempt: int) -> tuple[np.ndarray, tuple[str, ...]]:
        """Poses of the object on a path to its goal, and the removable bodies that are in its way."""
        state = with_tool_placed(solution.state, solution.grip)
        goal = self._goal_of(subgoal, state, attempt)
        scene = self._path_scene(subgoal, solution, attempt)
        checks = WAYPOINT_CHECKS if subgoal.depth == 0 else PLACE_CHECKS
        try:
            poses = self._path(scene, state, goal, checks).poses
            return self._pushable(state, goal.object, poses, attempt), ()
        except NoObjectPath as error:
            if not error.free_without:
                raise
            blockers, path = error.free_without, error.path_without
        if path is None:
            path = self._path(without(scene, blockers), state, goal, checks)
        return path.poses, blockers

    def _goal_of(self, subgoal: Subgoal, state: SceneState, attempt: int) -> Goal:
        """The goal of an subgoal, turned where its tolerance allows it."""
        goal = unturned(subgoal.goal, state.poses[subgoal.goal.object])
        if attempt > 0 and self.scene.mode != TaskMode.KINEMATIC:  # which directions can be pushed turns along
            goal = turned(goal, self.rng.uniform(-1.0, 1.0))
        return goal

    def _pushable(self, state: SceneState, object: str, poses: np.ndarray, attempt: int) -> np.ndarray:
        """The path by pushes, where no hand can grip the object; every second attempt as it is."""
        body = self.scene.bodies[object]
        hands = [hand_of(robot) for robot in self.scene.robots.values()]
        if self.scene.mode == TaskMode.KINEMATIC or attempt % 2 or grippable(body, poses[0], hands):
            return poses
        pushed = self._pushes(state, object, poses).path(poses, self.rng if attempt else None)
        return poses if pushed is None else pushed

    def _pushes(self, state: SceneState, object: str, poses: np.ndarray) -> PushPlanner:
        """Finds paths made of pushes from the first of the poses to the last."""
        around = placed_bodies(self.scene, state, object)
        return PushPlanner(
            ObjectPathProblem(
                self.scene.bodies[object], poses[0], poses[-1], around, min_distance=PHYSICAL_MIN_DISTANCE
            )
        )

    def _on_the_support(self, subgoal: Subgoal, solution: SolutionSequence, poses: np.ndarray, attempt: int):
        """The path (M, 7) in other ways: with its head on the support, or made of pushes where it all lies there.

        Pushes may bring the object to where a hand can grip it; and few paths can be pushed as they are found. Where
        one contact has to do it all, there are none.
        """
        if self.scene.mode == TaskMode.KINEMATIC or subgoal.whole:
            return
        object, state = subgoal.goal.object, with_tool_placed(solution.state, solution.grip)
        around = placed_bodies(self.scene, state, object)
        slid = slide_then_lift(ObjectPathProblem(self.scene.bodies[object], poses[0], poses[-1], around), poses)
        if slid is not None:
            yield slid
        known, pushes = [poses], self._pushes(state, object, poses)
        for variant in range(attempt, attempt + PUSHED_PATHS):
            pushed = pushes.path(poses, self.rng if variant else None)
            if pushed is not None and not any(np.array_equal(pushed, other) for other in known):
                known.append(pushed)
                yield pushed

    def _path_scene(self, subgoal: Subgoal, solution: SolutionSequence, attempt: int) -> Scene:
        """The scene as the search for a path has to see it.

        Where sliding and lifting are both allowed, as they are for obstacles, every second attempt lifts.
        """
        motion = self.scene.motion if subgoal.depth == 0 else "auto"
        if motion == "auto" and attempt % 2 == 1:
            motion = "spatial"
        removable = {name: self.scene.removable[name] for name in may_go(self.scene, subgoal, solution)}
        return replace(self.scene, motion=motion, removable=removable)

    def _path(self, scene: Scene, state: SceneState, goal: Goal, checks: int) -> ObjectPath:
        return self.backend.plan_waypoints(scene, state, goal.object, goal, self._seed(), self._time_left(), checks)

    def _segments(
        self, subgoal: Subgoal, solution: SolutionSequence, poses: np.ndarray, known: RelaxedSolution | None = None
    ) -> tuple[SolutionSequence, np.ndarray] | None:
        """The main loop: contacts and motions until the object is at its goal; None when a waypoint cannot be left.

        ``known`` is what worked at the first waypoint before obstacles were put aside.
        """
        object, waypoints = subgoal.goal.object, []
        at = 0
        while at < len(poses) - 1:
            ahead = np.concatenate([solution.state.poses[object][None], poses[at + 1 :]])
            backend = self._backend_for(subgoal)
            backend = backend if known is None else Reminded(backend, known, ahead)
            step = self._step_of(self.scene, backend, object, solution, ahead, (at, len(poses) - 1))
            known = None
            if step is None:
                step, known = self._relaxed(subgoal, solution, ahead)
                if known is not None:
                    solution = self._place_tool(solution)
                    if solution is None:
                        return None
                    solution = self.removal.clear(subgoal, solution, known.in_the_way, known.ways)
                    continue
            if step is None:
                return None
            solution, reach = step
            at += reach
            waypoints.append(poses[at])
        solution = self._place_tool(solution)
        return None if solution is None else (solution, np.array(waypoints).reshape(-1, 7))

    def _relaxed(self, subgoal: Subgoal, solution: SolutionSequence, ahead: np.ndarray, blockers: tuple[str, ...] = ()):
        """What can be done at a waypoint when removable bodies are gone: only the ``blockers``, else all of them.

        Returns (solution and reach, None) where the motion hits none of them, (None, RelaxedSolution) where it does,
        and
        (None, None) where there is none even so.
        """
        object, state, names = subgoal.goal.object, solution.state, may_go(self.scene, subgoal, solution)
        for gone in dict.fromkeys((blockers, names)) if names else ():
            if not gone:
                continue
            bare = without(self.scene, gone)
            backend = Considerate(self._backend_for(subgoal), self.scene, gone)
            step = self._step_of(bare, backend, object, solution, ahead, (0, len(ahead) - 1))
            if step is None:
                continue
            motions = step[0].motions[len(solution.motions) :]
            hit = in_motions(self.scene, state, motions, gone)
            if not hit and not blockers:
                return step, None
            ways = [object_sweep(self.scene, object, ahead)]
            ways += [way for motion in motions for way in motion_sweeps(self.scene, state, motion, CONTACT_ROOM)]
            return None, RelaxedSolution(backend.solved, None if backend.solved else backend.grip, hit, tuple(ways))
        return None, None

    def _backend_for(self, subgoal: Subgoal) -> Backend:
        backend = self.backend if subgoal.held is None else InHand(self.backend, subgoal.held)
        return Whole(backend) if subgoal.whole else backend

    def _step_of(
        self, scene: Scene, backend: Backend, object: str, solution: SolutionSequence, ahead: np.ndarray, progress
    ):
        """:meth:`_step` in another scene or with another backend; ``progress`` is (waypoint, of how many)."""
        other = copy(self)
        other.scene, other.backend = scene, backend
        step = other._step(object, solution, ahead, *progress)
        self.last_failure, self.last_code = other.last_failure, other.last_code
        return step

    def _step(self, object: str, solution: SolutionSequence, ahead: np.ndarray, at: int, total: int):
        """The inner loop: contacts at one waypoint until one gives a motion.

        By hand, else with a tool. With a tool in the hand a contact by hand that does not serve to the end of the path
        has to wait until that tool was asked. Where there are tools, contacts by hand that serve for less than LITTLE
        poses are kept for the end. Returns (solution, reach), or None.
        """
        free, robots = with_tool_placed(solution.state, solution.grip), tuple(self.scene.robots)

        def by_hand(least: int, samplings: int = 1):
            return self._by_contacts(
                object, solution, self.scene, free, robots, ahead, at, total, least=least, samplings=samplings
            )

        found = None
        if solution.grip is not None:
            found = by_hand(len(ahead) - 1)
            if found is None:
                scene = attach_tool(self.scene, solution.grip)
                found = self._by_contacts(
                    object, solution, scene, solution.state, (solution.grip.robot,), ahead, at, total
                )
        least, samplings = (min(LITTLE, len(ahead) - 1), SAMPLINGS) if tools_of(self.scene, object) else (0, 1)
        found = found or by_hand(least, samplings) or self._by_tool(object, solution, ahead, at, total)
        return by_hand(0) if found is None and least else found

    def _by_contacts(
        self,
        object: str,
        solution: SolutionSequence,
        scene: Scene,
        state: SceneState,
        robots,
        ahead,
        at,
        total,
        contacts=(),
        least=0,
        samplings=1,
    ):
        """Contacts in a scene, in which a robot may hold a tool, until one gives a motion.

        Those given come first; those that serve for less than ``least`` poses are left out. Where none is found, they
        are sampled ``samplings`` times.
        """
        tries, ready = 0, None
        most = J_MAX if scene is self.scene else TRIES_WITH_TOOL
        robots = nearest_first(scene, object, state, robots)
        while tries < most:
            samplings -= 1
            try:
                contacts = contacts or self._contacts(scene, state, object, ahead, robots, most - tries, at, total)
            except ContactError as error:
                self._failed(error)
            contacts = [contact for contact in contacts if contact.reach >= least]
            if not contacts and samplings > 0:
                continue
            if not contacts:
                return None
            ready = ready or (self._place_tool(solution) if scene is self.scene else solution)
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
            failed = {contact.robot for contact in contacts}
            robots = tuple(sorted(robots, key=failed.__contains__))  # the others are asked first the next time
            contacts = ()
        return None

    def _contacts(self, scene: Scene, state: SceneState, object: str, ahead, robots, count: int, at: int, total: int):
        """Contacts on an object. Raises ContactError."""
        who = f"'{object}'" if scene is self.scene else f"'{object}' with what {robots[0]} holds"
        self._report("contacts", at, total, text=f"contacts on {who}")
        cloud = self.clouds.get(object)
        contacts = self.backend.propose_contacts(
            scene, state, object, ahead, robots, cloud, count, self._seed(), self._time_left()
        )
        self.counts["contact_proposals"] += 1
        return contacts

    def _by_tool(self, object: str, solution: SolutionSequence, ahead: np.ndarray, at: int, total: int):
        """A tool that one robot takes, and with which it moves the object. Returns (solution, reach), or None."""
        if not tools_of(self.scene, object):
            return None
        solution = self._place_tool(solution)
        if solution is None:
            return None
        self._report("contacts", at, total, text=f"tools for '{object}'")
        grips = self.backend.tool_grasps(self.scene, solution.state, object, ahead, self._seed(), self._time_left())
        for grip, _ in grips[:TOOLS_TRIED]:
            scene, robots = attach_tool(self.scene, grip), (grip.robot,)
            try:
                contacts = self._contacts(scene, solution.state, object, ahead, robots, TRIES_WITH_TOOL, at, total)
                self._report("motion", at, total, text=f"{grip.robot} takes '{grip.tool}'")
                taken = self.backend.pick_tool(self.scene, solution.state, grip, self._seed(), self._time_left())
            except (ContactError, MotionError) as error:
                self._failed(error)
                continue
            ready = replace(solution.after(taken), grip=grip)
            contacts = [replace(contact, clear=()) for contact in contacts]  # who was away went home before
            found = self._by_contacts(object, ready, scene, ready.state, robots, ahead, at, total, contacts)
            if found is not None:
                return found
        return None

    def _place_tool(self, solution: SolutionSequence) -> SolutionSequence | None:
        """With nothing in the hand; None where the tool cannot be put back."""
        if solution.grip is None:
            return solution
        self._report("motion", text=f"{solution.grip.robot} puts '{solution.grip.tool}' down")
        try:
            motion = self.backend.place_tool(self.scene, solution.state, solution.grip, self._seed(), self._time_left())
        except MotionError as error:
            self._failed(error)
            return None
        return replace(solution.after(motion), grip=None)

    def _failed(self, error: HmapError) -> None:
        self.last_failure, self.last_code = str(error), error.code

    def _motion(self, scene, state, object: str, contact: RobotContact, poses: np.ndarray) -> SubTrajectory | None:
        try:
            return self.backend.solve_segment(scene, state, object, contact, poses, self._seed(), self._time_left())
        except MotionError as error:
            self._failed(error)
            return None

    def _finished(self, solution: SolutionSequence, waypoints: np.ndarray) -> Plan | None:
        """The plan, once the judge has accepted it; None when it has not."""
        planning_time = time.monotonic() - self.began
        kinds = [s.kind for m in solution.motions for s in m.segments]
        stats = {
            "planning_time_s": planning_time,
            "waypoints": len(waypoints),
            "contacts": sum(kind != SegmentKind.TRANSIT for kind in kinds),
            "mode_switches": max(0, len(kinds) - 1),
            "removals": len(solution.aside),
            "removal_depth": solution.depth,
            **self.counts,
        }
        plan = assemble(self.scene, self.start, solution.motions, waypoints, stats)
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

    def _check_reach(self, goal: Goal, last_poses: np.ndarray) -> None:
        """Raises ContactError when no robot could bring the object along the last poses, whatever the way there."""
        there = with_tool_placed(self.start, self.grip).copy()
        scene = without(self.scene, self.scene.removable.keys() - {goal.object})
        for poses in self._ways_in(goal.object, last_poses):
            there.poses[goal.object] = poses[0]
            try:
                self.backend.propose_contacts(
                    scene, there, goal.object, poses, tuple(self.scene.robots), None, 1, self._seed(),
                    self._time_left(),
                )  # fmt: skip
                return
            except ContactError as error:
                failure = error
            if self._tool_reaches(scene, there, goal.object, poses):
                return
        place = ", ".join(f"{v:.3f}" for v in goal.pose[:3])
        raise ContactError(
            f"the goal of '{goal.object}' at ({place}) is out of reach of {', '.join(self.scene.robots)}: "
            f"no contact can bring it there: {why_no_contact(scene, there, goal.object, goal.pose)}",
            Code.OUT_OF_REACH,
        ) from failure

    def _ways_in(self, object: str, last_poses: np.ndarray) -> list[np.ndarray]:
        """Last poses (M, 7) of paths to the goal: the given ones, and pushes on each of its sides, turned or not.

        Which directions it can be pushed in depends on how it is turned; whether hands reach the goal does not.
        """
        ways = [last_poses] * REACH_TRIES
        if self.scene.mode == TaskMode.KINEMATIC or np.ptp(last_poses[:, 2]) > LEVEL_PATH:
            return ways
        turns = [0.0, *self.rng.uniform(-np.pi, np.pi, REACH_TURNS)]
        for turn in turns:
            ways += final_pushes(self.scene.bodies[object], _about_vertical(last_poses[-1], turn), len(last_poses))
        return ways

    def _tool_reaches(self, scene: Scene, state: SceneState, object: str, poses: np.ndarray) -> bool:
        """Whether some tool in some hand could bring an object along poses (M, 7)."""
        if not tools_of(scene, object):
            return False
        grips = self.backend.tool_grasps(scene, state, object, poses, self._seed(), self._time_left())
        for grip, _ in grips[:TOOLS_TRIED]:
            try:
                self.backend.propose_contacts(
                    attach_tool(scene, grip),
                    state,
                    object,
                    poses,
                    (grip.robot,),
                    None,
                    1,
                    self._seed(),
                    self._time_left(),
                )
                return True
            except ContactError:
                continue
        return False

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
