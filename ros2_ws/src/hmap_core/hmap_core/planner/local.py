"""The three phases of H-MaP in this process."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain

import numpy as np

from hmap_core.collision.convex import convex_set, set_distance
from hmap_core.contacts.access import accessible
from hmap_core.contacts.camera import Cloud, visible_points
from hmap_core.contacts.candidates import Situation
from hmap_core.contacts.feasibility import CHUNK, feasible_contacts, promising, reach_bounds, reachable
from hmap_core.contacts.grasp_torque import pad_balance, push_torque_ratio, weight_torque_ratio
from hmap_core.contacts.hand import align_pads, drop_unfit_grasps, hand_of
from hmap_core.contacts.proposer import NoProposer, Proposer
from hmap_core.contacts.sampler import sample_contacts
from hmap_core.contacts.solids import solids
from hmap_core.exceptions import Code, ContactError
from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.shapes import body_set, box_round
from hmap_core.planner import segments
from hmap_core.planner.interfaces import RobotContact, SubTrajectory, ToolGrasp
from hmap_core.planner.lifting import lifted
from hmap_core.planner.tools import attach_tool, spread, tools_of, within_reach
from hmap_core.transforms import IDENTITY, rotation_matrix
from hmap_core.types import Body, BodyKind, ContactPoint, Goal, Scene, SceneState, TaskMode
from hmap_core.waypoints import (
    DEFAULT_MIN_DISTANCE,
    NoObjectPath,
    ObjectPath,
    ObjectPathProblem,
    plan_waypoints,
    stable_poses,
)
from hmap_core.waypoints.checker import Geometry, ObjectChecker

SURFACE_POINTS = 600  # samples of the object's surface when looking at it
BATCH = 240  # candidates checked at once
MAX_CANDIDATES = 480  # per robot, before it is out of contacts
ENOUGH = 2  # feasible contacts per robot after which only better ones are looked for
STRETCH_WEIGHT = 0.7  # share of a contact's contact_score that is lost when the arm is stretched out
SCORE_WEIGHT = 0.1  # poses of the path that one point of a contact's score is contact_score
ACCESS = 0.002  # m of room before a place of the surface that an arm without fingers, or a tool, needs
LIFTED = 0.001  # m that a path has to rise for the object to be lifted
PAD_BALANCE = 0.5  # of a finger's pad on an object: the narrower side of its middle to the wider
PHYSICAL_MIN_DISTANCE = 0.01  # m round an object's path, where there is room: what is pushed strays
TURNING_SHARE = 0.7  # of the friction against turning in the hand that weight or pushing may use
BOTH_ENDS_TRIED = 48  # contacts for which an arm is asked at the start and at the goal
HOLDS_TRIED = 16  # holds on a tool for which an arm is asked
HOLDS = 8  # of them that are kept, per robot
HOLDS_FIRST = 3  # of these, that are asked how far they could serve; the others only where the tool and robot are among
HOLDS_SHARE = 0.5  # those that serve at least this share of the best
MIN_REACH = 2  # poses a contact has to serve, unless the path is shorter


def placed_bodies(scene: Scene, state: SceneState, without: str) -> tuple[Body, ...]:
    """All bodies but one, where they are now."""
    return tuple(replace(b, pose=state.poses[name]) for name, b in scene.bodies.items() if name != without)


def bases(scene: Scene, object: str, ends: Sequence[np.ndarray]) -> tuple[Body, ...]:
    """The robots' bases, past which an object goes from one of two ``ends`` (7,) to the other.

    A base is a box round each of its links, but for those in which the object would be at an end.
    """
    own, found = body_set(scene.bodies[object]), []
    for name, robot in scene.robots.items():
        T, hulls = robot.base_pose, [hull for hull in load_arm(robot.model).hulls if hull.frame == 0]
        boxes = [box_round(hull.vertices, hull.radius, IDENTITY) for hull in hulls]
        apart = tuple(b for b in boxes if all(set_distance(own, end, convex_set((b,)), T, 0.0) >= 0.0 for end in ends))
        if apart:
            found.append(Body(name, BodyKind.FIXED, apart, T))
    return tuple(found)


def _passes(problem: ObjectPathProblem, bodies: tuple[Body, ...], poses: np.ndarray) -> bool:
    """Whether a problem's body goes past others along poses (M, 7)."""
    alone = replace(problem, obstacles=bodies, removable=frozenset())
    checker = ObjectChecker(alone, Geometry(alone), False, 0.0)
    return all(checker.motion_free(a, b) for a, b in zip(poses[:-1], poses[1:], strict=True))


