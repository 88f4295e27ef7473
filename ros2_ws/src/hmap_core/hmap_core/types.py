"""The data types that the modules of hmap exchange: SI units, world frame, poses as in :mod:`hmap_core.transforms`."""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from pathlib import Path

import numpy as np

from hmap_core.transforms import IDENTITY

# m, rad: default distance of an object from its goal pose that counts as reached after execution
DEFAULT_EXECUTION_TOLERANCE = (0.02, float(np.deg2rad(10.0)))
GRIPPER_SPEED = 0.1  # m/s, default rate of change of the opening
# What is measured, or recorded from a measurement, may be beyond a limit by so much: it then counts as on the limit.
JOINT_TOLERANCE = 0.01  # rad, or m for sliding joints; as much as controllers accept at a goal
OPENING_TOLERANCE = 0.002  # m of a gripper's opening


class ShapeKind(StrEnum):
    """Kinds of convex shape. A mesh stands for its convex hull; a concave body consists of several shapes."""

    BOX = "box"  # size: full extents x, y, z
    CYLINDER = "cylinder"  # size: radius, height; axis z
    SPHERE = "sphere"  # size: radius
    CAPSULE = "capsule"  # size: radius, height of the cylindrical part; axis z
    MESH = "mesh"  # size: scale x, y, z; the file in ``mesh``


@dataclass(frozen=True)
class Shape:
    """A convex shape of a body, with its pose ``T_body_shape`` (7,) and, for a mesh, its file."""

    kind: ShapeKind
    size: tuple[float, ...]
    pose: np.ndarray = field(default_factory=lambda: IDENTITY)  # T_body_shape (7,)
    mesh: Path | None = None  # file of a mesh; None for the other kinds


class BodyKind(StrEnum):
    """Whether a body may move, and whether it may serve as a manipulator."""

    FIXED = "fixed"  # never moves
    MOVABLE = "movable"  # may be moved by contact
    TOOL = "tool"  # movable; may be attached to a robot and used as a manipulator


class TaskMode(StrEnum):
    """Contact model of a task.

    KINEMATIC: a touching fingertip carries the object in any direction (the paper's stable constraint).
    PHYSICAL: friction, gripper opening and geometry limit what a contact can do; plans are executed under dynamics.
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
    """A two-finger gripper. Its ``opening`` is the gap between the finger pads in metres, as in GripperCommand.

    Joint i has the value ``at_zero[i] + travel * per_joint[i]``. For sliding fingers, travel is the opening. For
    rotating fingers, travel runs from 0 (closed) to 1 (open); ``openings`` tabulates the gap over travel, linearly
    interpolated.

    Attributes:
        joint_names: the k driven joints; further joints may follow them by ``mimic`` elements of the URDF.
        per_joint, at_zero: one number for each joint, or one for all; rad or m.
        finger_links: the links that touch objects.
        min_opening, max_opening: m, usable range for grasping.
        open_opening: m, commanded to open fully.
        tip_offset: m, from the end-effector frame to the end of the closed fingers, along the approach axis.
        pad_half_width: m, half extent of a pad across the closing and approach axes.
        force: N, closing force of a grasp.
        openings: (M,) m, increasing, at travels spaced evenly from 0 to 1; empty if travel is the opening.
        tips: (M,) m, extra length of the fingers along the approach axis compared to closed; empty if it is zero.
        speed: m/s, largest rate of change of the opening.
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
        """Values (k,) of the driven joints (rad or m) at an opening in metres."""
        travel = float(np.interp(opening, self.openings, self._travels)) if self.openings else opening
        return tuple(start + travel * slope for start, slope in self._each)

    def opening_at(self, joints: Sequence[float]) -> float:
        """Opening in metres at values (k,) of the driven joints (rad or m)."""
        shares = [(joint - start) / slope for joint, (start, slope) in zip(joints, self._each, strict=True)]
        travel = sum(shares) / len(shares)
        return float(np.interp(travel, self._travels, self.openings)) if self.openings else float(travel)

    def joints_per_opening(self, opening: float) -> tuple[float, ...]:
        """Derivative of the driven joints with respect to the opening.

        Args:
            opening: m, where the derivative is evaluated.

        Returns:
            (k,) rad or m of joint motion per metre of opening.
        """
        travel = 1.0
        if self.openings:
            step = min(max(bisect_left(self.openings, opening), 1), len(self.openings) - 1)
            travel = float(self._travels[1]) / (self.openings[step] - self.openings[step - 1])
        return tuple(travel * slope for _, slope in self._each)

    def reach_at(self, opening: float) -> float:
        """Extra length in metres of the fingers along the approach axis at an opening (m), compared to closed."""
        return float(np.interp(opening, self.openings, self.tips)) if self.tips else 0.0

    @cached_property
    def _each(self) -> tuple[tuple[float, float], ...]:
        """``at_zero`` and ``per_joint`` of each joint."""
        k = len(self.joint_names)
        starts, slopes = (np.broadcast_to(values, k).tolist() for values in (self.at_zero, self.per_joint))
        return tuple(zip(starts, slopes, strict=True))

    @cached_property
    def _travels(self) -> np.ndarray:
        return np.linspace(0.0, 1.0, len(self.openings))


