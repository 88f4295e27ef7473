"""The motion of one segment: come, touch, carry, let go, draw back. By KOMO, then verified between steps and timed.

The skeleton of a segment (eq. 2 of the paper): ``pose_eq`` with the pre-contact pose at the end of the transit; a
straight approach; ``touch`` at the mode switch; ``stable`` while holding, with the object's waypoints as ``pose_eq``;
a straight retreat. The object's path was found collision-free between its poses, and the hold follows it pose by pose,
so what was verified for the object stays true for the object in the hand.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from scipy.interpolate import CubicSpline

from hmap_core.collision.scene_model import CollisionModel, Collisions
from hmap_core.contacts.feasibility import APPROACH_STEPS, MAX_JUMP, draw_back, ik_problem
from hmap_core.exceptions import Code, MotionError
from hmap_core.kinematics.arm import load_arm
from hmap_core.kinematics.chain import Chain
from hmap_core.komo.allowances import relaxed, verification
from hmap_core.komo.features import joint_position, pose_params_all, relative_pose
from hmap_core.komo.ik import follow_ik
from hmap_core.komo.manipulation import CARRIED, Manipulation, Phase, bit, free_opening, retreated
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.options import SolverOptions
from hmap_core.komo.path_collisions import path_violations
from hmap_core.komo.sweep import between_violations
from hmap_core.komo.transcription import KomoProblem
from hmap_core.komo.violations import VERIFY_STEP
from hmap_core.planner.interfaces import RobotContact, SubTrajectory
from hmap_core.planner.transit import resampled
from hmap_core.planner.transit_search import TransitSearch
from hmap_core.trajectory.timing import spline, time_parameterise
from hmap_core.transforms import IDENTITY, consistent, inverse, multiply, multiply_all, pose, rotation_matrix
from hmap_core.types import (
    AttachedBody,
    ContactPoint,
    Scene,
    SceneState,
    Segment,
    SegmentKind,
    TaskMode,
    Trajectory,
)

SAMPLE_PERIOD = 0.02  # s between two samples of a plan
JOINT_STEP = 0.2  # rad between two steps of a transit, about
TRANSIT_STEPS = (8, 24)  # least and most
LIMIT_SAMPLES = 10  # per step of a path, at which the joint limits are verified
HOLD_STEP = (0.04, 0.15)  # m, rad between two steps of a hold, about
HOLD_FINENESS = (1.0, 0.3)  # shares of that step that are tried
VERIFY_DEVIATION = 0.0001  # m of a path from the straight pieces that are verified in its place
SMOOTHNESS = 1.0 / 160.0  # weight of the squared accelerations, times the number of steps cubed
STIFFNESS = 30.0  # first penalty of the constraints, as a multiple of that weight: first guesses are nearly feasible
SEARCH_TIME = 10.0  # s that may go into one joint-space search; its number of checks ends it earlier
# share of the joint limits that is used: quick in the air, slow with an object, so that friction holds and a controller
# follows within the clearance
FREE_SPEED, FREE_ACCELERATION = 0.6, 0.3
HOLD_SPEED, HOLD_ACCELERATION = 0.2, 0.05
CARRY_SPEED, CARRY_ACCELERATION = 0.3, 0.08  # through the air with a tool in the hand
STANDING_DEPTH = 0.001  # m that a robot may stand inside of something when a plan begins
LIFTS = (0.06, 0.03, 0.015)  # m that what was taken is lifted by, where there is room
LIFT_STEP = 0.01  # m between two configurations of that
SAME_OPENING = 1e-9  # m
CARRYING = "carrying"  # what is said first of a motion that is wrong on the object's path
SETTLE = 0.3  # s that the fingers get to settle after they have closed or opened


@dataclass(frozen=True)
class _ModeMotion:
    """A sampled stretch in one mode: q (N, n), opening (N,), and poses (N, 7) of the bodies that move along.

    Of a contact: the object, the manipulator and its pose (7,) in the object's frame.
    """

    robot: str
    q: np.ndarray
    opening: np.ndarray
    kind: SegmentKind = SegmentKind.TRANSIT
    object: str | None = None
    manipulator: str | None = None
    contact_pose: np.ndarray | None = None
    moved: dict[str, np.ndarray] = field(default_factory=dict)


def solve_segment(
    scene: Scene,
    state: SceneState,
    object: str,
    contact: RobotContact,
    object_poses: np.ndarray,
    rng: np.random.Generator,
    time_limit: float,
) -> SubTrajectory:
    """Plans the motion in which ``contact`` carries the object along object_poses (K, 7), from the present state.

    A robot that holds a body touches the object with that, and holds it still at the end.

    Raises:
        MotionError: NO_MOTION, with the constraint that stays violated and where.
    """
    deadline = time.monotonic() + time_limit
    pieces, cleared = _made_ready(scene, state, contact, object, rng, deadline)
    pieces += _carry(scene, cleared, object, contact, object_poses, rng, deadline)
    return _assembled(scene, state, pieces)


def pick(
    scene: Scene, state: SceneState, contact: RobotContact, body: str, rng: np.random.Generator, time_limit: float
) -> SubTrajectory:
    """The motion in which a robot takes a body where it stands, and lifts it where there is room.

    Raises:
        MotionError: NO_MOTION.
    """
    deadline = time.monotonic() + time_limit
    pieces, cleared = _made_ready(scene, state, contact, body, rng, deadline)
    pieces.append(_Segment(scene, cleared, body, contact, state.poses[body][None]).come(rng, deadline))
    there, opening = pieces[-1].q[-1], pieces[-1].opening[-1]
    cleared.q[contact.robot], cleared.gripper[contact.robot] = there, opening
    holding = attach_body(scene, contact.robot, body, contact.contact, state.poses[body])
    pieces += _with_attached(holding, _lift_piece(holding, cleared, contact.robot, there))
    return _assembled(scene, state, pieces)


def come(
    scene: Scene, state: SceneState, contact: RobotContact, object: str, rng: np.random.Generator, time_limit: float
) -> SubTrajectory:
    """The motion in which a robot comes to a contact in exactly the configuration keyframes[0], and closes its gripper.

    Raises:
        MotionError: NO_MOTION.
    """
    deadline = time.monotonic() + time_limit
    pieces, cleared = _made_ready(scene, state, contact, object, rng, deadline)
    pieces.append(_Segment(scene, cleared, object, contact, state.poses[object][None]).come(rng, deadline, exact=True))
    return _assembled(scene, state, pieces)


def go(
    scene: Scene, state: SceneState, robot: str, q: np.ndarray, rng: np.random.Generator, time_limit: float
) -> SubTrajectory:
    """The motion of a robot to the configuration q (n,), with its hand as it is.

    Raises:
        MotionError: NO_MOTION.
    """
    piece = _move(scene, state, robot, None, q, rng, time.monotonic() + time_limit)
    return _assembled(scene, state, _with_attached(scene, piece))


def place(
    scene: Scene,
    state: SceneState,
    contact: RobotContact,
    body: str,
    T_place: np.ndarray,
    rng: np.random.Generator,
    time_limit: float,
) -> SubTrajectory:
    """The motion in which a robot puts the body in its hand down at T_place (7,), where its configuration is
    keyframes[0].

    Raises:
        MotionError: NO_MOTION.
    """
    deadline = time.monotonic() + time_limit
    robot, place = contact.robot, contact.keyframes[0]
    holding = attach_body(scene, robot, body, contact.contact, T_place)
    there = state.copy()
    there.q[robot], there.poses[body] = place, T_place
    lifted = _lifted(holding, there, robot, place)
    transit = _move(holding, state, robot, None, lifted[-1], rng, deadline)
    lowering = _lift_piece(holding, there, robot, place, lifted)
    lowering = replace(lowering, q=lowering.q[::-1])
    pieces = [piece for own in (transit, lowering) for piece in _with_attached(holding, own)]
    pieces.append(_Segment(scene, there, body, contact, T_place[None]).leave())
    return _assembled(scene, state, pieces)


def attach_body(scene: Scene, robot: str, body: str, contact: ContactPoint, T_standing: np.ndarray) -> Scene:
    """The scene in which a body that stood at T_standing (7,) is part of a robot's hand."""
    own, placed = scene.bodies[body], scene.robots[robot]
    up = rotation_matrix(T_standing)[2]
    attached = AttachedBody(body, own.shapes, inverse(contact.T_obj_ee), contact.opening, own.friction, up)
    robots = scene.robots | {robot: replace(placed, model=replace(placed.model, attached=attached))}
    bodies = {name: other for name, other in scene.bodies.items() if name != body}
    removable = {name: T for name, T in scene.removable.items() if name != body}
    return replace(scene, robots=robots, bodies=bodies, removable=removable)