def away_from_home(scene: Scene, state: SceneState, robot: str) -> tuple[str, ...]:
    """The other robots that have to go home before one may work."""
    return tuple(n for n in scene.robots if n != robot and not np.allclose(state.q[n], scene.robots[n].model.home))


def least_reach(object_poses: np.ndarray) -> int:
    """Index of the pose, of object_poses (M, 7), that a contact has to reach at least."""
    return min(MIN_REACH, len(object_poses) - 1)


class LocalBackend:
    """Implements :class:`hmap_core.planner.interfaces.Backend` by direct calls.

    Args:
        proposer: of contacts that are looked at before sampled ones.
        enough: feasible contacts per robot after which only better ones are looked for.
    """

    def __init__(self, proposer: Proposer | None = None, enough: int = ENOUGH):
        self.proposer, self.enough = proposer or NoProposer(), enough
        self._stands: tuple[tuple, np.ndarray] = ((), np.zeros(0, bool))  # the last answer: all robots ask the same

    def plan_waypoints(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        goal: Goal,
        seed: int,
        time_limit: float,
        checks: float = np.inf,
    ) -> ObjectPath:
        """Algorithm 2; anew, round the robots' bases, where the path leads through one."""
        problem = ObjectPathProblem(
            scene.bodies[object],
            state.poses[object],
            goal.pose,
            placed_bodies(scene, state, object),
            scene.motion,
            DEFAULT_MIN_DISTANCE if scene.mode == TaskMode.KINEMATIC else PHYSICAL_MIN_DISTANCE,
            removable=frozenset(scene.removable),
        )
        rng = np.random.default_rng(seed)
        path = plan_waypoints(problem, rng, time_limit, checks)
        around = bases(scene, object, (problem.start, problem.goal))
        if not around or _passes(problem, around, path.poses):
            return path
        problem = replace(problem, obstacles=(*problem.obstacles, *around))
        try:
            return plan_waypoints(problem, rng, time_limit, checks)
        except NoObjectPath:  # boxes are larger than what is in them
            return path

    def propose_contacts(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        object_poses: np.ndarray,
        robots: Sequence[str] = (),
        cloud: Cloud | None = None,
        count: int = 0,
        seed: int = 0,
        time_limit: float = np.inf,
    ) -> list[RobotContact]:
        """Algorithm 3: feasible contacts, the one that carries the object farthest first.

        Robots are asked in the order given, until one can carry the object all the way; each only for contacts that
        carry it farther than those of the robots before.
        """
        deadline = time.monotonic() + time_limit
        rng = np.random.default_rng(seed)
        informed = self.proposer.propose(state, scene, object, object_poses)
        seen = self._seen(scene, state, object, object_poses[0], rng)
        found: list[RobotContact] = []
        looked_at = 0
        for name in robots or scene.robots:
            beyond = max((contact.reach for contact in found), default=-1)
            if beyond == len(object_poses) - 1:
                break
            sampled = self.candidates(scene, state, object, object_poses, name, rng, cloud, seen)
            for batch in chain([informed] if informed else [], sampled):
                looked_at += len(batch)
                own = self.check_contacts(scene, state, object, object_poses, name, batch, rng, beyond)
                found += own
                if own or time.monotonic() > deadline:
                    break
        if not found:
            raise ContactError(
                f"none of {looked_at} contacts on '{object}' is reachable for {', '.join(robots or scene.robots)}",
                Code.NO_CONTACT,
            )
        found.sort(key=lambda c: -contact_score(scene, c))
        return found[: count or None]

    def check_contacts(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        object_poses: np.ndarray,
        robot: str,
        contacts: Sequence[ContactPoint],
        rng: np.random.Generator,
        beyond: int = -1,
    ) -> list[RobotContact]:
        """The feasible ones of one robot's candidates, with how far they serve; :meth:`propose_contacts` ranks them.

        Those that serve no farther than pose ``beyond`` are left out. The other robots are thought of at home; where
        they are not, they have to go there first (``clear``).
        """
        contacts = self._holding(scene, object, object_poses, robot, contacts)
        if not contacts:
            return []
        manipulation, away = self._cleared(scene, state, object, robot)
        release, least = self._release(scene, state, object, object_poses), max(least_reach(object_poses), beyond + 1)
        return [
            RobotContact(robot, contacts[f.index], len(f.keyframes) - 1, f.keyframes, away)
            for f in feasible_contacts(manipulation, contacts, object_poses, release, rng, least, self.enough)
        ]

    def contacts_at_both_ends(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        T_goal: np.ndarray,
        robot: str,
        count: int,
        seed: int,
    ) -> list[ContactPoint]:
        """At most ``count`` contacts that a robot can make where the object stands, and leave with it at T_goal (7,).

        Whether the hand gets from one to the other is not asked. They are spread over the object; none pushes it.
        """
        rng = np.random.default_rng(seed)
        ends = np.array([state.poses[object], T_goal])
        manipulation, _ = self._cleared(scene, state, object, robot)
        release = self._release(scene, state, object, ends)
        for batch in self.candidates(scene, state, object, ends[:1], robot, rng):  # standing, it is not pushed
            carrying = self._gripped(scene, object, robot, batch, ends[0])
            if not carrying:
                continue
            order, _ = promising(manipulation, carrying, ends, release, 1)
            candidates = [carrying[k] for k in order]
            candidates = [candidates[k] for k in spread(candidates, BOTH_ENDS_TRIED)]
            found: list[ContactPoint] = []
            for first in range(0, len(candidates), CHUNK):
                found += _reachable_everywhere(manipulation, candidates[first : first + CHUNK], ends, rng)
                if len(found) >= count:
                    break
            if found:
                return found[:count]
        return []

    def promising_contacts(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        object_poses: np.ndarray,
        robot: str,
        contacts: Sequence[ContactPoint],
        beyond: int = -1,
    ) -> list[ContactPoint]:
        """The candidates that :meth:`check_contacts` would ask the arm for, in that order: a cheap first choice."""
        contacts = self._holding(scene, object, object_poses, robot, contacts)
        if not contacts:
            return []
        manipulation, _ = self._cleared(scene, state, object, robot)
        release = self._release(scene, state, object, object_poses)
        least = max(least_reach(object_poses), beyond + 1)
        order, _ = promising(manipulation, contacts, object_poses, release, least)
        return [contacts[k] for k in order]

    def _holding(self, scene: Scene, object: str, object_poses, robot: str, contacts) -> list[ContactPoint]:
        """The contacts that hold an object along its poses (M, 7), on which it may be lifted."""
        if np.max(object_poses[:, 2]) <= object_poses[0, 2] + LIFTED or not contacts:
            return list(contacts)
        return self._gripped(scene, object, robot, contacts, object_poses[0])

    def _release(self, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray) -> np.ndarray:
        """At which of its poses (M, 7) an object may be let go (M,)."""
        return self._standing(scene.bodies[object], object_poses, placed_bodies(scene, state, object))

    def solve_segment(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        contact: RobotContact,
        object_poses: np.ndarray,
        seed: int = 0,
        time_limit: float = np.inf,
    ) -> SubTrajectory:
        """KOMO over the phases of one segment; an object that would tip when it is dragged is lifted."""
        if scene.mode == TaskMode.PHYSICAL and not (scene.motion == "planar" and object == scene.goal.object):
            around = placed_bodies(scene, state, object)
            contact, object_poses = lifted(scene, state, object, contact, object_poses, around, TURNING_SHARE)
        rng = np.random.default_rng(seed)
        return segments.solve_segment(scene, state, object, contact, object_poses, rng, time_limit)

    def tool_grasps(
        self, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray, seed: int, time_limit: float
    ) -> list[tuple[ToolGrasp, int]]:
        """Holds on tools with which the object may be moved along object_poses (M, 7), the farthest-reaching first.

        Each comes with the pose up to which hand, tool and object could go at best; the arm was asked only whether it
        can take the tool. Of those that reach as far, the one with the most contacts that do is first: it leaves the
        most room.
        """
        deadline = time.monotonic() + time_limit
        rng = np.random.default_rng(seed)
        least = least_reach(object_poses)
        found: list[tuple[ToolGrasp, int, int]] = []
        pairs = [
            (tool, robot)
            for tool in tools_of(scene, object)
            for robot in scene.robots
            if within_reach(scene, state, robot, tool, object)
        ]
        holds = [
            [ToolGrasp(tool, contact, state.poses[tool]) for contact in self._holds(scene, state, tool, robot, rng)]
            for tool, robot in pairs
        ]

        def bounded(grips: Sequence[ToolGrasp]) -> int:
            best = -1
            for grip in grips:
                bound, count = self._bound(attach_tool(scene, grip), state, object, object_poses, grip.robot, rng)
                best = max(best, bound)
                if bound >= least:
                    found.append((grip, bound, count))
                if time.monotonic() > deadline:
                    break
            return best

        first = [bounded(grips[:HOLDS_FIRST]) for grips in holds]
        far = HOLDS_SHARE * max(first, default=0) if found else -1.0
        for grips, best in zip(holds, first, strict=True):
            if best >= far:
                bounded(grips[HOLDS_FIRST:])
        return [(grip, bound) for grip, bound, _ in sorted(found, key=lambda entry: (-entry[1], -entry[2]))]

    def _holds(self, scene: Scene, state: SceneState, tool: str, robot: str, rng) -> list[RobotContact]:
        """Ways in which a robot can take a tool where it stands, spread over it."""
        T_tool = state.poses[tool]
        manipulation, away = self._cleared(scene, state, tool, robot)
        contacts = next(self.candidates(scene, state, tool, T_tool[None], robot, rng), [])
        if not contacts:
            return []
        contacts = self._gripped(scene, tool, robot, contacts, T_tool)
        contacts = [contacts[k] for k in np.flatnonzero(reach_bounds(manipulation, contacts, T_tool[None]) >= 0)]
        contacts = [contacts[k] for k in spread(contacts, HOLDS_TRIED)]
        if not contacts:
            return []
        ok, q = reachable(manipulation, contacts, T_tool, rng)
        return [RobotContact(robot, contacts[k], 0, q[k][None], away) for k in np.flatnonzero(ok)][:HOLDS]

    def _gripped(self, scene: Scene, body: str, robot: str, contacts, T_body: np.ndarray) -> list[ContactPoint]:
        """The contacts that hold a body when it is lifted from T_body (7,)."""
        gripper = scene.robots[robot].model.gripper
        if gripper is None or scene.mode == TaskMode.KINEMATIC:
            return list(contacts)
        share = weight_torque_ratio(scene.bodies[body], contacts, gripper, rotation_matrix(T_body)[2])
        return [c for c, used in zip(contacts, share, strict=True) if used <= TURNING_SHARE]

    def _bound(self, scene: Scene, state: SceneState, object: str, object_poses, robot: str, rng) -> tuple[int, int]:
        """The farthest pose to which hand and object alone could go, with how many contacts; -1: they cannot meet."""
        contacts = next(self.candidates(scene, state, object, object_poses, robot, rng), [])
        if not contacts:
            return -1, 0
        manipulation, _ = self._cleared(scene, state, object, robot)
        bounds = reach_bounds(manipulation, contacts, object_poses)
        return int(bounds.max()), int((bounds == bounds.max()).sum())

    def _cleared(self, scene: Scene, state: SceneState, object: str, robot: str) -> tuple[Manipulation, tuple]:
        """A robot about to handle an object with the others at home, and those that have to go there first."""
        away = away_from_home(scene, state, robot)
        cleared = state.copy()
        for name in away:
            cleared.q[name] = scene.robots[name].model.home.copy()
        return Manipulation(scene, cleared, robot, object), away

    def pick_tool(
        self, scene: Scene, state: SceneState, grip: ToolGrasp, seed: int, time_limit: float
    ) -> SubTrajectory:
        """The motion in which a robot takes a tool. Raises MotionError."""
        rng = np.random.default_rng(seed)
        return segments.pick(scene, state, grip.contact, grip.tool, rng, time_limit)

    def place_tool(
        self, scene: Scene, state: SceneState, grip: ToolGrasp, seed: int, time_limit: float
    ) -> SubTrajectory:
        """The motion in which a robot puts a tool back where it took it. Raises MotionError."""
        rng = np.random.default_rng(seed)
        return segments.place(scene, state, grip.contact, grip.tool, grip.T_place, rng, time_limit)

    def _standing(self, body: Body, poses: np.ndarray, obstacles: Sequence[Body]) -> np.ndarray:
        """Where on its way (M, 7) a body stands by itself, (M,)."""
        key = id(body_set(body)), poses.tobytes(), *((id(body_set(b)), b.pose.tobytes()) for b in obstacles)
        if key != self._stands[0]:
            self._stands = key, stable_poses(body, poses, obstacles)
        return self._stands[1]

    def _seen(self, scene: Scene, state: SceneState, object: str, T: np.ndarray, rng) -> Cloud:
        """Points on the surface of an object at T (7,), with which of them the cameras see."""
        around, cameras = _others(scene, state, object), scene.cameras.values()
        return visible_points(scene.bodies[object], T, around, cameras, rng, SURFACE_POINTS, include_unseen=True)

    def candidates(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        object_poses: np.ndarray,
        robot: str,
        rng: np.random.Generator,
        cloud: Cloud | None = None,
        seen: Cloud | None = None,
    ) -> Iterator[list[ContactPoint]]:
        """Batches of contacts on an object for the way along object_poses (M, 7), of which nothing was asked yet.

        First from a measured ``cloud``, then from what the cameras see (``seen``, if that is known already), then from
        the rest of its surface.
        """
        body, placed = scene.bodies[object], scene.robots[robot]
        seen = self._seen(scene, state, object, object_poses[0], rng) if seen is None else seen
        around = solids([(shape, T) for other, T in _others(scene, state, object) for shape in other.shapes])
        hand = hand_of(placed)
        room = ACCESS if hand.gripper is None else hand.gripper.pad_half_width
        seen = seen[accessible(seen, object_poses[0], around, room)]
        ahead = object_poses[1] if len(object_poses) > 1 else None
        situation = Situation(object_poses[0], ahead, placed.base_pose[:3])
        total = 0
        for points in (cloud, seen[seen.seen], seen[~seen.seen]):
            if points is None or not len(points):
                continue
            for batch in sample_contacts(body, points, hand, scene.mode, situation, rng, BATCH):
                total += len(batch)
                if hand.attached is not None and scene.mode == TaskMode.PHYSICAL:
                    share = push_torque_ratio(hand.attached, placed.model.gripper, body, batch)
                    batch = [c for c, used in zip(batch, share, strict=True) if used <= TURNING_SHARE]
                elif hand.gripper is not None:
                    even = pad_balance(body, batch, hand.gripper)
                    batch = [c for c, share in zip(batch, even, strict=True) if share >= PAD_BALANCE]
                    batch = drop_unfit_grasps(body, align_pads(batch, hand.gripper), placed)
                yield batch
                if total >= MAX_CANDIDATES:
                    break


