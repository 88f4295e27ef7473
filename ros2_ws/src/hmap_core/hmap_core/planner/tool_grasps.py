"""Which tool a robot should pick to move an object, and where it should grasp it."""

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from hmap_core.contacts.feasibility import reach_bounds, reachable
from hmap_core.planner.contact_checker import cleared, least_reach, secure_grasps
from hmap_core.planner.interfaces import RobotContact, ToolGrasp
from hmap_core.planner.protocols import ContactProposals, ContactProposer, ContactQuery, ManipulatorRanker
from hmap_core.planner.robot_order import UNLIKELY
from hmap_core.planner.tools import attach_tool, farthest_points, tools_of, within_reach
from hmap_core.transforms import rotation_matrices, rotation_matrix
from hmap_core.types import ContactPoint, Scene, SceneState

TRIED = 16  # grasps on a tool for which inverse kinematics is solved
KEPT = 8  # of them, per robot
RANKED_FIRST = 3  # of these; the others are ranked only if the best of the first is good
LOOKED_AT = 2  # of the best that a ranker names; one if it serves as far as expected
CERTAIN = 0.5  # probability times share of the path, from which on no contact is generated to compare grasps
ALIKE = (
    0.8  # of the best expectation of a ranker, from which on what it expects of grasps tells little about which is best
)
FROM_ABOVE = float(np.cos(np.deg2rad(45.0)))  # cosine between the hand's approach and the vertical
TURN_STEP = float(np.deg2rad(45.0))  # rad; travels that differ by less count alike
SHARE_OF_BEST = 0.5  # reach, as a share of the best, from which on a tool and robot count as good


class _Bound(NamedTuple):
    """How far a tool may serve in a grasp.

    Attributes:
        reach: index of the farthest pose to which hand, tool and object may go; -1: they cannot meet.
        travel: how far the arm turns to where it picks the tool, and the hand from there to the nearest such contact,
            in steps of TURN_STEP.
        contacts: how many of these there are.
    """

    reach: int = -1
    travel: int = 0
    contacts: int = 0


def _by_reach(entry: tuple[ToolGrasp, _Bound]) -> tuple[int, bool, int, int]:
    """Sorts grasps by how far they serve, then from above, then by how little arm and tool are turned, then by with how
    many contacts, the best first."""
    grasp, bound = entry
    return -bound.reach, not _from_above(grasp.contact.contact, grasp.T_place), bound.travel, -bound.contacts


def _from_above(contact: ContactPoint, T_tool: np.ndarray) -> bool:
    """Whether a hand comes rather from above to a tool at T_tool (7,); its last joint turns the tool alone then."""
    toward = rotation_matrix(T_tool) @ rotation_matrix(contact.T_obj_ee) @ contact.approach
    return bool(toward[2] < -FROM_ABOVE)


def _travel(grasp: ToolGrasp, contacts: Sequence[ContactPoint], state: SceneState, T_object: np.ndarray) -> int:
    """How far an arm turns to pick a tool, by its farthest joint, and then to the nearest of some contacts.

    Args:
        grasp: on the tool.
        contacts: of the tool on an object.
        state: where the arm is.
        T_object: (7,) pose of the object.

    Returns:
        Steps of TURN_STEP.
    """
    picked = rotation_matrix(grasp.T_place) @ rotation_matrix(grasp.contact.contact.T_obj_ee)
    hands = rotation_matrix(T_object) @ rotation_matrices(np.array([contact.T_obj_ee for contact in contacts]))
    cosine = 0.5 * (np.einsum("ij,nij->n", picked, hands) - 1.0)
    turn = float(np.arccos(np.clip(cosine, -1.0, 1.0)).min())
    return round((turn + _swing(grasp, state)) / TURN_STEP)


def _swing(grasp: ToolGrasp, state: SceneState) -> float:
    """How far an arm turns to pick a tool, by its farthest joint, rad."""
    return float(np.abs(grasp.contact.keyframes[0] - state.q[grasp.robot]).max())


