"""Moving arms among what stands around: the part of a skeleton's collision model that its objects do not change."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hmap_core.collision.convex import ConvexSet, from_hulls, sets_nearest, transformed
from hmap_core.collision.grown import BaseModel
from hmap_core.collision.scene_model import ALL_PHASES, CollisionModel
from hmap_core.kinematics.model import KinematicModel
from hmap_core.komo.min_distances import ROBOT_CLEARANCE, SELF_CLEARANCE
from hmap_core.komo.shapes import posed_links
from hmap_core.transforms import apply
from hmap_core.types import Robot, Scene, SceneState

# what is farther than this beyond the reach of a link is no pair with it, m: no clearance, detection distance and
# look-ahead together are as much
BEYOND_REACH = 0.2

# The openings of the moving robots' grippers: robot, then each opening (m) with the bit mask of its phases.
Openings = tuple[tuple[str, tuple[tuple[float, int], ...]], ...]


@dataclass(frozen=True)
class Part:
    """A part of a hand: its shapes' numbers, the shapes in the tip frame, the bit mask of the phases it is so in."""

    shapes: tuple[int, ...]
    set: ConvexSet
    phases: int


@dataclass(frozen=True)
class ArmShapes:
    """Numbers of a moving arm's shapes in a collision model, its fingers and their linkage left out.

    Attributes:
        base: of the links that do not move; upper: of those before the last joint; hand: of those after it.
        hand_set: the hand's shapes in the tip frame.
        by_hull: the number of each of the arm's hulls; None for a finger, and for what moves with the gripper.
    """

    base: tuple[int, ...]
    upper: tuple[int, ...]
    hand: tuple[int, ...]
    hand_set: ConvexSet
    by_hull: tuple[int | None, ...]

    @property
    def all(self) -> tuple[int, ...]:
        """Indices of all shapes of the arm."""
        return self.base + self.upper + self.hand


@dataclass(frozen=True)
class Surroundings:
    """Moving arms among what stands around.

    Attributes:
        model: their shapes, and the pairs that hold in every phase.
        arms: of each moving robot.
        fingers: of each moving robot, once for each opening.
        linkages: likewise, of each moving robot what else moves with its gripper.
        standing: name of a body, or of a robot that stands still -> its shapes' numbers.
        shapes: all these shapes in the world.
        owner: (len(shapes),) whose each is, by the order of ``standing``.
    """

    model: BaseModel
    arms: dict[str, ArmShapes]
    fingers: dict[str, tuple[Part, ...]]
    linkages: dict[str, tuple[Part, ...]]
    standing: dict[str, list[int]]
    shapes: ConvexSet
    owner: np.ndarray

    def nearest(self, body: ConvexSet, places: Sequence[np.ndarray], cutoff: float) -> dict[str, float]:
        """How near a body comes in some places (7,) to what stands around, m; only what is nearer than the cutoff."""
        A, B, best = body, self.shapes, np.full(len(self.standing), cutoff)
        if places:
            sets_nearest(
                A.vertices, A.start, A.radius, A.center, A.bound, np.array(places),
                B.vertices, B.start, B.radius, B.center, B.bound, self.owner, best,
            )  # fmt: skip
        return {name: d for name, d in zip(self.standing, best.tolist(), strict=True) if d < cutoff}


def collect(
    scene: Scene, state: SceneState, chain: KinematicModel, bodies: Mapping[str, ConvexSet], openings: Openings
) -> Surroundings:
    """The arms of a chain among bodies, given by their shapes, and the robots that stand still."""
    model = BaseModel()
    arms = {name: _add_arm(model, chain, name) for name in chain.arms}
    standing = {name: model.add_set(name, transformed(shapes, state.poses[name]), 0) for name, shapes in bodies.items()}
    for name, robot in scene.robots.items():
        if name not in chain.arms:
            standing[name] = [
                model.add(f"{name}/{link}", vertices, radius, 0, sphere, edges=edges)
                for link, vertices, radius, sphere, edges in posed_links(robot, state.q[name], state.gripper[name])
            ]
    around = [s for shapes in standing.values() for s in shapes]
    grippers: dict[str, tuple[Part, ...]] = {}
    fingers, linkages = {}, {}
    for name, variants in openings:
        fingers[name], linkages[name] = _add_gripper(model, chain, name, arms[name], variants)
        arm, parts = arms[name], fingers[name] + linkages[name]
        for phases, shapes in ((ALL_PHASES, arm.upper + arm.hand), *((part.phases, part.shapes) for part in parts)):
            for shape, near in zip(shapes, _within_reach(model, chain, name, shapes, around), strict=True):
                model.keep_apart([shape], near, ROBOT_CLEARANCE, phases)
        for other, others in grippers.items():
            _keep_robots_apart(model, arm, parts, arms[other], others)
        grippers[name] = parts
    owner = np.repeat(np.arange(len(standing)), [len(shapes) for shapes in standing.values()])
    return Surroundings(model, arms, fingers, linkages, standing, hull_set([model.hulls[s] for s in around]), owner)


