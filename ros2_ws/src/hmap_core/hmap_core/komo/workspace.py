"""What does not change between the skeletons of one scene: where things are, and which robots move."""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import Rotation

from hmap_core.collision.convex import ConvexSet, transformed
from hmap_core.exceptions import Code, InputError
from hmap_core.kinematics.arm import Arm, load_arm
from hmap_core.kinematics.model import KinematicModel, PlacedArm
from hmap_core.komo.shapes import body_set
from hmap_core.komo.surroundings import Openings, Surroundings, collect
from hmap_core.transforms import IDENTITY, multiply, multiply_all, pose, rotation_matrix
from hmap_core.types import Scene, SceneState

UPRIGHT = 1.0 - 1e-12  # cosine from which on an object is taken not to lean at all


class Workspace:
    """A scene in a state, with the robots whose joints are the variables; the others stand still.

    Args:
        scene: bodies and robots.
        state: where they are; by default as the scene starts.
        robots: names of those that move, in the order of the variables; by default all.
        shapes: body -> what to take instead of its own shapes, in its frame; say with rounded edges.

    Raises:
        InputError: UNKNOWN_ROBOT.
    """

    def __init__(
        self,
        scene: Scene,
        state: SceneState | None = None,
        robots: Sequence[str] | None = None,
        shapes: Mapping[str, ConvexSet] = MappingProxyType({}),
    ):
        self.scene = scene
        self.shapes = {name: body_set(body) for name, body in scene.bodies.items()} | dict(shapes)
        self.state = state or scene.start_state()
        self.robots = tuple(scene.robots if robots is None else robots)
        for name in self.robots:
            if name not in scene.robots:
                raise InputError(f"no robot '{name}'; there are {', '.join(scene.robots)}", Code.UNKNOWN_ROBOT)
        placed = [(name, scene.robots[name]) for name in self.robots]
        self.model = KinematicModel([PlacedArm(n, load_arm(r.model), r.base_pose) for n, r in placed])
        self._surroundings: dict[tuple, Surroundings] = {}
        self._posed: dict[str, ConvexSet] = {}
        self._tops: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._upright: dict[str, tuple[np.ndarray, float]] = {}
        self._hands = {name: self._hand(name) for name in scene.robots}
        self._leverage = {name: _leverage(placed.arm) for name, placed in self.model.arms.items()}

    @property
    def start(self) -> np.ndarray:
        """Joints (n,) of the moving robots in the state."""
        return np.concatenate([self.state.q[name] for name in self.robots])

    def end_effector(self, robot: str) -> tuple[int, np.ndarray]:
        """The frame that carries a robot's end-effector, and its pose (7,) in there; the world for one that stands."""
        return self._hands[robot]

    def T_world_ee(self, robot: str) -> np.ndarray:
        """Pose (7,) of a robot's end-effector in the state."""
        placed = self.scene.robots[robot]
        return multiply(placed.base_pose, load_arm(placed.model).end_effector(self.state.q[robot]))

    def _hand(self, robot: str) -> tuple[int, np.ndarray]:
        if robot in self.model.arms:
            return self.model.tip(robot), self.model.T_tip_ee(robot)
        return 0, self.T_world_ee(robot)

    def end_effectors(self, robot: str, path: np.ndarray) -> np.ndarray:
        """World poses (M, 7) of a moving robot's end-effector along a path (M, n)."""
        placed, offset = self.model.arms[robot], self.model.offset[robot]
        return multiply_all(placed.T_world_base, placed.arm.end_effectors(path[:, offset : offset + placed.arm.n]))

    def speed(self, robot: str, shapes: ConvexSet) -> float:
        """How much farther than the chain's reach says shapes may move that are given in the frame of a tip."""
        extent = max(math.hypot(*c) + bound for c, bound in zip(shapes.center.tolist(), shapes.bound, strict=True))
        beyond, reach = self._leverage[robot]
        return float(max(1.0, ((beyond + extent) / reach).max(initial=0.0)))

    def surroundings(self, handled: frozenset[str], openings: Openings) -> Surroundings:
        """The moving arms among all but the bodies that are handled; computed once for each set and openings."""
        key = handled, openings
        if key not in self._surroundings:
            around = {name: shapes for name, shapes in self.shapes.items() if name not in handled}
            self._surroundings[key] = collect(self.scene, self.state, self.model, around, openings)
        return self._surroundings[key]

    def posed(self, body: str, T: np.ndarray) -> ConvexSet:
        """A body's shapes seen from a frame in which it has the pose T (7,)."""
        if T is not self.state.poses[body]:
            return transformed(self.shapes[body], T)
        if body not in self._posed:
            self._posed[body] = transformed(self.shapes[body], T)
        return self._posed[body]

    def top(self, support: str) -> tuple[np.ndarray, np.ndarray]:
        """Middle of a body's top as a pose (7,) in its frame, and half extents (2,) of the body there, m."""
        if support not in self._tops:
            self._tops[support] = _top(self.shapes[support])
        return self._tops[support]

    def upright(self, body: str) -> tuple[np.ndarray, float]:
        """A body's frame (7,) with z turned to where up is in the state, and how far below its origin it ends, m."""
        if body not in self._upright:
            up = rotation_matrix(self.state.poses[body])[2]
            self._upright[body] = pose(quaternion=_turn_to(up)), _depth(self.shapes[body], up)
        return self._upright[body]


def _top(shapes: ConvexSet) -> tuple[np.ndarray, np.ndarray]:
    height = (shapes.vertices[:, 2] + np.repeat(shapes.radius, np.diff(shapes.start))).max()
    low, high = shapes.vertices[:, :2].min(0), shapes.vertices[:, :2].max(0)
    return pose((*(low + high) / 2, height)), (high - low) / 2


def _turn_to(up: np.ndarray) -> np.ndarray:
    """Quaternion (4,) that turns z to the direction up (3,)."""
    if up[2] >= UPRIGHT:
        return IDENTITY[3:]
    return Rotation.align_vectors([up], [[0.0, 0.0, 1.0]])[0].as_quat()


def _depth(shapes: ConvexSet, up: np.ndarray) -> float:
    """How far shapes reach below their frame's origin, m."""
    return float((np.repeat(shapes.radius, np.diff(shapes.start)) - shapes.vertices @ up).max())


def _leverage(arm: Arm) -> tuple[np.ndarray, np.ndarray]:
    """Of the turning joints: how far the tip can be from the axis, and how far any link can, m."""
    step = np.linalg.norm(arm.p_joint, axis=1) + arm.stroke
    beyond = np.concatenate([np.cumsum(step[:0:-1])[::-1], [0.0]])
    turning = arm.prismatic == 0
    return beyond[turning], arm.reach()[turning]
