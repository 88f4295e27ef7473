"""Where a body can be put so that it is out of the way: stable, free, clear of where others will pass, near."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from hmap_core.collision.convex import ConvexSet, transformed
from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.shapes import body_set
from hmap_core.komo.surroundings import robot_set
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.planner.sweep import Sweep, joined, nearest, placed
from hmap_core.stability.mass import centre_of_mass
from hmap_core.stability.stacks import stack_tips
from hmap_core.transforms import IDENTITY, apply, from_rpy, multiply, rotation_matrix
from hmap_core.types import BodyKind, Scene, SceneState, TaskMode
from hmap_core.waypoints import stable_poses
from hmap_core.waypoints.support import FACE_TOLERANCE, feet

SAMPLES = 256  # placements sampled on each face
SEARCH_RADIUS = 0.8  # m from the present position of the body
REACH_SHARE = 0.8  # of the bound on an arm's reach, the largest distance of a placement
COMFORT_SHARE = 0.55  # of it, beyond which an arm is stretched out
STRETCH_WEIGHT = 2.0  # cost (m of distance) of a metre beyond that
MIN_SPACE = 0.01  # m, free space around the body
ROOM = 0.10  # m, room for a hand beside the body; less room has a cost
ROOM_WEIGHT = 3.0  # cost (m of distance) of a missing metre of room, or of a metre of overhang over an edge
STEADY = 0.01  # m, the centre of mass farther inside the face than this is steady
STEADY_WEIGHT = 100.0  # cost (m of distance) of a missing metre of that
TURN_COST = 0.1  # cost (m of distance) of a rotation by a right angle
APART = 0.06  # m between two places on offer
PER_GROUP = 4  # places of one sort on offer
YAWS = (0.0, np.pi / 2)  # rad, turns about the vertical that are tried
_FIXED_FIRST = (True, False)


@dataclass(frozen=True)
class Face:
    """A level face on which something can stand: its polygon (n, 2), counter-clockwise, at a height in metres."""

    owner: str
    polygon: np.ndarray
    height: float


def level_faces(scene: Scene, state: SceneState, without: frozenset[str]) -> list[Face]:
    """The flat tops of all shapes of all bodies but some."""
    found = []
    for name, body in scene.bodies.items():
        shapes = body_set(body)
        for s in range(len(shapes)) if name not in without else ():
            points = apply(state.poses[name], shapes.hull(s))
            height = float(points[:, 2].max())
            top = points[points[:, 2] >= height - FACE_TOLERANCE, :2]
            if shapes.radius[s] == 0.0 and len(top) >= 3:
                try:
                    found.append(Face(name, top[ConvexHull(top).vertices], height))
                except QhullError:  # an edge
                    continue
    return found


def given_place(scene: Scene, name: str, keep_out: Sequence[Sweep]) -> list[np.ndarray]:
    """The pose (7,) that the task gives for a body; none where there is none, or where something will pass."""
    T = scene.removable.get(name)
    if T is None or nearest(keep_out, {name: transformed(body_set(scene.bodies[name]), T)}, 0.0):
        return []
    return [T]


def placements_of(
    scene: Scene,
    state: SceneState,
    name: str,
    keep_out: Sequence[Sweep],
    unsteady: frozenset[str],
    rng: np.random.Generator,
) -> Iterator[np.ndarray]:
    """Poses (7,) at which a body is out of the way, the best first.

    They are places on what carries the body now, then on fixed bodies, then on movable ones; each first as the
    body is turned now and then turned by a right angle. Nearer ones come first, those with room for a hand round them
    before. Places from which the body could fall over an edge come after all others.

    Args:
        keep_out: where something will pass.
        unsteady: bodies on which nothing may be put, as they will move.
    """
    search = PlaceSearch(scene, state, name, tuple(keep_out), rng)
    faces = level_faces(scene, state, unsteady | {name})
    here = [f for f in faces if search.stands_on(f)]
    others = [f for f in faces if not search.stands_on(f)]
    sorts = [here]
    for fixed in _FIXED_FIRST:
        sorts.append([f for f in others if (scene.bodies[f.owner].kind == BodyKind.FIXED) == fixed])
    unsafe = []
    for sort in sorts:
        for yaw in YAWS:
            for T, steady in search.best(sort, yaw):
                if steady:
                    yield T
                else:
                    unsafe.append(T)
    yield from unsafe


class PlaceSearch:
    """Candidates for one body's place, filtered and ranked."""

    def __init__(self, scene: Scene, state: SceneState, name: str, keep_out: tuple[Sweep, ...], rng):
        self.scene, self.state, self.name, self.keep_out = scene, state, name, keep_out
        self.T = state.poses[name]
        self.shapes = body_set(scene.bodies[name])
        self.unit = _halton(SAMPLES, rng)
        self.others = placed(scene, state, [other for other in scene.bodies if other != name])
        self.standing_bodies = placed_bodies(scene, state, name)
        self.robots = joined([robot_set(r, state.q[robot], state.gripper[robot]) for robot, r in scene.robots.items()])
        arms = [(r, load_arm(r.model)) for r in scene.robots.values()]
        self.shoulders = np.array([apply(r.base_pose, arm.p_joint[0]) for r, arm in arms]).reshape(-1, 3)
        self.reach = np.array([arm.length for _, arm in arms])
        self.lowest = feet(self.shapes, rotation_matrix(self.T))[1] + float(self.T[2])

    def stands_on(self, face: Face) -> bool:
        """Whether the body is at the height of a face, and over it."""
        x, y = self.T[:2]
        return abs(face.height - self.lowest) <= FACE_TOLERANCE and inside(face.polygon, np.array([[x, y]]))[0] >= 0.0

    def clear_of_ways(self, T: np.ndarray) -> float:
        """Distance in metres from where others will pass, at most ROOM."""
        return nearest(self.keep_out, {self.name: transformed(self.shapes, T)}, ROOM).get(self.name, ROOM)

    def best(self, faces: Sequence[Face], yaw: float) -> list[tuple[np.ndarray, bool]]:
        """Up to PER_GROUP poses (7,) on some faces with the body turned by ``yaw`` from now, and whether it is steady.

        The best come first.
        """
        ranked = sorted((c for face in faces for c in self._on(face, yaw)), key=lambda c: c[0])
        chosen: list[tuple[np.ndarray, bool]] = []
        for _, T, steady in ranked:
            if all(np.linalg.norm(T[:3] - other[:3]) >= APART for other, _ in chosen) and not self._tips(T):
                chosen.append((T, steady))
            if len(chosen) == PER_GROUP:
                break
        return chosen

    def _tips(self, T: np.ndarray) -> bool:
        """Whether the body would make a stack tip at a pose T (7,)."""
        bodies = {body.name: body for body in self.standing_bodies} | {self.name: self.scene.bodies[self.name]}
        return self.scene.mode == TaskMode.PHYSICAL and bool(stack_tips(bodies, self.name, T))

    def _on(self, face: Face, yaw: float) -> list[tuple[float, np.ndarray, bool]]:
        """(cost in metres, pose, whether the body is steady there) of all free places on a face."""
        turn = from_rpy((0, 0, 0), (0, 0, yaw))
        turned = multiply(turn, np.r_[0.0, 0.0, 0.0, self.T[3:]])
        height = face.height - feet(self.shapes, rotation_matrix(turned))[1]
        xy = self.samples(face)
        xy = xy[inside(face.polygon, xy) >= 0.0]
        positions = np.column_stack([xy, np.full(len(xy), height)])
        positions = positions[self.stretch(positions, REACH_SHARE) <= 0.0]
        if not len(positions):
            return []
        poses = np.column_stack([positions, np.tile(turned[3:], (len(positions), 1))])
        holds = stable_poses(self.scene.bodies[self.name], np.vstack([self.T, poses]), self.standing_bodies)[1:]
        around = self.above(face.height)
        half = 0.5 * np.ptp(self.shapes.vertices @ rotation_matrix(turned).T, axis=0)[:2].min()  # as far over the edge
        poses = poses[holds]
        edge = np.maximum(0.0, half - inside(face.polygon, poses[:, :2]))
        cost = np.linalg.norm(poses[:, :3] - self.T[:3], axis=1) + (TURN_COST if yaw else 0.0)
        cost += STRETCH_WEIGHT * np.maximum(0.0, self.stretch(poses[:, :3], COMFORT_SHARE)) + ROOM_WEIGHT * edge
        centre = rotation_matrix(turned) @ centre_of_mass(self.shapes)
        missing = np.maximum(0.0, STEADY - inside(face.polygon, poses[:, :2] + centre[:2]))
        cost += STEADY_WEIGHT * missing
        found = []
        for T, way, steady in zip(poses, cost, (missing == 0.0).tolist(), strict=True):
            body = {self.name: transformed(self.shapes, T)}
            space = nearest([around], body, ROOM).get(self.name, ROOM)
            room = self.clear_of_ways(T) if space >= MIN_SPACE else 0.0
            if room >= MIN_SPACE:
                found.append((way + ROOM_WEIGHT * (2.0 * ROOM - space - room), T, steady))
        return found

    def samples(self, face: Face) -> np.ndarray:
        """Positions (M, 2): half of them round where the body is, denser there, half of them all over the face."""
        half = len(self.unit) // 2
        angle = 2.0 * np.pi * self.unit[:half, 0]
        ring = self.T[:2] + SEARCH_RADIUS * self.unit[:half, 1, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        low, high = face.polygon.min(axis=0), face.polygon.max(axis=0)
        return np.concatenate([ring, low + self.unit[half:] * (high - low)])

    def stretch(self, positions: np.ndarray, share: float) -> np.ndarray:
        """How far (M,) in metres positions (M, 3) are beyond a share of the reach of the robot that reaches best."""
        far = np.linalg.norm(positions[:, None] - self.shoulders, axis=2)
        return (far - share * self.reach).min(axis=1)

    def above(self, height: float) -> Sweep:
        """The robots, and of the other bodies the shapes that rise above a height."""
        kept = []
        for shapes in self.others.values():
            for s in range(len(shapes)):
                if shapes.hull(s)[:, 2].max() + shapes.radius[s] > height + FACE_TOLERANCE:
                    kept.append(_only(shapes, s))
        return Sweep(joined([*kept, self.robots]), IDENTITY[None])


def _only(shapes: ConvexSet, s: int) -> ConvexSet:
    one = slice(s, s + 1)
    hull = shapes.hull(s)
    start = np.array([0, len(hull)], np.int64)
    return ConvexSet(hull, start, shapes.radius[one], shapes.center[one], shapes.bound[one], shapes.edges[one])


def inside(polygon: np.ndarray, points: np.ndarray) -> np.ndarray:
    """How far (M,) in metres points (M, 2) lie inside a convex counter-clockwise polygon (n, 2); negative outside."""
    edge = np.roll(polygon, -1, axis=0) - polygon
    edge = edge / np.linalg.norm(edge, axis=1, keepdims=True)
    to = points[:, None] - polygon
    return (edge[:, 0] * to[:, :, 1] - edge[:, 1] * to[:, :, 0]).min(axis=1)


def _halton(count: int, rng: np.random.Generator) -> np.ndarray:
    """Points (count, 2) of Halton's sequence in the unit square, moved by a random shift (Cranley & Patterson 1976)."""
    columns = [[_radical_inverse(k, base) for k in range(1, count + 1)] for base in (2, 3)]
    return (np.array(columns).T + rng.random(2)) % 1.0


def _radical_inverse(k: int, base: int) -> float:
    value, digit = 0.0, 1.0 / base
    while k:
        k, rest = divmod(k, base)
        value += rest * digit
        digit /= base
    return value