def _made_ready(scene: Scene, state: SceneState, contact: RobotContact, object: str, rng, deadline: float):
    """What comes before a robot goes to a contact: the others go home, and it rises to where its gripper may open."""
    pieces, cleared = _make_room(scene, state, contact, object, rng, deadline)
    return [*pieces, *_rise_to_open(scene, cleared, contact, object)], cleared


def _make_room(scene, state, contact: RobotContact, object: str, rng, deadline) -> tuple[list[_ModeMotion], SceneState]:
    """The pieces in which other robots go home, and the state after them."""
    pieces: list[_ModeMotion] = []
    cleared = state.copy()
    for other in contact.clear:
        home = scene.robots[other].model.home
        pieces += _with_attached(scene, _move(scene, cleared, other, object, home, rng, deadline))
        cleared.q[other] = pieces[-1].q[-1]
    return pieces, cleared


def _rise_to_open(scene: Scene, state: SceneState, contact: RobotContact, object: str) -> list[_ModeMotion]:
    """The piece in which a robot rises, where there is no room to open its gripper; ``state`` is where it then is."""
    robot = contact.robot
    free = free_opening(scene.robots[robot], contact.contact)
    if abs(free - state.gripper[robot]) < SAME_OPENING:
        return []
    opened = state.copy()
    opened.gripper[robot] = free
    hit = standing_collision(scene, opened, robot, object)
    if hit is None:
        return []
    piece = _lift_piece(scene, state, robot, state.q[robot])
    if len(piece.q) == 1:
        raise MotionError(f"robot '{robot}' has no room to open its gripper: {' and '.join(hit[0])}")
    state.q[robot] = piece.q[-1]
    return [piece]


