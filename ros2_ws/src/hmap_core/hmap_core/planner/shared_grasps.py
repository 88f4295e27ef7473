"""Pairs of grasps by which two robots carry an object together, from its start to its goal."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from hmap_core.collision.convex import from_hulls, set_distance
from hmap_core.contacts.feasibility import carried, reachable, stretches
from hmap_core.contacts.shared_load import pairs_hold
from hmap_core.exceptions import MotionError
from hmap_core.kinematics.arm import load_arm
from hmap_core.planner.contact_checker import secure_grasps
from hmap_core.planner.interfaces import RobotContact
from hmap_core.planner.manipulation_graph.grasp_sets import GraspSet, grasp_sets
from hmap_core.planner.tools import TURN_LENGTH
from hmap_core.transforms import rotation_matrix
from hmap_core.types import ContactPoint, Scene, SceneState

HANDS_APART = 0.02  # m between the two hands
BALANCE = 0.2  # weight of an uneven load, against how far an arm is from where it follows best
SPREAD = 0.04  # m, or a turn that counts as much, in which one of two grasps differs from those tried before
LOOKED_AT = 2000  # pairs at most, the best first
COMFORT = 0.6  # of an arm's span, at which it follows best
BRANCHES = 5  # configurations in contact from which an arm is led along the path


@dataclass(frozen=True)
class GraspPair:
    """Two grasps on one object.

    Attributes:
        robots: the two robots.
        contacts: their grasps.
        share: of the weight that the first one carries.
    """

    robots: tuple[str, str]
    contacts: tuple[ContactPoint, ContactPoint]
    share: float


class SharedGrasps:
    """Finds pairs of grasps that serve at start and goal, by hands alone first, then by inverse kinematics.

    Args:
        scene, state: the world, and where everything is.
        object: name of the object.
        ends: its start and goal pose (7,), world frame.
        rng: the only source of randomness.
    """

    def __init__(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        ends: tuple[np.ndarray, np.ndarray],
        rng: np.random.Generator,
    ):
        self._scene, self._object, self._ends, self._rng = scene, object, ends, rng
        self._sets: dict[str, GraspSet] = {}
        for name, robot in scene.robots.items():
            alone = replace(scene, robots={name: robot})  # the other arm is not in its way: it moves along
            self._sets |= {own.robot: own for own in grasp_sets(alone, state, object, ends, rng, np.inf)}
        self._serving = {name: self._at_both(own) for name, own in self._sets.items()}
        self._configurations: dict[tuple[str, int], np.ndarray | None] = {}

    def _at_both(self, own: GraspSet) -> np.ndarray:
        """Indices of grasps that the hand can make at both ends, within the length of the arm."""
        if not own.contacts:
            return np.zeros(0, int)
        near = (stretches(own.manipulation, own.contacts, np.array(self._ends)) <= 1.0).all(axis=1)
        return np.flatnonzero(near & own.serves(self._ends[0]) & own.serves(self._ends[1]))

    def why_none(self) -> str:
        """Why the hands alone make no pair, in words."""
        counts = ", ".join(f"'{name}' has {len(own)}" for name, own in self._serving.items())
        return (
            f"no two grasps at start and goal share its weight within payload and grip force, with its centre of mass "
            f"between them; grasps within reach at both: {counts or 'no robot has a gripper'}"
        )

    def alone(self) -> bool:
        """Whether one of the robots has a grasp that serves at both ends without the help of another one."""
        for name, own in self._sets.items():
            contacts = [own.contacts[k] for k in self._serving[name]]
            for T in self._ends:
                contacts = secure_grasps(self._scene, self._object, name, contacts, T)
            if contacts:
                return True
        return False

    def promising(self) -> list[tuple[float, str, str, int, int, float]]:
        """Pairs by cost: (cost, robots, indices of their grasps, share of the first)."""
        body, found = self._scene.bodies[self._object], []
        for a, b in combinations(self._sets, 2):
            i, j = self._serving[a], self._serving[b]
            if not len(i) or not len(j):
                continue
            robots = self._scene.robots[a], self._scene.robots[b]
            contacts = [self._sets[a].contacts[k] for k in i], [self._sets[b].contacts[k] for k in j]
            holds, share = np.ones((len(i), len(j)), bool), np.zeros((len(i), len(j)))
            for T in self._ends:
                own, share = pairs_hold(body, robots, contacts, rotation_matrix(T)[2])
                holds &= own
            far = [self._stretch(name, own) for name, own in ((a, contacts[0]), (b, contacts[1]))]
            cost = np.maximum(far[0][:, None], far[1][None]) + BALANCE * np.abs(2.0 * share - 1.0)
            best = [(cost[k, m], a, b, int(i[k]), int(j[m]), float(share[k, m])) for k, m in np.argwhere(holds)]
            found += best
        return sorted(found)[:LOOKED_AT]

    def _stretch(self, name: str, contacts: list[ContactPoint]) -> np.ndarray:
        """How far (K,) an arm is from where it follows best, at the worse of both ends."""
        far = stretches(self._sets[name].manipulation, contacts, np.array(self._ends))
        return np.abs(far - COMFORT).max(axis=1)

    def pairs(self) -> Iterator[GraspPair]:
        """Yield pairs whose hands are apart and that both arms reach at both ends, the best first, unlike each other.

        Whether the arms are in each other's way is not checked.
        """
        tried: list[np.ndarray] = []
        for _, a, b, i, j, share in self.promising():
            contacts = self._sets[a].contacts[i], self._sets[b].contacts[j]
            place = np.concatenate([_features(contact) for contact in contacts])
            if any(np.linalg.norm(place - other) < SPREAD for other in tried):
                continue
            if not self._apart((a, b), contacts):
                continue
            if self._configuration(a, i) is None or self._configuration(b, j) is None:
                continue
            tried.append(place)
            yield GraspPair((a, b), contacts, share)

    def followed(self, pair: GraspPair, poses: np.ndarray) -> list[RobotContact]:
        """The contacts of a pair with configurations at all poses (M, 7) of the object.

        Raises:
            MotionError: an arm does not follow.
        """
        return [self._followed(*own, poses) for own in zip(pair.robots, pair.contacts, strict=True)]

    def _followed(self, name: str, contact: ContactPoint, poses: np.ndarray) -> RobotContact:
        """The contact of one robot, from the first of a few configurations in which the arm follows."""
        manipulation, last = self._sets[name].manipulation, np.arange(len(poses)) == len(poses) - 1
        for branch in range(BRANCHES):
            ok, q = reachable(manipulation, [contact], poses[0], self._rng, from_home=branch == 0)
            keyframes = carried(manipulation, contact, q[0], poses, last) if ok[0] else q[:0]
            if len(keyframes) == len(poses):
                return RobotContact(name, contact, len(poses) - 1, keyframes)
        raise MotionError(f"the arm of '{name}' does not follow the path of '{self._object}' with its grasp")

    def _apart(self, robots: tuple[str, str], contacts: tuple[ContactPoint, ContactPoint]) -> bool:
        """Whether the two hands are HANDS_APART from each other."""
        hands = [
            from_hulls(load_arm(self._scene.robots[name].model).hand(contact.opening))
            for name, contact in zip(robots, contacts, strict=True)
        ]
        apart = set_distance(hands[0], contacts[0].T_obj_ee, hands[1], contacts[1].T_obj_ee, HANDS_APART)
        return bool(apart >= HANDS_APART)

    def _configuration(self, robot: str, index: int) -> np.ndarray | None:
        """Where (n,) an arm makes a grasp at the start; None where it does not reach it at start and goal."""
        key = robot, index
        if key not in self._configurations:
            own, found = self._sets[robot], None
            ok, q = reachable(own.manipulation, [own.contacts[index]], self._ends[0], self._rng)
            if ok[0] and reachable(own.manipulation, [own.contacts[index]], self._ends[1], self._rng)[0][0]:
                found = q[0]
            self._configurations[key] = found
        return self._configurations[key]


def _features(contact: ContactPoint) -> np.ndarray:
    turn = rotation_matrix(contact.T_obj_ee)[:, 1:].T.ravel()
    return np.concatenate([contact.T_obj_ee[:3], TURN_LENGTH * turn])