def _others(scene: Scene, state: SceneState, object: str) -> list[tuple[Body, np.ndarray]]:
    return [(body, state.poses[name]) for name, body in scene.bodies.items() if name != object]


def _reachable_everywhere(manipulation: Manipulation, contacts: list[ContactPoint], object_poses: np.ndarray, rng):
    """Those of the contacts that the arm can come to with the object at each of object_poses (M, 7)."""
    for T in object_poses:
        if contacts:
            ok, _ = reachable(manipulation, contacts, T, rng)
            contacts = [contact for contact, good in zip(contacts, ok, strict=True) if good]
    return contacts


def contact_score(scene: Scene, contact: RobotContact) -> float:
    """What contacts are ranked by: how far they carry, less where the arm has to stretch for it."""
    robot = scene.robots[contact.robot]
    arm = load_arm(robot.model)
    frames = [arm.frames(q) for q in contact.keyframes[[0, -1]]]
    tips = [p[-1] + R[-1] @ arm.T_tip_ee[:3, 3] for R, p in frames]
    stretch = max(float(np.linalg.norm(tip - arm.p_joint[0])) for tip in tips) / arm.length
    return (contact.reach + SCORE_WEIGHT * contact.contact.score) * (1.0 - STRETCH_WEIGHT * stretch**2)