def _lifted(scene: Scene, state: SceneState, robot: str, q: np.ndarray) -> np.ndarray:
    """Configurations (m, n) straight up from q, what the hand holds standing there, as far as there is room; q
    first."""
    manipulation = Manipulation(scene, state, robot, None)
    chain = manipulation.model.chain
    cols = verification(relaxed(chain, manipulation.standing_collisions().arrays(), q, 1))
    T = multiply(scene.robots[robot].base_pose, manipulation.arm.end_effector(q))
    free = ik_problem(manipulation, CollisionModel(), Phase.TRANSIT)
    for height in LIFTS:
        steps = int(np.ceil(height / LIFT_STEP))
        ups = [pose((0.0, 0.0, height * k / steps)) for k in range(1, steps + 1)]
        targets = pose_params_all(manipulation.T_tip_ee, np.array([multiply(up, T) for up in ups]))
        path = follow_ik(free, targets, q, MAX_JUMP)
        if len(path) == steps:
            path = np.concatenate([q[None], path])
            if _violation(manipulation, cols, spline(path), 1)[1] < 0:
                return path
    return q[None]


def _lift_piece(
    scene: Scene, state: SceneState, robot: str, q: np.ndarray, path: np.ndarray | None = None
) -> _ModeMotion:
    """That way as a piece; it has one sample where there is no room to lift."""
    path = _lifted(scene, state, robot, q) if path is None else path
    timed = _timed(scene, robot, path, HOLD_SPEED, HOLD_ACCELERATION) if len(path) > 1 else path
    return _ModeMotion(robot, timed, np.full(len(timed), state.gripper[robot]))


def _with_attached(scene: Scene, piece: _ModeMotion) -> list[_ModeMotion]:
    """A piece of a robot, with what it holds going along: a transit holds that, a contact touches with it."""
    held = scene.robots[piece.robot].model.attached
    if held is None:
        return [piece]
    T_ee_held = held.T_ee_body
    moved = piece.moved | {held.name: consistent(multiply_all(_end_effectors(scene, piece.robot, piece.q), T_ee_held))}
    if piece.kind == SegmentKind.TRANSIT:
        kind = SegmentKind.TOUCH if scene.mode == TaskMode.KINEMATIC else SegmentKind.GRASP
        return [replace(piece, kind=kind, object=held.name, contact_pose=inverse(T_ee_held), moved=moved)]
    contact_pose = multiply(piece.contact_pose, T_ee_held)
    return [replace(piece, manipulator=held.name, contact_pose=contact_pose, moved=moved)]


def _end_effectors(scene: Scene, robot: str, q: np.ndarray) -> np.ndarray:
    """World poses (N, 7) of a robot's end-effector at q (N, n)."""
    placed = scene.robots[robot]
    return multiply_all(placed.base_pose, load_arm(placed.model).end_effectors(q))


