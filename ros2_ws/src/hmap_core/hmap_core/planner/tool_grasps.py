"""Which tool a robot should pick to move an object, and where it should grasp it."""

import time
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from hmap_core.collision.convex import convex_set
from hmap_core.contacts.feasibility import reach_bounds, reachable
from hmap_core.planner.contact_checker import cleared, least_reach, secure_grasps
from hmap_core.planner.interfaces import RobotContact, ToolGrasp
from hmap_core.planner.protocols import ContactProposals, ContactProposer, ContactQuery, ManipulatorRanker
from hmap_core.planner.robot_order import UNLIKELY
from hmap_core.planner.tools import attach_tool, farthest_points, tools_of, within_reach
from hmap_core.transforms import apply, rotation_matrices, rotation_matrix, wrapped
from hmap_core.types import AttachedBody, ContactPoint, Scene, SceneState

TRIED = 16  # grasps on a tool for which inverse kinematics is solved
KEPT = 8  # of them, per robot
RANKED_FIRST = 3  # of these; the others are ranked only if the best of the first is good
LOOKED_AT = 8  # of the best that a ranker names, until some serve
COMPARED = 2  # of these, where some serve; fewer, if one serves to the end of the path without a long way
LITTLE_TRAVEL = 3  # steps of TURN_STEP that arm and tool may turn for a grasp that is taken without a comparison
ALIKE = 0.5  # of the best expectation of a ranker, from which on it tells little about which grasp is best
POINTS = 0.05  # m beside the hand to which a tool reaches at least that points somewhere
FIRST_WAY = 8  # poses of an object's path whose direction counts for where a tool has to point
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

    def ends_at(self, last: int) -> bool:
        """Whether it serves to the last pose, without a long way: other grasps can hardly be better."""
        return self.reach == last and self.travel <= LITTLE_TRAVEL


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


def _turn(grasp: ToolGrasp, attached: AttachedBody, way: np.ndarray) -> float:
    """Angle between where a tool points as it is picked, and a direction (3,) of pushes, about the vertical, rad.

    A tool points from the hand to its farthest vertex. 0 for tools below the hand, which point nowhere.
    """
    R = rotation_matrix(grasp.T_place) @ rotation_matrix(grasp.contact.contact.T_obj_ee)
    vertices = apply(attached.T_ee_body, convex_set(attached.shapes).vertices) @ R.T
    lengths = np.linalg.norm(vertices[:, :2], axis=1)
    if lengths.max() < POINTS or np.linalg.norm(way[:2]) < 0.5 * np.linalg.norm(way):
        return 0.0
    tip = vertices[lengths.argmax(), :2]
    return abs(float(wrapped(np.arctan2(tip[1], tip[0]) - np.arctan2(way[1], way[0]))))


class _Looks:
    """Grasps on tools that are looked at by geometry, each once.

    Args:
        bound_of: how far a grasp may serve; by the first contacts, or by all of them.
        least: index of the pose to which a grasp has to serve.
        deadline: of ``time.monotonic``, s; at least one of the grasps at hand is looked at.

    Attributes:
        serving: the grasps that serve far enough, with how far.
    """

    def __init__(self, bound_of: Callable[[ToolGrasp, bool], _Bound], least: int, deadline: float):
        self._bound_of, self._least, self._deadline = bound_of, least, deadline
        self._seen: set[tuple[ToolGrasp, bool]] = set()
        self.serving: list[tuple[ToolGrasp, _Bound]] = []

    def at(self, grasps: Iterable[ToolGrasp], every: bool = False) -> int:
        """Look at grasps that were not looked at; the index of the farthest pose to which one of these may serve."""
        best = -1
        for grasp in grasps:
            if (grasp, every) in self._seen:
                continue
            self._seen.add((grasp, every))
            bound = self._bound_of(grasp, every)
            best = max(best, bound.reach)
            if bound.reach >= self._least:
                self.serving.append((grasp, bound))
            if time.monotonic() > self._deadline:
                break
        return best

    def at_groups(self, groups: Sequence[Sequence[ToolGrasp]]) -> None:
        """Look at the first grasps of each group, and at the others of those in which the best of the first is good."""
        first = [self.at(some[:RANKED_FIRST]) for some in groups]
        good = SHARE_OF_BEST * max(first, default=0) if self.serving else -1.0
        for some, best in zip(groups, first, strict=True):
            if best >= good:
                self.at(some[RANKED_FIRST:])

    def best(self, others: Sequence[ToolGrasp] = ()) -> list[tuple[ToolGrasp, int]]:
        """The grasps that serve, the best first, then others that were not looked at; with how far each may serve."""
        found = [(grasp, bound.reach) for grasp, bound in sorted(self.serving, key=_by_reach)]
        return found + [(grasp, self._least) for grasp in others if (grasp, False) not in self._seen]


