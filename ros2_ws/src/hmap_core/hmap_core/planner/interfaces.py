"""What Algorithm 1 asks of the parts below it: called directly by ``hmap plan``, over services by the supervisor."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from hmap_core.contacts.camera import Cloud
from hmap_core.types import ContactPoint, Goal, Scene, SceneState, Segment, Trajectory
from hmap_core.waypoints import ObjectPath


@dataclass(frozen=True)
class RobotContact:
    """A feasible contact of one robot.

    Attributes:
        reach: index of the farthest object pose, of those asked for, to which this contact can carry the object.
        keyframes: (reach + 1, n) configurations of the robot in contact at the object poses 0 .. reach.
        clear: other robots that have to go home before.
    """

    robot: str
    contact: ContactPoint
    reach: int
    keyframes: np.ndarray
    clear: tuple[str, ...] = ()


@dataclass(frozen=True)
class AttachedPath:
    """A path of an object, and a hand that goes with it past what stands around.

    Attributes:
        object: its name.
        poses: (M, 7) of the object.
        robot, contact: the hand.
        blockers: removable bodies without which the path is free.
    """

    object: str
    poses: np.ndarray
    robot: str
    contact: ContactPoint
    blockers: tuple[str, ...] = ()


@dataclass(frozen=True)
class ToolGrasp:
    """A hold on a tool that stands.

    Attributes:
        tool: its name.
        contact: of the robot on the tool; keyframes[0] is the configuration in which it is taken, and put back.
        T_place: (7,) where it stands.
    """

    tool: str
    contact: RobotContact
    T_place: np.ndarray

    @property
    def robot(self) -> str:
        return self.contact.robot


@dataclass(frozen=True)
class SubTrajectory:
    """One iteration of the inner loop: come, touch, carry, let go, retreat.

    The trajectory starts at time 0 in the state it was asked for, ends at rest, and holds only the robots and objects
    that move; the segments cover it without gaps.
    """

    trajectory: Trajectory
    segments: tuple[Segment, ...]


@dataclass(frozen=True)
class Progress:
    """What the planner is doing, for people.

    Attributes:
        phase: ``waypoints``, ``contacts``, ``motion``, ``checking``, ``done``.
        waypoint, waypoints: i of I, along the object's path; 0 of 0 before there is one.
        attempt: j, the try at this waypoint.
    """

    phase: str
    waypoint: int = 0
    waypoints: int = 0
    attempt: int = 0
    text: str = ""


ProgressCallback = Callable[[Progress], None]


class Backend(Protocol):
    """The three phases of H-MaP. Each raises the HmapError of its stage, with the reason."""

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
        """Algorithm 2, in which trees check at most ``checks`` motions. Raises WaypointError or InputError."""
        ...

    def propose_contacts(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        object_poses: np.ndarray,
        robots: Sequence[str],
        cloud: Cloud | None,
        count: int,
        seed: int,
        time_limit: float,
    ) -> list[RobotContact]:
        """Algorithm 3: at most ``count`` contacts for carrying the object along object_poses (M, 7), farthest first.

        ``cloud`` is what a camera has seen of the object (object frame), if anything. Raises ContactError when none is
        feasible.
        """
        ...

    def check_contacts(
        self, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray, robot: str,
        contacts: Sequence[ContactPoint], rng: np.random.Generator, beyond: int = -1,
    ) -> list[RobotContact]:  # fmt: skip
        """The feasible ones of a robot's contacts, that serve past the pose ``beyond`` of object_poses (M, 7)."""
        ...

    def candidates(
        self, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray, robot: str,
        rng: np.random.Generator, cloud: Cloud | None = None,
    ) -> Iterator[list[ContactPoint]]:  # fmt: skip
        """Batches of contacts on an object for the way along object_poses (M, 7), of which nothing was asked yet."""
        ...

    def promising_contacts(
        self, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray, robot: str,
        contacts: Sequence[ContactPoint], beyond: int = -1,
    ) -> list[ContactPoint]:  # fmt: skip
        """Those of a robot's contacts in which the hand alone could go past the pose ``beyond`` of object_poses."""
        ...

    def contacts_at_both_ends(
        self, scene: Scene, state: SceneState, object: str, T_goal: np.ndarray, robot: str, count: int, seed: int
    ) -> list[ContactPoint]:
        """At most ``count`` contacts that can be made where the object stands, and left with it at T_goal (7,)."""
        ...

    def solve_segment(
        self, scene: Scene, state: SceneState, object: str, contact: RobotContact, object_poses: np.ndarray, seed: int,
        time_limit: float,
    ) -> SubTrajectory:  # fmt: skip
        """KOMO from the present state to the last of object_poses (K, 7) in this contact. Raises MotionError."""
        ...

    def tool_grasps(
        self, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray, seed: int, time_limit: float
    ) -> list[tuple[ToolGrasp, int]]:
        """Holds on tools with which the object may be moved along object_poses (M, 7), and how far at best."""
        ...

    def pick_tool(
        self, scene: Scene, state: SceneState, grip: ToolGrasp, seed: int, time_limit: float
    ) -> SubTrajectory:
        """The motion in which a robot takes a tool and keeps it. Raises MotionError."""
        ...

    def place_tool(
        self, scene: Scene, state: SceneState, grip: ToolGrasp, seed: int, time_limit: float
    ) -> SubTrajectory:
        """The motion in which it puts the tool back where it took it. Raises MotionError."""
        ...