def _carry(
    scene, state, object: str, contact: RobotContact, object_poses: np.ndarray, rng, deadline
) -> list[_ModeMotion]:
    """The pieces of the segment itself, with finer steps along the object's path where coarse ones cut a corner."""
    failure = None
    for fineness in HOLD_FINENESS:
        try:
            return _Segment(scene, state, object, contact, object_poses, fineness).solve(rng, deadline)
        except _CutCorner as error:
            failure = error
    raise failure


class _CutCorner(MotionError):
    """The motion is feasible at its steps, but not between those along the object's path."""


def standing_collision(
    scene: Scene, state: SceneState, robot: str, object: str | None = None
) -> tuple[tuple[str, str], float] | None:
    """What a robot stands in: the names of the two parts and how deep (m); None when it stands free.

    Args:
        object: that is to be handled; it is told apart from the bodies around.
    """
    manipulation = Manipulation(scene, state, robot, object)
    collisions = manipulation.standing_collisions(None if object is None else state.poses[object])
    cols = collisions.arrays()
    cols = cols._replace(min_distance=np.full_like(cols.min_distance, -STANDING_DEPTH))
    q = np.ascontiguousarray(state.q[robot])[None]
    excess, pair = path_violations(q, np.ones(1, np.int64), manipulation.model.chain, cols, 0.0)
    return None if pair[0] < 0 else (collisions.pair_name(int(pair[0])), float(excess[0]) + STANDING_DEPTH)


def _move(scene: Scene, state: SceneState, robot: str, object: str | None, q: np.ndarray, rng, deadline) -> _ModeMotion:
    """A transit of a robot to the configuration q (n,), with its hand as it is, past an object that stands."""
    manipulation = Manipulation(scene, state, robot, object)
    collisions = manipulation.standing_collisions(None if object is None else state.poses[object])
    start = state.q[robot]
    steps = _transit_steps(start, q)
    problem = KomoProblem(manipulation.model.chain, (steps,), collisions, _options(steps))
    problem.add(Objective(joint_position(q), ObjectiveType.EQ, [steps - 1]))
    initial = start + np.linspace(0.0, 1.0, steps + 1)[1:, None] * (q - start)
    result = problem.solve(start, initial)
    cols = _relaxed_at_ends(manipulation.model.chain, problem.arrays(), start, q)
    path = np.concatenate([start[None], result.path]) if result.feasible else None
    if path is not None and _violation(manipulation, verification(cols), spline(path), 1)[1] >= 0:
        path = None
    air = TransitSearch(manipulation, collisions, cols, start, q, 1)
    if path is None or not air.has_room(path):
        searched = _free_as_spline(manipulation, cols, air.ways(rng, deadline, path is None))
        path = path if searched is None else searched
        if path is None:
            raise MotionError(f"robot '{robot}' finds no way to move on: {result.worst}")
    timed = _timed_free(scene, robot, path)
    return _ModeMotion(robot, timed, np.full(len(timed), state.gripper[robot]))


def _relaxed_at_ends(chain: Chain, cols: Collisions, start: np.ndarray, goal: np.ndarray) -> Collisions:
    """The pairs with the minimum distances that start and goal (n,) have; at the goal nothing may overlap."""
    at_start = relaxed(chain, cols, start, 1)
    at_goal = relaxed(chain, at_start, goal, 1)
    return at_goal._replace(min_distance=np.maximum(at_goal.min_distance, np.minimum(at_start.min_distance, 0.0)))


def _free_as_spline(manipulation, cols, ways: Iterator[np.ndarray]) -> np.ndarray | None:
    """The first of some ways (m, n) that is free as a spline."""
    cols = verification(cols)
    return next((way for way in ways if _violation(manipulation, cols, spline(way), 1)[1] < 0), None)


def _options(steps: int) -> SolverOptions:
    weight = SMOOTHNESS * steps**3
    return SolverOptions(acceleration=weight, mu=max(SolverOptions.mu, STIFFNESS * weight), mu_max=1e8)


def _transit_steps(a: np.ndarray, b: np.ndarray) -> int:
    return int(np.clip(np.ceil(np.abs(b - a).max() / JOINT_STEP), *TRANSIT_STEPS))


