"""What does not change between the skeletons of one scene: where things are, and which robots move."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import numpy as np

from hmap_core.collision.convex import ConvexSet
from hmap_core.exceptions import Code, InputError
from hmap_core.kinematics.arm import Arm, load_arm
from hmap_core.kinematics.model import KinematicModel, PlacedArm
from hmap_core.komo.shapes import body_set
from hmap_core.komo.surroundings import Openings, Surroundings, collect
from hmap_core.transforms import multiply, multiply_all
from hmap_core.types import Scene, SceneState


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

    def speed(self, robot: str, extent: float) -> float:
        """How much farther than the chain's reach says something may move that sticks out of a tip by extent (m)."""
        beyond, reach = self._leverage[robot]
        return float(max(1.0, ((beyond + extent) / reach).max(initial=0.0)))

    def surroundings(self, handled: frozenset[str], openings: Openings) -> Surroundings:
        """The moving arms among all but the bodies that are handled; computed once for each set and openings."""
        key = handled, openings
        if key not in self._surroundings:
            around = {name: shapes for name, shapes in self.shapes.items() if name not in handled}
            self._surroundings[key] = collect(self.scene, self.state, self.model, around, openings)
        return self._surroundings[key]


def _leverage(arm: Arm) -> tuple[np.ndarray, np.ndarray]:
    """Of the turning joints: how far the tip can be from the axis, and how far any link can, m."""
    step = np.linalg.norm(arm.p_joint, axis=1) + np.where(arm.prismatic, np.ptp(arm.model.position_limits, axis=0), 0.0)
    beyond = np.concatenate([np.cumsum(step[:0:-1])[::-1], [0.0]])
    turning = arm.prismatic == 0
    return beyond[turning], arm.reach()[turning]
