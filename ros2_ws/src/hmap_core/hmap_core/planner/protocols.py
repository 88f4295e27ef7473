"""The extension points of the planner: what Algorithm 1 needs, as small protocols with typed queries.

Each protocol has one job of the paper. Anything with the right methods implements it; no base class is needed. The
local implementations are listed in :mod:`hmap_core.planner.components`; the ROS package implements the same protocols
by services. :mod:`hmap_core.planner.plugins` finds implementations by name.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from hmap_core.collision.scene_model import Collisions
from hmap_core.contacts.camera import Cloud
from hmap_core.kinematics.chain import Chain
from hmap_core.planner.hand_moves import HandMoves
from hmap_core.planner.interfaces import ProgressCallback, RobotContact, SubTrajectory, ToolGrasp
from hmap_core.types import AttachedBody, ContactPoint, Goal, Plan, Scene, SceneState
from hmap_core.waypoints import ObjectPath

Cancel = Callable[[], bool]  # asked between two steps; True stops the job


@dataclass(frozen=True)
class ObjectPathQuery:
    """The path of an object alone (Algorithm 2).

    Attributes:
        scene, state: the world, and where everything is.
        goal: names the object and its goal pose.
        seed: the only source of randomness.
        time_limit: seconds of wall-clock time.
        max_checks: largest number of motions whose validity may be checked. It ends a search independently of the
            speed of the machine.
    """

    scene: Scene
    state: SceneState
    goal: Goal
    seed: int
    time_limit: float
    max_checks: float = np.inf


@runtime_checkable
class ObjectPathPlanner(Protocol):
    """Plans the path of an object without any robot (Algorithm 2)."""

    def plan_path(self, query: ObjectPathQuery) -> ObjectPath:
        """Plan a path from the present pose of the object to its goal.

        Raises:
            NoObjectPath: there is none; the error may name the removable bodies that block it.
            InputError: start or goal is invalid.
        """
        ...


@dataclass(frozen=True)
class ContactQuery:
    """Contacts of one robot on one object.

    Attributes:
        scene, state: the world, and where everything is.
        object: name of the object.
        object_poses: (M, 7) poses of the object from the present one on, world frame.
        robot: name of the robot.
        rng: the only source of randomness.
        cloud: points that cameras measured on the object, in its own frame; None: nothing was measured.
        surface: points of the object's known surface, in its own frame, with which of them cameras see; None: not
            sampled yet.
        count: how many contacts are wanted at most; 0: the proposer decides.
        deadline: ``time.monotonic()`` after which no further contact is checked.
    """

    scene: Scene
    state: SceneState
    object: str
    object_poses: np.ndarray
    robot: str
    rng: np.random.Generator
    cloud: Cloud | None = None
    surface: Cloud | None = None
    count: int = 0
    deadline: float = math.inf

    @property
    def tool(self) -> AttachedBody | None:
        """The tool that the robot holds and touches with; None for the bare hand."""
        return self.scene.robots[self.robot].model.attached


@dataclass(frozen=True)
class ContactProposals:
    """A batch of proposed contacts, the best first.

    Attributes:
        contacts: the contacts.
        confidence: for each, the estimated probability in [0, 1] that it is feasible; empty where it is unknown.
    """

    contacts: tuple[ContactPoint, ...]
    confidence: tuple[float, ...] = ()

    def __len__(self) -> int:
        return len(self.contacts)


@runtime_checkable
class ContactProposer(Protocol):
    """Proposes contacts before any feasibility check: the informed or the sampling half of Algorithm 3.

    A poor proposer costs time and nothing else: every contact is checked, and sampled contacts are the fallback.
    """

    def propose(self, query: ContactQuery) -> Iterator[ContactProposals]:
        """Yield batches of contacts, the best batch first; an empty iterator where there are none.

        An empty batch says that what follows costs more. Other robots are queried before that.
        """
        ...


@runtime_checkable
class ManipulatorRanker(Protocol):
    """Estimates, before any contact is sampled, how far hands and held tools would move an object.

    A contact proposer may be one, too. It decides the order in which robots, tools and holds are tried, and nothing
    else: what it expects little of is tried last.
    """

    def hand_serves(
        self, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray, robots: Sequence[str]
    ) -> np.ndarray:
        """Probability (R,) that the bare hand of each robot serves more than a few of the poses (M, 7)."""
        ...

    def hold_serves(
        self, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray, holds: Sequence[ToolGrasp]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Probability (H,) that each hold on a tool serves more than a few poses, and the share (H,) of them."""
        ...


@runtime_checkable
class ContactChecker(Protocol):
    """Checks contacts for one robot (eq. 3 of the paper)."""

    def check(self, query: ContactQuery, contacts: Sequence[ContactPoint], beyond: int = -1) -> list[RobotContact]:
        """Return the feasible contacts, each with how far along the poses of the query it serves.

        Args:
            query: the robot, the object, and its poses (M, 7).
            contacts: to be checked.
            beyond: index of a pose; contacts that serve no farther are left out.
        """
        ...

    def promising(self, query: ContactQuery, contacts: Sequence[ContactPoint], beyond: int = -1) -> list[ContactPoint]:
        """Return the contacts that pass the checks of the rigid hand alone, in the order in which to check them."""
        ...