@dataclass(frozen=True)
class AttachedBody:
    """A body that is attached to a robot's end effector and moves with it, such as a tool in use.

    Compare ``moveit_msgs/AttachedCollisionObject``.

    Attributes:
        name: of the body.
        shapes: its shapes, in the body frame.
        T_ee_body: (7,) pose of the body in the end-effector frame.
        opening: m, gripper opening while it is attached.
        friction: its lateral Coulomb coefficient.
        up: (3,) vertical unit vector, in the body frame, at the pose in which the body was picked.
        mass: kg.
    """

    name: str
    shapes: tuple[Shape, ...]
    T_ee_body: np.ndarray
    opening: float
    friction: float
    up: np.ndarray
    mass: float = 0.0


@dataclass(frozen=True)
class RobotModel:
    """A serial arm: its URDF and the properties that a URDF lacks.

    The end-effector frame has its z axis along the approach direction and its y axis along the closing direction of the
    gripper; its origin lies midway between the finger pads (or at the tip of an arm without gripper).
    """

    name: str
    urdf: Path  # path of the file on this machine
    urdf_uri: str  # portable URI of it: "pybullet_data://franka_panda/panda.urdf" or "hmap_scenes://robots/x.urdf"
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
    attached: AttachedBody | None = None  # the attached tool, which occupies the gripper
    payload: float | None = None  # kg that the arm may carry; None: not known, and not checked

    def require_gripper(self) -> Gripper:
        """The gripper of a robot that must have one.

        Raises:
            ValueError: the robot has none.
        """
        if self.gripper is None:
            raise ValueError(f"robot model '{self.name}' has no gripper")
        return self.gripper


@dataclass(frozen=True)
class Robot:
    """A robot model at a pose in the scene."""

    name: str
    model: RobotModel
    base_pose: np.ndarray  # T_world_base (7,)
    q: np.ndarray  # (n,) start configuration


@dataclass(frozen=True)
class Goal:
    """Goal pose of an object, with tolerances."""

    object: str
    pose: np.ndarray  # T_world_obj (7,)
    position_tolerance: float = 0.005  # m
    rotation_tolerance: float = float(np.deg2rad(2.0))  # rad


@dataclass(frozen=True)
class Camera:
    """A pinhole camera. Its frame is the optical frame (x right, y down, z forward)."""

    name: str
    pose: np.ndarray  # T_world_optical (7,)
    width: int = 640
    height: int = 480
    fov_y: float = float(np.deg2rad(42.0))


@dataclass(frozen=True)
class Scene:
    """A task after randomisation: the common input of the planner, the judge and the simulation.

    Attributes:
        task: name of the task.
        seed: seed of the randomisation.
        mode: contact model.
        bodies, robots, cameras: by name.
        goal: the object to move and its goal pose.
        motion: freedom of the goal's object: ``planar`` (SE(2) on its support), ``spatial`` (SE(3)), or ``auto``
            (decided from start and goal).
        removable: movable bodies that the planner may move out of the way, each with its removal pose ``T_world_body``
            (7,), or None if the planner chooses the pose.
        execution_tolerance: m and rad, distance of the object from its goal that counts as reached after execution; by
            default DEFAULT_EXECUTION_TOLERANCE, or the goal's tolerance if larger.
    """

    task: str
    seed: int
    mode: TaskMode
    bodies: dict[str, Body]
    robots: dict[str, Robot]
    cameras: dict[str, Camera]
    goal: Goal
    motion: str = "auto"
    removable: dict[str, np.ndarray | None] = field(default_factory=dict)
    execution_tolerance: tuple[float, float] = DEFAULT_EXECUTION_TOLERANCE

    def with_goal(self, goal: Goal) -> "Scene":
        """A copy of the scene with another goal."""
        return replace(self, goal=goal)

    def start_state(self) -> "SceneState":
        """The start state: robots at their start configurations, grippers fully open (0 for robots without gripper)."""
        return SceneState(
            q={name: robot.q.copy() for name, robot in self.robots.items()},
            gripper={n: r.model.gripper.open_opening if r.model.gripper else 0.0 for n, r in self.robots.items()},
            poses={name: body.pose.copy() for name, body in self.bodies.items()},
        )


