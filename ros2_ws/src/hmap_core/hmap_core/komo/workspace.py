"""What does not change between the skeletons of one scene: the robots that move, and how they keep apart."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hmap_core.collision.convex import ConvexSet, transformed
from hmap_core.collision.scene_model import CollisionModel
from hmap_core.exceptions import Code, InputError
from hmap_core.kinematics.arm import Arm, load_arm
from hmap_core.kinematics.model import KinematicModel, PlacedArm
from hmap_core.komo.manipulation import ROBOT_CLEARANCE, SELF_CLEARANCE, body_set, posed_links
from hmap_core.transforms import apply, multiply, multiply_all
from hmap_core.types import Scene, SceneState


@dataclass(frozen=True)
class ArmShapes:
    """Numbers of a moving arm's shapes in a collision model, its fingers left out.

    Attributes:
        base: of the links that do not move; upper: of those before the last joint; hand: of those after it.
        by_hull: the number of each of the arm's hulls; None for a finger.
    """

    base: tuple[int, ...]
    upper: tuple[int, ...]
    hand: tuple[int, ...]
    by_hull: tuple[int | None, ...]

    @property
    def all(self) -> tuple[int, ...]:
        return self.base + self.upper + self.hand


@dataclass(frozen=True)
class Surroundings:
    """Moving arms without fingers among what stands around.

    Attributes:
        model: their shapes, and the pairs that hold in every phase.
        arms: of each moving robot.
        standing: name of a body, or of a robot that stands still -> its shapes' numbers.
        sets: the same names -> the shapes in the world.
        boxes: (len(sets), 2, 3) lower and upper corners round them in the world, in the order of ``sets``.
    """

    model: CollisionModel
    arms: dict[str, ArmShapes]
    standing: dict[str, list[int]]
    sets: dict[str, ConvexSet]
    boxes: np.ndarray


class Workspace:
    """A scene in a state, with the robots whose joints are the variables; the others stand still.

    Args:
        scene: bodies and robots.
        state: where they are; by default as the scene starts.
        robots: names of those that move, in the order of the variables; by default all.

    Raises:
        InputError: UNKNOWN_ROBOT.
    """

    def __init__(self, scene: Scene, state: SceneState | None = None, robots: Sequence[str] | None = None):
        self.scene = scene
        self.state = state or scene.start_state()
        self.robots = tuple(scene.robots if robots is None else robots)
        for name in self.robots:
            if name not in scene.robots:
                raise InputError(f"no robot '{name}'; there are {', '.join(scene.robots)}", Code.UNKNOWN_ROBOT)
        placed = [(name, scene.robots[name]) for name in self.robots]
        self.model = KinematicModel([PlacedArm(n, load_arm(r.model), r.base_pose) for n, r in placed])
        self._surroundings: dict[frozenset[str], Surroundings] = {}
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

    def surroundings(self, handled: frozenset[str]) -> Surroundings:
        """The moving arms among all but the bodies that are handled; computed once for each set of these."""
        if handled not in self._surroundings:
            self._surroundings[handled] = self._collect(handled)
        return self._surroundings[handled]

    def _collect(self, handled: frozenset[str]) -> Surroundings:
        model = CollisionModel()
        arms = {name: _add_arm(model, self.model, name) for name in self.robots}
        standing, sets = {}, {}
        for name, body in self.scene.bodies.items():
            if name not in handled:
                sets[name] = transformed(body_set(body), self.state.poses[name])
                standing[name] = model.add_set(name, sets[name], 0)
        for name, robot in self.scene.robots.items():
            if name not in self.robots:
                links = posed_links(robot, self.state.q[name], self.state.gripper[name])
                standing[name] = [
                    model.add(f"{name}/{link}", vertices, radius, 0, sphere, edges=edges)
                    for link, vertices, radius, sphere, edges in links
                ]
                sets[name] = hull_set([model.hulls[s] for s in standing[name]])
        around = [s for shapes in standing.values() for s in shapes]
        for k, arm in enumerate(arms.values()):
            model.keep_apart(arm.upper + arm.hand, around, ROBOT_CLEARANCE)
            for other in list(arms.values())[:k]:
                model.keep_apart(arm.upper + arm.hand, other.all, ROBOT_CLEARANCE)
                model.keep_apart(arm.base, other.upper + other.hand, ROBOT_CLEARANCE)
        boxes = [(s.vertices - s.radius.max(), s.vertices + s.radius.max()) for s in sets.values()]
        corners = np.array([(low.min(0), high.max(0)) for low, high in boxes]).reshape(-1, 2, 3)
        return Surroundings(model, arms, standing, sets, corners)


def hull_set(hulls: Sequence[tuple]) -> ConvexSet:
    """The set of hulls given as in a collision model: (vertices (m, 3), radius, centre (3,), bound, edges)."""
    vertices, radius, center, bound, edges = zip(*hulls, strict=True)
    start = np.cumsum([0, *map(len, vertices)], dtype=np.int64)
    return ConvexSet(np.concatenate(vertices), start, np.array(radius), np.array(center), np.array(bound), edges)


def _leverage(arm: Arm) -> tuple[np.ndarray, np.ndarray]:
    """Of the turning joints: how far the tip can be from the axis, and how far any link can, m."""
    step = np.linalg.norm(arm.p_joint, axis=1) + np.where(arm.prismatic, np.ptp(arm.model.position_limits, axis=0), 0.0)
    beyond = np.concatenate([np.cumsum(step[:0:-1])[::-1], [0.0]])
    turning = arm.prismatic == 0
    return beyond[turning], arm.reach()[turning]


def _add_arm(model: CollisionModel, chain: KinematicModel, name: str) -> ArmShapes:
    """Adds the links of a moving arm and the pairs of them that keep apart."""
    placed = chain.arms[name]
    parts: dict[str, list[int]] = {"base": [], "upper": [], "hand": []}
    by_hull: list[int | None] = []
    for hull in placed.arm.hulls:
        if hull.finger:
            by_hull.append(None)
            continue
        vertices, (center, bound) = hull.at(0.0), hull.sphere
        if hull.frame == 0:
            vertices, center = apply(placed.T_world_base, vertices), apply(placed.T_world_base, center)
        frame = chain.frame(name, hull.frame)
        sphere = center, bound
        number = model.add(f"{name}/{hull.link}", vertices, hull.radius, frame, sphere, edges=hull.edges)
        parts["base" if hull.frame == 0 else "hand" if hull.frame == placed.arm.n else "upper"].append(number)
        by_hull.append(number)
    for i, j in placed.arm.self_pairs:
        if by_hull[i] is not None and by_hull[j] is not None:
            model.keep_apart([by_hull[i]], [by_hull[j]], SELF_CLEARANCE)
    return ArmShapes(tuple(parts["base"]), tuple(parts["upper"]), tuple(parts["hand"]), tuple(by_hull))