@dataclass(frozen=True)
class ContactSearchQuery:
    """Feasible contacts on one object by any of some robots (Algorithm 3).

    Attributes:
        scene, state, object, object_poses, cloud: as in :class:`ContactQuery`.
        robots: names, in the order in which they are queried.
        count: how many contacts are wanted at most; 0: all that were found.
        seed: the only source of randomness.
        time_limit: seconds of wall-clock time.
        thorough: whether what a proposer has after an empty batch is looked at where there is nothing else.
        min_reach: contacts that serve for fewer poses are not looked for.
    """

    scene: Scene
    state: SceneState
    object: str
    object_poses: np.ndarray
    robots: tuple[str, ...] = ()
    cloud: Cloud | None = None
    count: int = 0
    seed: int = 0
    time_limit: float = np.inf
    thorough: bool = True
    min_reach: int = 0


@runtime_checkable
class ContactFinder(Protocol):
    """Finds feasible contacts: proposes, checks and ranks (Algorithm 3)."""

    def find_contacts(self, query: ContactSearchQuery) -> list[RobotContact]:
        """Return feasible contacts, the best first.

        Raises:
            ContactError: NO_CONTACT; none is feasible.
        """
        ...


@dataclass(frozen=True)
class SegmentQuery:
    """The motion in which a contact carries an object.

    Attributes:
        scene, state: the world, and where everything is.
        object: name of the object.
        contact: the contact, with the robot that makes it.
        object_poses: (K, 7) poses of the object from the present one on, world frame.
        seed: the only source of randomness.
        time_limit: seconds of wall-clock time.
    """

    scene: Scene
    state: SceneState
    object: str
    contact: RobotContact
    object_poses: np.ndarray
    seed: int = 0
    time_limit: float = np.inf


@dataclass(frozen=True)
class ToolQuery:
    """The motion in which a robot picks or places a tool.

    Attributes:
        scene, state: the world, and where everything is.
        tool_grasp: the grasp on the tool.
        seed: the only source of randomness.
        time_limit: seconds of wall-clock time.
    """

    scene: Scene
    state: SceneState
    tool_grasp: ToolGrasp
    seed: int = 0
    time_limit: float = np.inf


@dataclass(frozen=True)
class SharedQuery:
    """The motion in which two robots handle one object together.

    They carry it by two grasps, or the first one passes it to the second one.

    Attributes:
        scene, state: the world, and where everything is.
        object: name of the object.
        contacts: of the two robots; the first one grasps first. Where both carry the object, each has configurations
            at all of the poses. When one passes it on, the giver's are for the
            first two poses, the taker's for the last two.
        object_poses: (K, 7) poses of the object from the present one on, world frame. When it is passed on, three: the
            present one, the one at which it is passed on, and the last one.
        seed: the only source of randomness.
        time_limit: seconds of wall-clock time.
        hand_over: whether the first robot passes the object to the second one.
    """

    scene: Scene
    state: SceneState
    object: str
    contacts: tuple[RobotContact, RobotContact]
    object_poses: np.ndarray
    seed: int = 0
    time_limit: float = np.inf
    hand_over: bool = False


@runtime_checkable
class SegmentPlanner(Protocol):
    """Plans the motions of robots for given contacts (KOMO, eq. 2 of the paper)."""

    def plan_segment(self, query: SegmentQuery) -> SubTrajectory:
        """Plan the motion from the present state to the last object pose. Raises MotionError."""
        ...

    def plan_pick(self, query: ToolQuery) -> SubTrajectory:
        """Plan the motion in which a robot picks a tool. Raises MotionError."""
        ...

    def plan_place(self, query: ToolQuery) -> SubTrajectory:
        """Plan the motion in which a robot places its tool where it picked it. Raises MotionError."""
        ...

    def plan_shared(self, query: SharedQuery) -> SubTrajectory:
        """Plan the motion in which two robots carry an object together, or pass it on. Raises MotionError."""
        ...


@runtime_checkable
class TransitPlanner(Protocol):
    """Searches a joint path of one robot where the optimiser finds none."""

    def find_transit(
        self,
        moves: HandMoves,
        chain: Chain,
        cols: Collisions,
        mask: int,
        start: np.ndarray,
        goal: np.ndarray,
        rng: np.random.Generator,
        deadline: float,
    ) -> np.ndarray | None:
        """Return configurations (m, n) of a free path from start to goal (n,); None where none was found.

        Args:
            moves: straight moves of the hand by inverse kinematics.
            chain: the joints.
            cols: collision pairs with their minimum distances.
            mask: bit mask of the phases that count.
            start, goal: (n,) rad.
            rng: the only source of randomness.
            deadline: ``time.monotonic()`` after which the search ends.
        """
        ...


@runtime_checkable
class ManipulationPlanner(Protocol):
    """A whole method: H-MaP or anything that is compared with it."""

    def plan(
        self,
        scene: Scene,
        state: SceneState | None = None,
        seed: int = 0,
        time_limit: float = 60.0,
        progress: ProgressCallback | None = None,
        cancel: Cancel | None = None,
    ) -> Plan:
        """Plan a task.

        Args:
            scene: the task.
            state: where everything is; None: where the scene starts.
            seed: the only source of randomness.
            time_limit: seconds of wall-clock time.
            progress: called whenever something new begins.
            cancel: asked between two steps; True stops the job.

        Raises:
            HmapError: stage, code and reason of the failure.
        """
        ...