class ToolGraspFinder(Protocol):
    """Finds grasps on tools."""

    def tool_grasps(
        self, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray, seed: int, time_limit: float,
        likely: float = 0.0,
    ) -> list[tuple[ToolGrasp, int]]:  # fmt: skip
        """Return grasps on tools, the best first, each with the index of the pose to which it may serve at best.

        A ranker's grasps may be left out if none is expected to serve with the probability ``likely``, or the best of
        them do not serve.
        """
        ...


class ToolGraspSearch:
    """Implements :class:`ToolGraspFinder` from geometry: hand, tool and object are one rigid body.

    Args:
        proposer: proposes grasps on tools, and contacts of tools on the object.
        ranker: estimates how far each grasp serves; only the best of them are looked at then. None: all are.
    """

    def __init__(self, proposer: ContactProposer, ranker: ManipulatorRanker | None = None):
        self._proposer, self._ranker = proposer, ranker

    def tool_grasps(
        self, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray, seed: int, time_limit: float,
        likely: float = 0.0,
    ) -> list[tuple[ToolGrasp, int]]:  # fmt: skip
        """Return grasps on tools with which the object may be moved, the farthest-reaching first.

        Inverse kinematics is solved only for picking the tool. Of grasps that reach equally far, the one with the most
        contacts that do so comes first: it leaves the most room. If none of the contacts with the best score serves
        for any grasp, all contacts are looked at: in narrow places few of thousands are free. The order of a ranker
        does not count where it expects little of all grasps, below UNLIKELY.

        Args:
            scene, state: the world, and where everything is.
            object: name of the object.
            object_poses: (M, 7) poses of the object from the present one on, world frame.
            seed: the only source of randomness.
            time_limit: seconds of wall-clock time.
            likely: where no grasp serves more than a few poses with this probability, by the ranker, there are none.
                Nor are there if the best by the ranker do not serve: not all are looked at then. 0: all may be.

        Returns:
            Pairs of a grasp and the index of the farthest pose to which hand, tool and object may go.
        """
        deadline = time.monotonic() + time_limit
        rng = np.random.default_rng(seed)
        least = least_reach(object_poses)
        ranked: list[tuple[ToolGrasp, _Bound]] = []
        pairs = [
            (tool, robot)
            for tool in tools_of(scene, object)
            for robot in scene.robots
            if within_reach(scene, state, robot, tool, object)
        ]
        grasps = [
            [ToolGrasp(tool, contact, state.poses[tool]) for contact in self.holds(scene, state, tool, robot, rng)]
            for tool, robot in pairs
        ]

        def rank(some: Sequence[ToolGrasp], every: bool = False) -> int:
            best = -1
            for grasp in some:
                attached = attach_tool(scene, grasp)
                bound = self._bound(attached, state, object, object_poses, grasp, rng, every)
                best = max(best, bound.reach)
                if bound.reach >= least:
                    ranked.append((grasp, bound))
                if time.monotonic() > deadline:
                    break
            return best

        rest = grasps
        if self._ranker is not None:
            every = [grasp for some in grasps for grasp in some]
            ordered, expected, p = self._best(scene, state, object, object_poses, every)
            if p.max(initial=0.0) < likely:
                return []
            if ordered and expected[0] >= CERTAIN:
                return [(grasp, least) for grasp in ordered]
            probable = {id(grasp) for grasp, each in zip(ordered, p, strict=True) if each >= UNLIKELY}
            # where none is probable, the order says little: tools may be of a kind that the ranker does not know
            for grasp, share in zip(ordered[:LOOKED_AT] if probable else [], expected, strict=False):
                if rank([grasp]) >= share * (len(object_poses) - 1):
                    break  # as far as expected: the others are expected to serve less
            if likely and not ranked:
                return []  # the ranker was wrong: hands come first, as without it, before all grasps are looked at
            if probable and not ranked:
                self._rank_groups([[grasp for grasp in some if id(grasp) in probable] for some in grasps], rank, ranked)
            if ranked:
                seen = {id(grasp) for grasp, _ in ranked}
                others = [(grasp, least) for grasp in ordered if id(grasp) not in seen]
                return [(grasp, bound.reach) for grasp, bound in sorted(ranked, key=_by_reach)] + others
            rest = [[grasp for grasp in some if id(grasp) not in probable] for some in grasps]
        self._rank_groups(rest, rank, ranked)
        for some in [] if ranked else grasps:
            rank(some, every=True)
        return [(grasp, bound.reach) for grasp, bound in sorted(ranked, key=_by_reach)]

    @staticmethod
    def _rank_groups(
        groups: Sequence[Sequence[ToolGrasp]], rank: Callable[[Sequence[ToolGrasp]], int], ranked: list
    ) -> None:
        """Look at the first grasps of each tool and robot, and at the others where the best of these is good."""
        first = [rank(some[:RANKED_FIRST]) for some in groups]
        good = SHARE_OF_BEST * max(first, default=0) if ranked else -1.0
        for some, best in zip(groups, first, strict=True):
            if best >= good:
                rank(some[RANKED_FIRST:])

    def _best(
        self, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray, grasps: list[ToolGrasp]
    ) -> tuple[list[ToolGrasp], np.ndarray, np.ndarray]:
        """The grasps in the order of the shares (G,) of the path that the ranker expects them to serve, and these.

        Of grasps of which about as much is expected as of the best, those from above come first, then those for which
        the arm turns little. Last, the probabilities (G,) that they serve more than a few poses, in the same order.
        """
        if self._ranker is None or not grasps:
            return grasps, np.zeros(len(grasps)), np.zeros(len(grasps))
        p, share = self._ranker.hold_serves(scene, state, object, object_poses, grasps)
        expected = p * share

        def key(k: int) -> tuple[bool, bool, int, float]:
            if expected[k] < ALIKE * expected.max():
                return True, False, 0, -expected[k]
            grasp = grasps[k]
            above = _from_above(grasp.contact.contact, grasp.T_place)
            return False, not above, round(_swing(grasp, state) / TURN_STEP), -expected[k]

        order = sorted(range(len(grasps)), key=key)
        return [grasps[k] for k in order], expected[order], p[order]

    def holds(self, scene: Scene, state: SceneState, tool: str, robot: str, rng) -> list[RobotContact]:
        """Grasps in which a robot can pick a tool where it stands, far from each other."""
        T_tool = state.poses[tool]
        manipulation, away = cleared(scene, state, tool, robot)
        contacts = list(self._first_batch(ContactQuery(scene, state, tool, T_tool[None], robot, rng)).contacts)
        if not contacts:
            return []
        contacts = secure_grasps(scene, tool, robot, contacts, T_tool)
        contacts = [contacts[k] for k in np.flatnonzero(reach_bounds(manipulation, contacts, T_tool[None]) >= 0)]
        contacts = [contacts[k] for k in farthest_points(contacts, TRIED)]
        if not contacts:
            return []
        ok, q = reachable(manipulation, contacts, T_tool, rng)
        kept = sorted(np.flatnonzero(ok), key=lambda k: not _from_above(contacts[k], T_tool))[:KEPT]
        return [RobotContact(robot, contacts[k], 0, q[k][None], away) for k in kept]

    def _bound(
        self, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray, grasp: ToolGrasp, rng, every: bool
    ) -> _Bound:
        """The farthest pose to which hand, tool and object may go.

        By the first batch of contacts; with ``every`` by all of them, up to the first one that serves far enough.
        """
        query = ContactQuery(scene, state, object, object_poses, grasp.robot, rng)
        manipulation, _ = cleared(scene, state, object, grasp.robot)
        best = _Bound()
        for batch in self._proposer.propose(query) if every else (self._first_batch(query),):
            if len(batch.contacts):
                bounds = reach_bounds(manipulation, batch.contacts, object_poses)
                reach = int(bounds.max())
                if reach > best.reach:
                    farthest = [batch.contacts[k] for k in np.flatnonzero(bounds == reach)]
                    best = _Bound(reach, _travel(grasp, farthest, state, object_poses[0]), len(farthest))
            if best.reach >= least_reach(object_poses):
                break
        return best

    def _first_batch(self, query: ContactQuery) -> ContactProposals:
        return next(iter(self._proposer.propose(query)), ContactProposals(()))
