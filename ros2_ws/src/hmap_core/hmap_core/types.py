"""The data that the parts of hmap pass to each other: SI units, world frame, poses as in transforms.py."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from pathlib import Path

import numpy as np

from hmap_core.transforms import IDENTITY

# m, rad: how far off its goal an object may be after execution
EXECUTED_WITHIN = (0.02, float(np.deg2rad(10.0)))
GRIPPER_SPEED = 0.1  # m/s of an opening, where nothing else is said


class ShapeKind(StrEnum):
    """Kinds of convex primitive; a mesh is taken as its convex hull (concave ones are listed as several shapes)."""

    BOX = "box"  # size: full extents x, y, z
    CYLINDER = "cylinder"  # size: radius, height; axis z
    SPHERE = "sphere"  # size: radius
    CAPSULE = "capsule"  # size: radius, height of the cylindrical part; axis z
    MESH = "mesh"  # size: scale x, y, z; the file in ``mesh``


@dataclass(frozen=True)
class Shape:
    """A convex shape of a body."""

    kind: ShapeKind
    size: tuple[float, ...]
    pose: np.ndarray = field(default_factory=lambda: IDENTITY)  # T_body_shape (7,)
    mesh: Path | None = None


class BodyKind(StrEnum):
    """What may happen to a body."""

    FIXED = "fixed"  # never moves
    MOVABLE = "movable"  # may be moved by contact
    TOOL = "tool"  # movable, and may be held and used as a manipulator


class TaskMode(StrEnum):
    """What a contact may do.

    KINEMATIC: a touching fingertip carries the object in any direction (the paper's stable constraint).
    PHYSICAL: only what friction, closing width and geometry allow; plans are executed under dynamics.
    """

    KINEMATIC = "kinematic"
    PHYSICAL = "physical"


@dataclass(frozen=True)
class Body:
    """A rigid body of the scene: one or more convex shapes in one body frame."""

    name: str
    kind: BodyKind
    shapes: tuple[Shape, ...]
    pose: np.ndarray  # T_world_body (7,)
    mass: float = 0.0  # kg; 0 for fixed bodies
    friction: float = 0.6  # lateral Coulomb coefficient
    # axis-aligned boxes (2, 3) [lower, upper] in the body frame in which contacts may lie; empty: anywhere
    graspable: tuple[np.ndarray, ...] = ()
    color: tuple[float, float, float, float] | None = None  # rgba in [0, 1]


@dataclass(frozen=True)
class Gripper:
    """A gripper of two fingers; ``opening`` is the gap between the finger pads in metres, as in GripperCommand.

    Joint i is at ``at_zero[i] + travel * per_joint[i]``. Where fingers slide, travel is the opening. Where they turn,
    it goes from 0, closed, to 1, open; ``openings`` are the gaps on the way, and it is linear between them.

    Attributes:
        joint_names: the k joints that are driven; others may follow them by their ``mimic`` in the URDF.
        per_joint, at_zero: one number for each joint, or one for all.
        finger_links: the links that touch.
        min_opening, max_opening: m, usable for grasping.
        open_opening: m, commanded when opened fully.
        tip_offset: m, from the end-effector frame to the end of the closed fingers, along the approach axis.
        pad_half_width: m, half extent of a pad across the closing and approach axes.
        force: N, when grasping.
        openings: (M,) m, increasing, at travels spaced evenly from 0 to 1; empty where travel is the opening.
        tips: (M,) m, how far the fingers reach farther along the approach than closed; empty where they never do.
        speed: m/s that the opening changes by at most.
    """

    joint_names: tuple[str, ...]
    per_joint: float | tuple[float, ...]
    finger_links: tuple[str, ...]
    min_opening: float
    max_opening: float
    open_opening: float
    tip_offset: float
    pad_half_width: float
    force: float
    at_zero: float | tuple[float, ...] = 0.0
    openings: tuple[float, ...] = ()
    tips: tuple[float, ...] = ()
    speed: float = GRIPPER_SPEED

    def joints(self, opening: float) -> tuple[float, ...]:
        """Where the driven joints (k,) are at an opening (m)."""
        travel = float(np.interp(opening, self.openings, self._travels)) if self.openings else opening
        return tuple(start + travel * slope for start, slope in self._each)

    def opening_at(self, joints: Sequence[float]) -> float:
        """The opening (m) with the driven joints at (k,)."""
        shares = [(joint - start) / slope for joint, (start, slope) in zip(joints, self._each, strict=True)]
        travel = sum(shares) / len(shares)
        return float(np.interp(travel, self._travels, self.openings)) if self.openings else float(travel)

    def joints_per_opening(self, opening: float) -> tuple[float, ...]:
        """How much the driven joints (k,) move for each metre of opening, about an opening (m)."""
        travel = 1.0
        if self.openings:
            step = min(max(bisect_left(self.openings, opening), 1), len(self.openings) - 1)
            travel = float(self._travels[1]) / (self.openings[step] - self.openings[step - 1])
        return tuple(travel * slope for _, slope in self._each)

    def reach_at(self, opening: float) -> float:
        """How much farther along the approach the fingers reach at an opening (m) than closed, m."""
        return float(np.interp(opening, self.openings, self.tips)) if self.tips else 0.0

    @cached_property
    def _each(self) -> tuple[tuple[float, float], ...]:
        """Of each joint: ``at_zero`` and ``per_joint``."""
        k = len(self.joint_names)
        starts, slopes = (np.broadcast_to(values, k).tolist() for values in (self.at_zero, self.per_joint))
        return tuple(zip(starts, slopes, strict=True))

    @cached_property
    def _travels(self) -> np.ndarray:
        return np.linspace(0.0, 1.0, len(self.openings))


@dataclass(frozen=True)
class AttachedBody:
    """A body that a robot holds and works with, as if it were part of the hand.

    Attributes:
        shapes: in the body's frame.
        T_ee_body: (7,) where it is in the hand.
        opening: of the gripper that holds it, m.
        friction: its lateral Coulomb coefficient.
        up: (3,) what was up, in the body's frame, when it stood.
    """

    name: str
    shapes: tuple[Shape, ...]
    T_ee_body: np.ndarray
    opening: float
    friction: float
    up: np.ndarray


@dataclass(frozen=True)
class RobotModel:
    """A serial arm: a URDF and what a URDF does not say.

    The end-effector frame has its z axis along the approach direction and its y axis along the closing direction of the
    gripper; its origin lies midway between the finger pads (or at the tip of an arm without gripper).
    """

    name: str
    urdf: Path  # where the file is on this machine
    urdf_uri: str  # the same, portable: "pybullet_data://franka_panda/panda.urdf" or "hmap_scenes://robots/x.urdf"
    joint_names: tuple[str, ...]  # the n arm joints, base to tip
    end_effector_link: str
    T_link_ee: np.ndarray  # (7,)
    home: np.ndarray  # (n,)
    position_limits: np.ndarray  # (2, n)
    velocity_limits: np.ndarray  # (n,)
    acceleration_limits: np.ndarray  # (n,)
    gripper: Gripper | None
    ignored_collisions: tuple[tuple[str, str], ...]  # pairs of link names
    simulation: dict = field(default_factory=dict)  # gains and forces for the simulated controller
    attached: AttachedBody | None = None  # what the hand holds to work with; it then cannot grip


@dataclass(frozen=True)
class Robot:
    """An arm placed in the scene."""

    name: str
    model: RobotModel
    base_pose: np.ndarray  # T_world_base (7,)
    q: np.ndarray  # (n,) start configuration


@dataclass(frozen=True)
class Goal:
    """Where an object has to end, and how exactly."""

    object: str
    pose: np.ndarray  # T_world_obj (7,)
    position_tolerance: float = 0.005  # m
    rotation_tolerance: float = float(np.deg2rad(2.0))  # rad


@dataclass(frozen=True)
class Camera:
    """A pinhole camera; its frame is the optical one (x right, y down, z forward)."""

    name: str
    pose: np.ndarray  # T_world_optical (7,)
    width: int = 640
    height: int = 480
    fov_y: float = float(np.deg2rad(42.0))


@dataclass(frozen=True)
class Scene:
    """A task after randomisation: everything the planner, the judge and the simulator start from."""

    task: str
    seed: int
    mode: TaskMode
    bodies: dict[str, Body]
    robots: dict[str, Robot]
    cameras: dict[str, Camera]
    goal: Goal
    # SE(2) on its support ("planar"), SE(3) ("spatial"), or decided from start and goal ("auto")
    motion: str = "auto"
    # movable bodies the planner may put out of the way, with a removal pose where one is given
    removable: dict[str, np.ndarray | None] = field(default_factory=dict)
    execution_tolerance: tuple[float, float] = EXECUTED_WITHIN

    def with_goal(self, goal: Goal) -> "Scene":
        """The same scene with another goal."""
        return replace(self, goal=goal)

    def start_state(self) -> "SceneState":
        """The state the scene starts in, grippers fully open (closed where there is none)."""
        return SceneState(
            q={name: robot.q.copy() for name, robot in self.robots.items()},
            gripper={n: r.model.gripper.open_opening if r.model.gripper else 0.0 for n, r in self.robots.items()},
            poses={name: body.pose.copy() for name, body in self.bodies.items()},
        )


@dataclass
class SceneState:
    """Where everything is at one instant (the paper's configuration X)."""

    q: dict[str, np.ndarray]  # robot -> (n,)
    gripper: dict[str, float]  # robot -> opening in metres
    poses: dict[str, np.ndarray]  # body -> T_world_body (7,)

    def copy(self) -> "SceneState":
        """The same state with arrays of its own."""
        return SceneState(
            {k: v.copy() for k, v in self.q.items()}, dict(self.gripper), {k: v.copy() for k, v in self.poses.items()}
        )


class ContactKind(StrEnum):
    """How a manipulator carries an object."""

    TOUCH = "touch"  # kinematic: a fingertip on the surface carries the object
    GRASP = "grasp"  # two fingers close on opposite faces
    PUSH = "push"  # closed fingers push a face, sticking


@dataclass(frozen=True)
class ContactPoint:
    """A 6-D contact: the manipulator frame expressed in the object frame while they touch (the paper's C)."""

    kind: ContactKind
    T_obj_ee: np.ndarray  # (7,)
    point: np.ndarray  # (3,) where it touches, object frame
    normal: np.ndarray  # (3,) outward unit normal there, object frame
    opening: float  # gripper opening while in contact, m
    approach: np.ndarray  # (3,) unit direction of the final approach, end-effector frame
    score: float = 0.0  # higher is handed out first


class SegmentKind(StrEnum):
    """The contact mode of a segment; the same values as :class:`ContactKind`, and the transit."""

    TRANSIT = "transit"  # moves without touching anything
    TOUCH = "touch"
    GRASP = "grasp"
    PUSH = "push"


@dataclass(frozen=True)
class Segment:
    """A stretch of the plan in one contact mode; times in seconds from the start of the plan."""

    start: float
    end: float
    robot: str
    manipulator: str  # the robot's end-effector link, or the name of the held tool
    object: str | None
    kind: SegmentKind
    contact_pose: np.ndarray | None = None  # T_obj_manipulator (7,)


@dataclass(frozen=True)
class Trajectory:
    """Timed samples of everything that moves; linear between samples (rotations along the shortest arc)."""

    time: np.ndarray  # (N,) s, increasing, first 0
    joints: dict[str, np.ndarray]  # robot -> (N, n)
    gripper: dict[str, np.ndarray]  # robot -> (N,) opening, m
    objects: dict[str, np.ndarray]  # movable body -> (N, 7)


@dataclass(frozen=True)
class JointTrajectory:
    """Joint positions and velocities over time.

    Attributes:
        names: n joint names, in any order.
        times: (N,) s from the start, increasing, the first >= 0. Where it is above 0 the joints go from where they are
            told to be to the first point.
        positions: (N, n) rad.
        velocities: (N, n) rad/s, for cubic interpolation; None for straight lines between the points.
    """

    names: tuple[str, ...]
    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray | None = None


@dataclass(frozen=True)
class Plan:
    """A solved task: scene, trajectory, contact modes, waypoints, and how it was found."""

    scene: Scene
    trajectory: Trajectory
    segments: tuple[Segment, ...]
    waypoints: np.ndarray  # (I, 7) poses of the goal's object
    stats: dict  # planning_time_s, contact_tries, mode_switches, waypoint_plans, ...