def _likeliest_first(
    ranker: ManipulatorRanker,
    scene: Scene,
    state: SceneState,
    object: str,
    object_poses: np.ndarray,
    grasps: Sequence[ToolGrasp],
) -> tuple[list[ToolGrasp], np.ndarray]:
    """Grasps in the order of how far a ranker expects them to serve, and the probabilities (G,) that they serve more
    than a few poses.

    Of grasps of which about as much is expected as of the best, those from above come first, then those for which the
    arm turns little.
    """
    p, share = ranker.hold_serves(scene, state, object, object_poses, grasps)
    expected = p * share
    way = object_poses[min(FIRST_WAY, len(object_poses) - 1), :3] - object_poses[0, :3]

    def key(k: int) -> tuple[bool, bool, int, float]:
        if expected[k] < ALIKE * expected.max():
            return True, False, 0, -expected[k]
        grasp = grasps[k]
        above = _from_above(grasp.contact.contact, grasp.T_place)
        attached = attach_tool(scene, grasp).robots[grasp.robot].model.attached
        travel = _swing(grasp, state) + (0.0 if attached is None else _turn(grasp, attached, way))
        return False, not above, round(travel / TURN_STEP), -expected[k]

    order = sorted(range(len(grasps)), key=key)
    return [grasps[k] for k in order], p[order]


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
        informed: proposes few contacts of tools on the object, for what the ranker names; None: ``proposer`` does.
    """

    def __init__(
        self,
        proposer: ContactProposer,
        ranker: ManipulatorRanker | None = None,
        informed: ContactProposer | None = None,
    ):
        self._proposer, self._ranker, self._informed = proposer, ranker, informed

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
        rng = np.random.default_rng(seed)
        groups = [
            [ToolGrasp(tool, contact, state.poses[tool]) for contact in self.holds(scene, state, tool, robot, rng)]
            for tool in tools_of(scene, object)
            for robot in scene.robots
            if within_reach(scene, state, robot, tool, object)
        ]

        probable: set[ToolGrasp] = set()  # that the ranker expects to serve

        def bound_of(grasp: ToolGrasp, every: bool) -> _Bound:
            attached, first = attach_tool(scene, grasp), self._informed if grasp in probable else None
            return self._bound(attached, state, object, object_poses, grasp, rng, first, every)

        looks = _Looks(bound_of, least_reach(object_poses), time.monotonic() + time_limit)
        if self._ranker is not None:
            grasps = [grasp for some in groups for grasp in some]
            ordered, p = _likeliest_first(self._ranker, scene, state, object, object_poses, grasps)
            if p.max(initial=0.0) < likely:
                return []
            probable |= {grasp for grasp, each in zip(ordered, p, strict=True) if each >= UNLIKELY}
            # where none is probable, the order says little: tools may be of a kind that the ranker does not know
            for k, grasp in enumerate(ordered[:LOOKED_AT] if probable else []):
                looks.at([grasp])
                if looks.serving and (k + 1 >= COMPARED or looks.serving[-1][1].ends_at(len(object_poses) - 1)):
                    break
            if likely and not looks.serving:
                return []  # the ranker was wrong: hands come first, as without it, before all grasps are looked at
            if probable and not looks.serving:
                looks.at_groups([[grasp for grasp in some if grasp in probable] for some in groups])
            if looks.serving:
                return looks.best(ordered)
        looks.at_groups(groups)
        for some in [] if looks.serving else groups:
            looks.at(some, every=True)
        return looks.best()

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
        self, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray, grasp: ToolGrasp, rng,
        informed: ContactProposer | None, every: bool,
    ) -> _Bound:  # fmt: skip
        """The farthest pose to which hand, tool and object may go.

        By the first batch of contacts, an informed one if there is one; with ``every`` by all of them, up to the first
        one that serves far enough.
        """
        query = ContactQuery(scene, state, object, object_poses, grasp.robot, rng)
        manipulation, _ = cleared(scene, state, object, grasp.robot)
        best = _Bound()
        first = None if informed is None or every else next(iter(informed.propose(query)), None)
        for batch in self._proposer.propose(query) if every else (first or self._first_batch(query),):
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