@dataclass
class SceneState:
    """Robot configurations, gripper openings and body poses at one instant (the paper's configuration X)."""

    q: dict[str, np.ndarray]  # robot -> (n,)
    gripper: dict[str, float]  # robot -> opening in metres
    poses: dict[str, np.ndarray]  # body -> T_world_body (7,)

    def copy(self) -> "SceneState":
        """A deep copy of the state."""
        return SceneState(
            {k: v.copy() for k, v in self.q.items()}, dict(self.gripper), {k: v.copy() for k, v in self.poses.items()}
        )


class ContactKind(StrEnum):
    """How a manipulator moves an object."""

    TOUCH = "touch"  # kinematic mode: a fingertip on the surface carries the object
    GRASP = "grasp"  # two fingers close on opposite faces
    PUSH = "push"  # closed fingers push a face with sticking contact
    PRESS = "press"  # fingertips press on the top of an object that slides on its support


@dataclass(frozen=True)
class ContactPoint:
    """A 6-D contact: the pose of the manipulator frame in the object frame during contact (the paper's C)."""

    kind: ContactKind
    T_obj_ee: np.ndarray  # (7,)
    point: np.ndarray  # (3,) contact position, object frame
    normal: np.ndarray  # (3,) outward unit normal at that position, object frame
    opening: float  # gripper opening while in contact, m
    approach: np.ndarray  # (3,) unit direction of the final approach, end-effector frame
    score: float = 0.0  # contacts with higher scores are tried first
    force: float = 0.0  # N with which a press presses along its approach; 0 for other kinds


class SegmentKind(StrEnum):
    """Contact mode of a segment: a :class:`ContactKind`, or transit."""

    TRANSIT = "transit"  # free motion without contact
    TOUCH = "touch"
    GRASP = "grasp"
    PUSH = "push"
    PRESS = "press"


@dataclass(frozen=True)
class Segment:
    """An interval of the plan with one contact mode; times in seconds from the start of the plan."""

    start: float
    end: float
    robot: str
    manipulator: str  # the robot's end-effector link, or the name of the attached tool
    object: str | None  # the object in contact; None in transit
    kind: SegmentKind
    contact_pose: np.ndarray | None = None  # T_obj_manipulator (7,)
    force: float | None = None  # N with which a press presses downwards; None for other kinds

    @property
    def contact_object(self) -> str:
        """The object in contact.

        Raises:
            ValueError: the segment is a transit.
        """
        if self.object is None:
            raise ValueError(f"the {self.kind} segment of '{self.robot}' at {self.start:.3f} s has no object")
        return self.object

    @property
    def T_obj_manipulator(self) -> np.ndarray:
        """The contact pose (7,) of a segment with contact.

        Raises:
            ValueError: the segment is a transit.
        """
        if self.contact_pose is None:
            raise ValueError(f"the {self.kind} segment of '{self.robot}' at {self.start:.3f} s has no contact pose")
        return self.contact_pose


@dataclass(frozen=True)
class Trajectory:
    """Timed samples of all robots and movable bodies; linear between samples (rotations along the shortest arc)."""

    time: np.ndarray  # (N,) s, increasing, first 0
    joints: dict[str, np.ndarray]  # robot -> (N, n)
    gripper: dict[str, np.ndarray]  # robot -> (N,) opening, m
    objects: dict[str, np.ndarray]  # movable body -> (N, 7)


@dataclass(frozen=True)
class JointTrajectory:
    """Joint positions and velocities over time.

    Attributes:
        names: n joint names, in any order.
        times: (N,) s from the start, increasing, the first >= 0. If it is above 0, the joints first move from their
            commanded positions to the first point.
        positions: (N, n) rad.
        velocities: (N, n) rad/s, for cubic interpolation; None for linear interpolation.
        efforts: (N, n) N m or N that the joints apply beside those that follow the motion, as to press on something;
            linear between the points. None: none.
    """

    names: tuple[str, ...]
    times: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray | None = None
    efforts: np.ndarray | None = None

    def require_velocities(self) -> np.ndarray:
        """The velocities (N, n) of a motion that must have them.

        Raises:
            ValueError: the motion has none.
        """
        if self.velocities is None:
            raise ValueError(f"the motion of {', '.join(self.names)} has no velocities")
        return self.velocities


@dataclass(frozen=True)
class Plan:
    """A solution of a task: scene, trajectory, segments with their contact modes, waypoints and statistics."""

    scene: Scene
    trajectory: Trajectory
    segments: tuple[Segment, ...]
    waypoints: np.ndarray  # (I, 7) T_world_obj of the goal's object
    stats: dict  # planning_time_s, contact_tries, mode_switches, waypoint_plans, ...