def _timed_free(scene: Scene, robot: str, path: np.ndarray) -> np.ndarray:
    """A transit, slower with something in the hand."""
    held = scene.robots[robot].model.attached is not None
    return _timed(scene, robot, path, *(CARRY_SPEED, CARRY_ACCELERATION) if held else (FREE_SPEED, FREE_ACCELERATION))


def _timed(scene: Scene, robot: str, path: np.ndarray, speed: float, acceleration: float) -> np.ndarray:
    model = scene.robots[robot].model
    limits = speed * model.velocity_limits, acceleration * model.acceleration_limits
    return time_parameterise(path, *limits, SAMPLE_PERIOD).q


def _violation(
    manipulation: Manipulation, cols: Collisions, curve: CubicSpline, phases: int, turn: float = np.inf, then: int = 0
) -> tuple[float, int]:
    """Worst minimum distance violation (m) along the spline of a path, and its pair (-1: none).

    ``phases`` is the bit mask of phases that counts up to the chord length ``turn``, a knot; ``then`` the one after it.
    The spline is looked at as straight pieces, from which no point is farther than VERIFY_DEVIATION.
    """
    chain = manipulation.model.chain
    knots = curve.x
    speed = cols.speed.max(initial=1.0)  # what is held moves farther than the links
    bend = speed * np.abs(curve(knots, 2)) @ chain.reach  # m, of the squared chord length; linear between knots
    lengths = np.diff(knots)
    counts = np.ceil(lengths * np.sqrt(np.maximum(bend[1:], bend[:-1]) / (8.0 * VERIFY_DEVIATION)))
    first = np.concatenate([[0], np.cumsum(np.maximum(counts, 1.0))])  # number of the piece that begins at each knot
    ends = np.interp(np.arange(first[-1] + 1), first, knots)
    masks = np.where(ends[:-1] < turn, phases, then).astype(np.int64)
    path = np.ascontiguousarray(curve(ends))
    violation, pair, _ = between_violations(path, masks, chain, cols, VERIFY_STEP)
    worst = int(violation.argmax())
    return float(violation[worst]), int(pair[worst])