def _within_reach(
    model: CollisionModel, chain: KinematicModel, name: str, shapes: Sequence[int], around: Sequence[int]
) -> list[list[int]]:
    """For each of some shapes of an arm those of ``around`` that it can come near, wherever the joints are."""
    if not around or not shapes:
        return [[] for _ in shapes]
    placed = chain.arms[name]
    arm = placed.arm
    step = np.linalg.norm(arm.p_joint, axis=1) + arm.stroke
    step[0] -= np.linalg.norm(arm.p_joint[0])  # measured from the origin of the first joint
    to_frame = np.concatenate([[0.0], np.cumsum(step)])  # bound (n + 1,) on the distance of each frame's origin
    first = apply(placed.T_world_base, arm.p_joint[0])
    centers = np.array([model.hulls[s][2] for s in around])
    away = np.linalg.norm(centers - first, axis=1) - np.array([model.hulls[s][3] for s in around])
    numbers, offset = np.array(around), chain.frame(name, 1) - 1
    near = []
    for s in shapes:
        _, _, center, bound, _ = model.hulls[s]
        reach = to_frame[model.frames[s] - offset] + float(np.linalg.norm(center)) + bound
        near.append(numbers[away <= reach + BEYOND_REACH].tolist())
    return near


def _keep_robots_apart(
    model: CollisionModel, a: ArmShapes, fingers_a: Sequence[Part], b: ArmShapes, fingers_b: Sequence[Part]
) -> None:
    model.keep_apart(a.upper + a.hand, b.all, ROBOT_CLEARANCE)
    model.keep_apart(a.base, b.upper + b.hand, ROBOT_CLEARANCE)
    for part in fingers_a:
        model.keep_apart(part.shapes, b.all, ROBOT_CLEARANCE, part.phases)
        for other in fingers_b:
            if part.phases & other.phases:
                model.keep_apart(part.shapes, other.shapes, ROBOT_CLEARANCE, part.phases & other.phases)
    for part in fingers_b:
        model.keep_apart(part.shapes, a.all, ROBOT_CLEARANCE, part.phases)


def hull_set(hulls: Sequence[tuple]) -> ConvexSet:
    """The set of hulls given as in a collision model: (vertices (m, 3), radius, centre (3,), bound, edges)."""
    if not hulls:
        return from_hulls(())
    vertices, radius, center, bound, edges = zip(*hulls, strict=True)
    start = np.cumsum([0, *map(len, vertices)], dtype=np.int64)
    return ConvexSet(np.concatenate(vertices), start, np.array(radius), np.array(center), np.array(bound), edges)


def robot_set(robot: Robot, q: np.ndarray, opening: float) -> ConvexSet:
    """The links of a robot that stands at q (n,), in the world."""
    hulls = posed_links(robot, q, opening)
    return hull_set([(vertices, radius, *sphere, edges) for _, vertices, radius, sphere, edges in hulls])


def _add_arm(model: CollisionModel, chain: KinematicModel, name: str) -> ArmShapes:
    """Adds the links of a moving arm and the pairs of them that keep apart."""
    placed = chain.arms[name]
    parts: dict[str, list[int]] = {"base": [], "upper": [], "hand": []}
    by_hull: list[int | None] = []
    for hull in placed.arm.hulls:
        if hull.finger or hull.motion is not None:
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
    base, upper, hand = (tuple(part) for part in parts.values())
    return ArmShapes(base, upper, hand, hull_set([model.hulls[s] for s in hand]), tuple(by_hull))


def _add_gripper(
    model: CollisionModel, chain: KinematicModel, name: str, shapes: ArmShapes, openings: Sequence[tuple[float, int]]
) -> tuple[tuple[Part, ...], tuple[Part, ...]]:
    """Adds fingers and linkage of a moving arm once for each opening, and their pairs that keep apart."""
    arm = chain.arms[name].arm
    hulls = [i for i, number in enumerate(shapes.by_hull) if number is None]
    fingers: list[Part] = []
    linkage: list[Part] = []
    for opening, phases in openings if hulls else ():
        own = {}
        for i in hulls:
            h = arm.hulls[i]
            sphere = h.sphere_at(opening)
            own[i] = model.add(f"{name}/{h.link}", h.at(opening), h.radius, chain.tip(name), sphere, edges=h.edges)
        for i, j in arm.self_pairs:
            if i in own or j in own:
                a, b = (own.get(h, shapes.by_hull[h]) for h in (i, j))
                model.keep_apart([a], [b], SELF_CLEARANCE, phases)
        for kind, touches in ((fingers, True), (linkage, False)):
            numbers = tuple(number for i, number in own.items() if arm.hulls[i].finger == touches)
            if numbers:
                kind.append(Part(numbers, hull_set([model.hulls[s] for s in numbers]), phases))
    return tuple(fingers), tuple(linkage)
