"""Data that the parts of the planner pass to each other."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from hmap_core.types import ContactPoint, Segment, Trajectory


@dataclass(frozen=True)
class RobotContact:
    """A feasible contact of one robot.

    Attributes:
        reach: index of the farthest object pose, of those asked for, to which this contact can carry the object.
        keyframes: (reach + 1, n) configurations of the robot in contact at the object poses 0 .. reach.
        clear: other robots that have to go home before.
        proposer: name of the proposer from which it came; empty: not known.
        checked: how many contacts were checked until one was feasible, this one's batch included; 0: not known.
    """

    robot: str
    contact: ContactPoint
    reach: int
    keyframes: np.ndarray
    clear: tuple[str, ...] = ()
    proposer: str = ""
    checked: int = 0


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


@dataclass(frozen=True, eq=False)
class ToolGrasp:
    """A grasp on a tool at rest; each is one object, which is equal to itself only.

    Attributes:
        tool: its name.
        contact: of the robot on the tool; keyframes[0] is the configuration at which it is picked and placed.
        T_place: (7,) its pose at rest, world frame.
    """

    tool: str
    contact: RobotContact
    T_place: np.ndarray

    @property
    def robot(self) -> str:
        """Name of the robot."""
        return self.contact.robot


@dataclass(frozen=True)
class SubTrajectory:
    """One iteration of the inner loop: come, touch, carry, let go, retreat.

    The trajectory starts at time 0 in the state it was asked for, ends at rest, and holds only the robots and objects
    that move; the segments cover it without gaps. ``notes`` tell people what was changed of what was asked for.
    """

    trajectory: Trajectory
    segments: tuple[Segment, ...]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Progress:
    """What the planner is doing, for people.

    Attributes:
        phase: ``starting``, ``waypoints``, ``contacts``, ``motion``, ``checking``, ``done``.
        waypoint, waypoints: i of I, along the object's path; 0 of 0 before there is one.
        attempt: j, the try at this waypoint.
        text: one line.
        search: what was tried until now, as a tree (:mod:`hmap_core.planner.search_tree`); None where there is none.
    """

    phase: str
    waypoint: int = 0
    waypoints: int = 0
    attempt: int = 0
    text: str = ""
    search: Callable[[], dict[str, Any]] | None = None


ProgressCallback = Callable[[Progress], None]