class _Segment:
    """The KOMO problem of one segment of one robot."""

    def __init__(self, scene: Scene, state: SceneState, object: str, contact: RobotContact, object_poses, fineness=1.0):
        self.scene, self.state, self.object = scene, state, object
        self.robot, self.contact = contact.robot, contact.contact
        self.manipulation = Manipulation(scene, state, contact.robot, object)
        self.start = state.q[contact.robot]
        self.poses, self.keyframes = _thinned(object_poses, contact.keyframes, fineness)
        self.T_start, self.T_end = object_poses[0], object_poses[-1]
        self.collisions: CollisionModel = self.manipulation.collisions(self.contact, self.T_start, self.T_end)

    def solve(self, rng: np.random.Generator, deadline: float) -> list[_ModeMotion]:
        before = self._drawn_back(self.T_start, self.keyframes[0], Phase.APPROACH)
        after = self._drawn_back(self.T_end, self.keyframes[-1], Phase.RETREAT)
        make = partial(self._problem, leaving=len(after) > 0)
        coming, carrying, leaving = self._parts(*self._searched(make, before, after, rng, deadline))
        pieces = self._coming(coming), self._carrying(carrying), self._leaving(leaving)
        return [part for piece in pieces for part in _with_attached(self.scene, piece)]

    def _searched(self, make, before, after, rng, deadline: float) -> tuple[KomoProblem, np.ndarray]:
        """The verified path (T, n) and its problem: from the straight way to the contact or from one found by search.

        ``make`` gives the problem for a number of steps of the transit.
        A way with room round what is held comes first. What was found by search is taken as it is where the optimiser,
        which smooths it, makes it collide or takes the room.
        """
        steps, mask = _transit_steps(self.start, before[-1]), bit(Phase.TRANSIT)
        problem = make(steps)
        cols = relaxed(problem.chain, problem.arrays(), self.start, mask)
        air = TransitSearch(self.manipulation, self.collisions, cols, self.start, before[-1], mask)
        until = min(deadline, time.monotonic() + SEARCH_TIME)
        straight = self.start + np.linspace(0.0, 1.0, steps + 1)[1:, None] * (before[-1] - self.start)
        found, why = self._attempt(problem, cols, straight, before, after)
        if found is not None and air.has_room(np.concatenate([self.start[None], found[:steps]])):
            return problem, found
        what = "cannot get to the contact on"
        for way in air.ways(rng, until, found is None) if not why.startswith(CARRYING) else ():
            what = "finds no motion with its contact on"
            path, why = self._attempt(problem, cols, resampled(way, steps), before, after)
            if path is not None and air.has_room(np.concatenate([self.start[None], path[:steps]])):
                return problem, path
            found = path if found is None else found
            if not why.startswith(CARRYING):
                fine = make(len(way) - 1)
                path = self._guess(way[1:], before, after)
                why = self._check(fine, path, cols)
                if not why:
                    return fine, path
            if why.startswith(CARRYING):
                break
        if found is None:
            error = _CutCorner if why.startswith(CARRYING) else MotionError
            raise error(f"robot '{self.robot}' {what} '{self.object}': {why}")
        return problem, found

    def _attempt(self, problem, cols, transit, before, after) -> tuple[np.ndarray | None, str]:
        """Solves from one first guess of the transit (T0, n); returns the verified path, or None and what is wrong."""
        result = problem.solve(self.start, self._guess(transit, before, after))
        if not result.feasible:
            return None, result.worst
        path = result.path
        why = self._check(problem, path, cols)
        if why.startswith("leaving"):
            path = self._leaving_straight(problem, path)
            why = self._check(problem, path, cols)
        return (None, why) if why else (path, "")

    def _leaving_straight(self, problem: KomoProblem, path: np.ndarray) -> np.ndarray:
        """The path (T, n) with its retreat anew from where it lets go.

        The smoothest retreat goes on as the joints moved before, if need be through another configuration of the arm.
        """
        end = problem.last(Phase.HOLD)
        retreating = ik_problem(self.manipulation, self.collisions, Phase.RETREAT)
        after = draw_back(self.manipulation, retreating, self.contact, self.T_end, path[end])
        return np.concatenate([path[: end + 1], after]) if len(after) else path

    def _guess(self, transit: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """The path (T, n) after the start: a transit (T0, n), then the known configurations of the other phases."""
        return np.concatenate([transit, before[-2::-1], self.keyframes, after])

    def _drawn_back(self, T_world_obj: np.ndarray, q: np.ndarray, phase: Phase) -> np.ndarray:
        problem = ik_problem(self.manipulation, self.collisions, phase)
        path = draw_back(self.manipulation, problem, self.contact, T_world_obj, q)
        if not len(path):
            what = "come to" if phase == Phase.APPROACH else "leave"
            raise MotionError(f"robot '{self.robot}' cannot {what} the contact on '{self.object}'", Code.NO_MOTION)
        return path

    def _problem(self, transit_steps: int, leaving: bool) -> KomoProblem:
        retreat = APPROACH_STEPS if leaving else 0
        steps = (transit_steps, APPROACH_STEPS, len(self.poses) - 1, retreat)
        problem = KomoProblem(self.manipulation.model.chain, steps, self.collisions, _options(sum(steps)))
        feature = relative_pose(self.manipulation.tip, IDENTITY, IDENTITY)
        fractions = np.arange(APPROACH_STEPS + 1) / APPROACH_STEPS  # as in draw_back
        coming = [multiply(self.T_start, retreated(self.contact, f)) for f in fractions[::-1]]
        carrying = [multiply(T, self.contact.T_obj_ee) for T in self.poses[1:]]
        away = [multiply(self.T_end, retreated(self.contact, f)) for f in fractions[1 : retreat + 1]]
        first = problem.last(Phase.TRANSIT)
        targets = [*coming, *carrying, *away]
        params = [self.manipulation.target(T) for T in targets]
        problem.add(Objective(feature, ObjectiveType.EQ, range(first, first + len(targets)), params=params))
        return problem

    def _coming_as(self, before: np.ndarray, transit_steps: int) -> KomoProblem:
        """Coming to the keyframe through the configurations (APPROACH_STEPS, n) before it, the farthest last."""
        steps = (transit_steps, APPROACH_STEPS, 0, 0)
        problem = KomoProblem(self.manipulation.model.chain, steps, self.collisions, _options(sum(steps)))
        for step, q in enumerate([*before[::-1], self.keyframes[0]], problem.last(Phase.TRANSIT)):
            problem.add(Objective(joint_position(q), ObjectiveType.EQ, [step]))
        return problem

    def _parts(self, problem: KomoProblem, path: np.ndarray) -> list[np.ndarray]:
        """The coming (M0, n), carrying (M1, n) and leaving (M2, n) parts; each starts where the last ended."""
        contact, end = problem.last(Phase.APPROACH), problem.last(Phase.HOLD)
        coming = np.concatenate([self.start[None], path[: contact + 1]])
        return [coming, path[contact : end + 1], path[end:]]

    def _check(self, problem: KomoProblem, path: np.ndarray, cols: Collisions) -> str:
        """What is violated between the steps, or nothing."""
        names = "coming", CARRYING, "leaving"
        own = zip(names, self._parts(problem, path), strict=True)
        parts = {what: part for what, part in own if what == "coming" or len(part) > 1}
        cols = verification(cols)
        curves = {what: spline(part) for what, part in parts.items()}
        limits = self.scene.robots[self.robot].model.position_limits
        for what, curve in curves.items():
            samples = curve(np.linspace(0.0, curve.x[-1], LIMIT_SAMPLES * len(parts[what])))
            excess = np.maximum(limits[0] - samples, samples - limits[1]).max(axis=0)
            if excess.max() > 0.0:
                return f"joint {int(excess.argmax()) + 1} exceeds its limit by {excess.max():.2g} between steps"
        knots = curves["coming"].x
        turn = knots[-1 - APPROACH_STEPS] if len(knots) > APPROACH_STEPS else 0.0
        masks = {
            "coming": (bit(Phase.TRANSIT), turn, bit(Phase.APPROACH)),
            CARRYING: (bit(Phase.HOLD) | CARRIED,),
            "leaving": (bit(Phase.RETREAT),),
        }
        found = {what: _violation(self.manipulation, cols, curve, *masks[what]) for what, curve in curves.items()}
        return ", ".join(
            f"{what}, {' and '.join(problem.collisions.pair_name(pair))} are {v * 1e3:.1f} mm too close between steps"
            for what, (v, pair) in found.items()
            if pair >= 0
        )

    def come(self, rng: np.random.Generator, deadline: float, exact: bool = False) -> _ModeMotion:
        """The transit to the contact and the closing of the gripper alone; ``exact``: just as in the keyframe."""
        before = self._drawn_back(self.T_start, self.keyframes[0], Phase.APPROACH)
        make = partial(self._coming_as, before) if exact else partial(self._problem, leaving=False)
        _, path = self._searched(make, before, self.keyframes[:0], rng, deadline)
        return self._coming(np.concatenate([self.start[None], path]))

    def leave(self) -> _ModeMotion:
        """The letting go and the retreat alone, from where the robot is."""
        after = self._drawn_back(self.T_end, self.start, Phase.RETREAT)
        path = np.concatenate([self.start[None], after])
        cols = verification(self.collisions.arrays())
        too_close, pair = _violation(self.manipulation, cols, spline(path), bit(Phase.RETREAT))
        if pair >= 0:
            near = " and ".join(self.collisions.pair_name(pair))
            raise MotionError(
                f"robot '{self.robot}' lets '{self.object}' go: {near} are {too_close * 1e3:.1f} mm too close"
            )
        return self._leaving(path)

    def _openings(self) -> tuple[float, float]:
        """Of the gripper while coming and going, and in contact, m."""
        robot = self.scene.robots[self.robot]
        free = free_opening(robot, self.contact)
        return free, free if robot.model.attached else self.contact.opening

    def _coming(self, path: np.ndarray) -> _ModeMotion:
        free, held = self._openings()
        q = _timed_free(self.scene, self.robot, path)
        opened = self._ramp(self.state.gripper[self.robot], free)
        closed = self._ramp(free, held)
        coming = np.concatenate([np.repeat(q[:1], len(opened), 0), q, np.repeat(q[-1:], len(closed), 0)])
        return _ModeMotion(self.robot, coming, np.concatenate([opened, np.full(len(q), free), closed]))

    def _carrying(self, path: np.ndarray) -> _ModeMotion:
        """The object hangs on the hand as they meet at the start, which is the contact within what KOMO leaves open."""
        q = _timed(self.scene, self.robot, path, HOLD_SPEED, HOLD_ACCELERATION)
        T_ee = _end_effectors(self.scene, self.robot, q)
        T_obj_ee = multiply(inverse(self.T_start), T_ee[0])
        moved = {self.object: consistent(multiply_all(T_ee, inverse(T_obj_ee)))}
        opening = np.full(len(q), self._openings()[1])
        kind = SegmentKind(self.contact.kind.value)
        return _ModeMotion(self.robot, q, opening, kind, self.object, None, T_obj_ee, moved)

    def _leaving(self, path: np.ndarray) -> _ModeMotion:
        free, held = self._openings()
        q = _timed_free(self.scene, self.robot, path)
        released = self._ramp(held, free)
        leaving = np.concatenate([np.repeat(q[:1], len(released), 0), q])
        return _ModeMotion(self.robot, leaving, np.concatenate([released, np.full(len(q), free)]))

    def _ramp(self, a: float, b: float) -> np.ndarray:
        """Openings (N,) from a to b at the gripper's speed, then at rest while it settles; nothing where a is b."""
        if abs(a - b) < SAME_OPENING:
            return np.zeros(0)
        gripper = self.scene.robots[self.robot].model.gripper
        moving = int(np.ceil(abs(b - a) / gripper.speed / SAMPLE_PERIOD))
        return np.concatenate([np.linspace(a, b, moving + 1), np.full(int(SETTLE / SAMPLE_PERIOD), b)])


def _thinned(object_poses: np.ndarray, keyframes: np.ndarray, fineness: float) -> tuple[np.ndarray, np.ndarray]:
    """Every few of the dense poses (K, 7) and their configurations, about ``fineness`` HOLD_STEPs apart; ends are
    kept."""
    moved = np.linalg.norm(np.diff(object_poses[:, :3], axis=0), axis=1)
    chord = np.linalg.norm(np.diff(consistent(object_poses)[:, 3:], axis=0), axis=1)  # of half the turn
    turned = 4.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))
    size = np.concatenate([[0.0], np.cumsum(np.maximum(moved / HOLD_STEP[0], turned / HOLD_STEP[1]))])
    count = max(2, int(np.ceil(size[-1] / fineness)) + 1)
    keep = np.unique(np.searchsorted(size, np.linspace(0.0, size[-1], count) - 1e-9).clip(0, len(size) - 1))
    keep[-1] = len(size) - 1
    return object_poses[keep], keyframes[: len(object_poses)][keep]


