"""How arms with fewer than six joints tilt an object: grasps with placements on two of its faces that suit the arm.

Such an arm turns its hand about some axes only, and about which depends on where the hand is. A grasp that serves at
one placement serves at another one only where the turn between the two is one that the arm can make. So placements are
not sampled here: inverse kinematics asks that the grasped object stands on a face at a point, and how it is turned
about the vertical comes out of it.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from hmap_core.collision.scene_model import CollisionModel
from hmap_core.contacts.feasibility import reachable
from hmap_core.kinematics.arm import Arm
from hmap_core.komo.features import axis_alignment, relative_position
from hmap_core.komo.ik import solve_ik_batch
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.options import IK_OPTIONS
from hmap_core.komo.shapes import body_set
from hmap_core.komo.transcription import KomoProblem
from hmap_core.planner.diagnosis import overlapped
from hmap_core.planner.manipulation_graph.grasp_sets import GraspSet, free_at, grasp_sets
from hmap_core.planner.manipulation_graph.placements import intermediate_placements
from hmap_core.planner.obstruction import LIFT
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.planner.tools import farthest_points
from hmap_core.transforms import inverse, multiply, rotation_matrix
from hmap_core.types import ContactPoint, Scene, SceneState
from hmap_core.waypoints import stable_poses
from hmap_core.waypoints.support import feet

START, GOAL = 0, 1  # numbers of these sides
SAME_FACE = float(np.cos(np.deg2rad(1.0)))  # cosine of the angle between verticals up to which faces count as one
GRASPS = 24  # for which placements on two faces are searched
AT_ONCE = 6  # of these, whose inverse kinematics is solved together
PLACES = 3  # on a face, at which it is looked whether hands fit
POINTS = 4  # at which the object may stand on a face
STARTS = 3  # random configurations, beside home, from which inverse kinematics begins
RANK = 1e-6  # singular values below this share of the largest count as zero


@dataclass(frozen=True)
class TiltingGrasp:
    """A grasp that tilts an object.

    Attributes:
        robot: its name.
        contact: the grasp.
        T_from, T_to: (7,) where it picks the object, and where it places it, world frame.
    """

    robot: str
    contact: ContactPoint
    T_from: np.ndarray
    T_to: np.ndarray


@dataclass
class Side:
    """One way in which the object stands.

    Attributes:
        up: (3,) the vertical, object frame.
        points: (M, 3) where its origin may be, world frame.
        poses: (7,) that are stable and free, with about that vertical.
    """

    up: np.ndarray
    points: np.ndarray
    poses: list[np.ndarray] = field(default_factory=list)


class Tilting:
    """Finds such grasps for one object.

    Args:
        scene, state: the world without what may be removed, and where everything is.
        object: name of the object.
        T_goal: (7,) its goal pose, world frame.
        rng: the only source of randomness.
        check_time: called again and again; raises to end the search.

    Attributes:
        sides: how the object stands at the start, at the goal, and on its other faces.
    """

    def __init__(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        T_goal: np.ndarray,
        rng: np.random.Generator,
        check_time: Callable[[], object],
    ):
        self._scene, self._state, self._object, self._rng, self._check_time = scene, state, object, rng, check_time
        ends = state.poses[object], T_goal
        self.sides = self._sides(ends)
        self._sets = grasp_sets(scene, state, object, ends, rng)
        self._around = placed_bodies(scene, state, object)
        self._known: dict[tuple[int, int], list[TiltingGrasp]] = {}

    def chains(self) -> Iterator[tuple[int, ...]]:
        """Numbers of sides from the start to the goal: at once, then over each other face."""
        yield START, GOAL
        yield from ((START, k, GOAL) for k in range(GOAL + 1, len(self.sides)))

    def grasps(self, a: int, b: int) -> list[TiltingGrasp]:
        """Grasps that tilt the object from one side, by number, to another one; found once."""
        if (a, b) not in self._known:
            self._known[a, b] = [grasp for own in self._sets for grasp in self._of(own, self.sides[a], self.sides[b])]
        return self._known[a, b]

    def reaches(self, k: int) -> bool:
        """Whether some arm alone reaches the object on a side at its first point, however it is turned there."""
        side = self.sides[k]
        for own in self._sets:
            contacts = [own.contacts[i] for i in farthest_points(own.contacts, GRASPS)]
            if len(_StandingSolver(own.manipulation, self._rng).poses(contacts, side.up, side.points[:1])[0]):
                return True
        return False

    def counts(self) -> dict[str, tuple[int, int, int, int]]:
        """Of each robot: its grasps, those free for the hand with the tilt of the start, of the goal, and with both."""
        found = {}
        for own in self._sets:
            free = [self._free(own, side) for side in self.sides[:2]]
            found[own.robot] = len(own.contacts), int(free[0].sum()), int(free[1].sum()), int((free[0] & free[1]).sum())
        return found

    def _sides(self, ends: tuple[np.ndarray, np.ndarray]) -> list[Side]:
        shapes = body_set(self._scene.bodies[self._object])
        sides = [Side(rotation_matrix(T)[2], T[None, :3], [T]) for T in ends]
        exact = [feet(shapes, rotation_matrix(T))[1] for T in ends]
        for placement in intermediate_placements(self._scene, self._state, self._object, ends[1], self._rng):
            if placement.over_edge:
                continue
            same = [side for side in sides if side.up @ placement.up >= SAME_FACE]
            if not same:
                same = [Side(placement.up, np.zeros((0, 3)))]
                sides += same
            for side in same:
                point = placement.pose[:3].copy()
                if any(side is end for end in sides[:2]):  # it may lean a little there
                    lowest = exact[0 if side is sides[0] else 1]
                    point[2] += feet(shapes, rotation_matrix(placement.pose))[1] - lowest
                side.poses.append(placement.pose)
                side.points = np.concatenate([side.points, point[None]])
        return sides

    def _free(self, own: GraspSet, side: Side) -> np.ndarray:
        """Which of its grasps (K,) a hand could make somewhere on a side."""
        poses = side.poses[:PLACES]
        return np.logical_or.reduce([free_at(own.manipulation, own.contacts, T, own.turning) for T in poses])

    def _of(self, own: GraspSet, a: Side, b: Side) -> list[TiltingGrasp]:
        """Up to AT_ONCE grasps of one robot from side a to side b."""
        both = self._free(own, a) & self._free(own, b)
        chosen = [own.contacts[k] for k in self._rng.permutation(np.flatnonzero(both))]
        chosen = [chosen[k] for k in farthest_points(chosen, GRASPS)]
        solver = _StandingSolver(own.manipulation, self._rng)
        for first in range(0, len(chosen), AT_ONCE):
            self._check_time()
            contacts = chosen[first : first + AT_ONCE]
            T_from = self._placed(own, solver, contacts, a)
            contacts = [contact for contact, T in zip(contacts, T_from, strict=True) if T is not None]
            T_to = self._placed(own, solver, contacts, b)
            kept = [T for T in T_from if T is not None]
            found = [
                TiltingGrasp(own.robot, contact, T, other)
                for contact, T, other in zip(contacts, kept, T_to, strict=True)
                if other is not None
            ]
            if found:
                return found
        return []

    def _placed(
        self, own: GraspSet, solver: "_StandingSolver", contacts: Sequence[ContactPoint], side: Side
    ) -> list[np.ndarray | None]:
        """For each grasp a pose (7,) on a side with which the arm reaches it, free and stable, or None."""
        found: list[np.ndarray | None] = [None] * len(contacts)
        points = side.points[: POINTS + 1]
        index, T_obj = solver.poses(contacts, side.up, points)
        if not len(index):
            return found
        body = self._scene.bodies[self._object]
        stands = stable_poses(body, np.vstack([T_obj[0] + LIFT, T_obj]), self._around)[1:]
        for k, T in zip(index[stands].tolist(), T_obj[stands], strict=True):
            self._check_time()
            if found[k] is not None or overlapped(self._scene, self._state, self._object, T):
                continue
            contact = contacts[k]
            fits = free_at(own.manipulation, [contact], T, own.turning)[0]
            if fits and reachable(own.manipulation, [contact], T, self._rng)[0][0]:
                found[k] = T
        return found


class _StandingSolver:
    """Inverse kinematics of a grasped object that stands on a face at a point, turned in any way."""

    def __init__(self, manipulation: Manipulation, rng: np.random.Generator):
        self._manipulation, self._rng = manipulation, rng
        self._chain = manipulation.model.chain
        self._home = manipulation.scene.robots[manipulation.robot].model.home
        self._problem = KomoProblem(self._chain, (1,), CollisionModel(), IK_OPTIONS)
        for feature in (
            relative_position(manipulation.tip),
            axis_alignment(manipulation.tip, np.zeros(3), np.zeros(3)),
        ):
            self._problem.add(Objective(feature, ObjectiveType.EQ, (0,)))

    def poses(
        self, contacts: Sequence[ContactPoint], up: np.ndarray, points: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Poses of the object with its direction ``up`` (3,) vertical and its origin at one of some points (M, 3).

        Returns:
            The number of the grasp (K,) with which the arm reaches each pose, and the poses (K, 7).
        """
        if not len(contacts) or not len(points):
            return np.zeros(0, int), np.zeros((0, 7))
        T_tip_obj = [multiply(self._manipulation.T_tip_ee, inverse(contact.T_obj_ee)) for contact in contacts]
        axes = [rotation_matrix(T) @ up for T in T_tip_obj]
        vertical = np.array([0.0, 0.0, 1.0])
        params = np.array(
            [
                np.concatenate([T[:3], point, axis, vertical])
                for T, axis in zip(T_tip_obj, axes, strict=True)
                for point in points
            ]
        )
        index = np.repeat(np.arange(len(contacts)), len(points))
        random = self._rng.uniform(self._chain.lower, self._chain.upper, (STARTS, len(self._home)))
        numbers, found = [], []
        for start in (self._home, *random):
            initial = np.tile(start, (len(params), 1))
            q, solved = solve_ik_batch(self._problem, params, initial, initial)
            numbers.append(index[solved])
            found.append(q[solved])
        k, q = np.concatenate(numbers), np.concatenate(found)
        T_world_ee = self._manipulation.workspace.end_effectors(self._manipulation.robot, q)
        T_ee_obj = np.array([inverse(contacts[i].T_obj_ee) for i in k]).reshape(-1, 7)
        T_obj = np.array([multiply(T, other) for T, other in zip(T_world_ee, T_ee_obj, strict=True)]).reshape(-1, 7)
        return k, T_obj


def missing_turns(arm: Arm, q: np.ndarray) -> np.ndarray:
    """The directions (k, 3) about which a hand does not turn with its point where it is at q (n,), base frame."""
    _, sizes, rows = np.linalg.svd(arm.tip_jacobian(q))
    still = rows[int((sizes > RANK * sizes[0]).sum()) :]
    axes, sizes, _ = np.linalg.svd(arm.jacobian(q)[3:] @ still.T)
    return axes[:, int((sizes > RANK).sum()) :].T
