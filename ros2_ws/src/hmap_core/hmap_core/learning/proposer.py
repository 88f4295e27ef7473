"""The informed half of Algorithm 3: contacts, tools and holds, ordered by how far a model expects them to serve."""

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from hmap_core.contacts.camera import Cloud
from hmap_core.learning.clearance import Boxes
from hmap_core.learning.features import contact_features
from hmap_core.learning.hold_features import hold_features
from hmap_core.learning.network import SHIPPED, ContactModel, load_model
from hmap_core.learning.situation import PathSituation
from hmap_core.planner.interfaces import ToolGrasp
from hmap_core.planner.protocols import ContactProposals, ContactQuery
from hmap_core.planner.sampled_contacts import SampledContacts
from hmap_core.planner.tools import attach_tool
from hmap_core.types import Robot, Scene, SceneState, TaskMode

ALIKE = 0.5  # of the largest expectation, from which on contacts stay in the order of the sampler
CHECKS = 32  # contacts that are proposed at least: of them, the one that serves farthest is used
SURE = 1.0  # what is expected of hands about which nothing was learned: they come first, as without a model


class LearnedContacts:
    """Implements :class:`~hmap_core.planner.protocols.ContactProposer` and ``ManipulatorRanker``.

    The first contacts of the sampler are scored by the model; the likely ones are proposed. There are at least as many
    as the model asks for, so that one of them is feasible in 95 % of the queries in which any is. Sampled contacts
    follow as fallback.

    Where nothing was learned about a robot or a kind of task, nothing is proposed, and the order is that of sampling.

    Args:
        weights: a file of `hmap train`; empty: the weights that are shipped.
        warns: whether a warning tells of robots about which nothing was learned.

    Raises:
        InputError: the file is missing, damaged or of another program.
    """

    name = "learned"

    def __init__(self, weights: str = "", warns: bool = True):
        self._file, self._warns = Path(weights).absolute() if weights else SHIPPED, warns
        if weights:
            load_model(self._file)
        self._candidates = SampledContacts()
        self._boxes: tuple[tuple, tuple, Boxes] | None = None
        self._hands: tuple[tuple, np.ndarray, np.ndarray] | None = None  # tools and robots are ordered by one answer

    @property
    def _model(self) -> ContactModel:
        """Loaded when it is needed: in kinematic tasks it is not."""
        return load_model(self._file)

    def propose(self, query: ContactQuery) -> Iterator[ContactProposals]:
        """Yield one batch of contacts of a held tool, the best first.

        Nothing is proposed for bare hands: generating their contacts costs less than what could be saved. Nor is
        anything where the model knows nothing about the task or the robot.
        """
        tool = query.tool
        if tool is None or not self._knows(query.scene, query.robot):
            return
        query = replace(query, cloud=sound(query.cloud))
        contacts = [c for batch in islice(self._candidates.propose(query), 1) for c in batch.contacts]
        if not contacts:
            return
        scene, boxes = query.scene, self._around(query.scene, query.state, (query.object, tool.name))
        body, placed = scene.bodies[query.object], scene.robots[query.robot]
        situation = PathSituation.among(scene, body, placed, query.object_poses, boxes)
        p, share = self._model.feasible(contact_features(situation, contacts))
        best = _likeliest(p * (0.2 + share))[: max(self._model.checks or 0, CHECKS)]
        yield ContactProposals(tuple(contacts[k] for k in best), tuple(p[best].tolist()))

    def hand_serves(
        self, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray, robots: Sequence[str]
    ) -> np.ndarray:
        """As :meth:`hmap_core.planner.protocols.ManipulatorRanker.hand_serves`."""
        if not all(self._knows(scene, robot) for robot in robots) or not len(robots):
            return np.full(len(robots), SURE)
        boxes, names = self._around(scene, state, (object,)), sorted(robots)
        placed = [bare(scene.robots[name]) for name in names]
        body = scene.bodies[object]
        asked = (boxes, body, *placed)
        if self._hands is None or not _same(self._hands[0], asked) or not np.array_equal(self._hands[1], object_poses):
            rows = [hold_features(PathSituation.among(scene, body, r, object_poses, boxes)) for r in placed]
            self._hands = asked, object_poses, self._model.serves(np.array(rows))[0]
        return self._hands[2][[names.index(robot) for robot in robots]]

    def hold_serves(
        self, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray, holds: Sequence[ToolGrasp]
    ) -> tuple[np.ndarray, np.ndarray]:
        """As :meth:`hmap_core.planner.protocols.ManipulatorRanker.hold_serves`."""
        if not holds or not all(self._knows(scene, hold.robot) for hold in holds):
            return np.zeros(len(holds)), np.zeros(len(holds))
        rows = []
        for hold in holds:
            placed = attach_tool(scene, hold).robots[hold.robot]
            boxes = self._around(scene, state, (object, hold.tool))
            rows.append(hold_features(PathSituation.among(scene, scene.bodies[object], placed, object_poses, boxes)))
        return self._model.serves(np.array(rows))

    def _around(self, scene: Scene, state: SceneState, without: tuple[str, ...]) -> Boxes:
        """The boxes of all bodies but some; the last answer is kept, since holds on one tool share it."""
        others = [(body, state.poses[name]) for name, body in scene.bodies.items() if name not in without]
        bodies, poses = tuple(body for body, _ in others), tuple(T.tobytes() for _, T in others)
        if self._boxes is None or not _same(self._boxes[0], bodies) or self._boxes[1] != poses:
            self._boxes = bodies, poses, Boxes.around(others)
        return self._boxes[2]

    def _knows(self, scene: Scene, robot: str) -> bool:
        """Whether the model was trained for such a task and robot; a warning says so where it was not."""
        if scene.mode == TaskMode.KINEMATIC:
            return False  # any touch carries: there is nothing to learn
        model = scene.robots[robot].model.name
        known = model in self._model.robots
        if not known and self._warns:
            warnings.warn(
                f"the learned contact proposer has not seen the robot '{model}' (it knows "
                f"{', '.join(sorted(self._model.robots))}): its contacts are sampled",
                RuntimeWarning,
                stacklevel=2,
            )
        return known


def _likeliest(expected: np.ndarray) -> np.ndarray:
    """Indices (K,) of contacts with what is expected of them: alike ones in their order, then others, the best first.

    The order in which contacts are sampled, by their score, says how robust they are: of that nothing is learned.
    """
    alike = expected >= ALIKE * expected.max()
    return np.argsort(np.where(alike, -np.inf, -expected), kind="stable")


def where_known() -> LearnedContacts:
    """The default proposer: the shipped model, silent about robots and tasks that it does not know."""
    return LearnedContacts(warns=False)


def _same(some: tuple, others: tuple) -> bool:
    """Whether two tuples have the same objects; those that are kept cannot be taken for new ones."""
    return len(some) == len(others) and all(a is b for a, b in zip(some, others, strict=True))


def bare(robot: Robot) -> Robot:
    """A robot without an attached tool."""
    return robot if robot.model.attached is None else replace(robot, model=replace(robot.model, attached=None))


def sound(cloud: Cloud | None) -> Cloud | None:
    """A measured cloud without points that are not finite; None with a warning where nothing is left."""
    if cloud is None:
        return None
    finite = np.isfinite(cloud.points).all(axis=1) & np.isfinite(cloud.normals).all(axis=1)
    if finite.all() and len(cloud):
        return cloud
    if not finite.any():
        warnings.warn("a measured cloud has no finite point: the known surface is used", RuntimeWarning, stacklevel=3)
        return None
    return cloud[finite]