def _assembled(scene: Scene, state: SceneState, pieces: list[_ModeMotion]) -> SubTrajectory:
    """One trajectory from the pieces; neighbouring pieces share a sample. What others hold they go on holding."""
    robots = list(dict.fromkeys(piece.robot for piece in pieces))
    bodies = list(dict.fromkeys(name for piece in pieces for name in piece.moved))
    q = {name: [state.q[name][None]] for name in robots}
    opening = {name: [np.array([state.gripper[name]])] for name in robots}
    poses = {name: [state.poses[name][None]] for name in bodies}
    segments: list[Segment] = []
    at = 0  # samples so far, less one
    for piece in pieces:
        new = len(piece.q) - 1
        if new == 0:
            continue
        for name in robots:
            own = name == piece.robot
            q[name].append(piece.q[1:] if own else np.repeat(q[name][-1][-1:], new, 0))
            opening[name].append(piece.opening[1:] if own else np.repeat(opening[name][-1][-1:], new))
        for name, rows in poses.items():
            rows.append(piece.moved[name][1:] if name in piece.moved else np.repeat(rows[-1][-1:], new, 0))
        start, end = at * SAMPLE_PERIOD, (at + new) * SAMPLE_PERIOD
        link = scene.robots[piece.robot].model.end_effector_link
        manipulator = piece.manipulator or link
        segments.append(Segment(start, end, piece.robot, manipulator, piece.object, piece.kind, piece.contact_pose))
        segments += [
            _holding_still(scene, name, start, end)
            for name, robot in scene.robots.items()
            if robot.model.attached is not None and name != piece.robot
        ]
        at += new
    return SubTrajectory(
        Trajectory(
            np.arange(at + 1) * SAMPLE_PERIOD,
            {name: np.concatenate(rows) for name, rows in q.items()},
            {name: np.concatenate(rows) for name, rows in opening.items()},
            {name: np.concatenate(rows) for name, rows in poses.items()},
        ),
        tuple(segments),
    )


def _holding_still(scene: Scene, robot: str, start: float, end: float) -> Segment:
    model = scene.robots[robot].model
    kind = SegmentKind.TOUCH if scene.mode == TaskMode.KINEMATIC else SegmentKind.GRASP
    return Segment(
        start, end, robot, model.end_effector_link, model.attached.name, kind, inverse(model.attached.T_ee_body)
    )
