"""Where a body can be put so that it is out of the way: stable, free, clear of where others will pass, near."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from hmap_core.collision.convex import ConvexSet, transformed
from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.shapes import body_set, posed_links
from hmap_core.komo.surroundings import hull_set
from hmap_core.planner.local import placed_bodies
from hmap_core.planner.sweep import Sweep, joined, nearest, placed
from hmap_core.transforms import IDENTITY, apply, from_rpy, multiply, rotation_matrix
from hmap_core.types import BodyKind, Scene, SceneState
from hmap_core.waypoints import standing
from hmap_core.waypoints.support import FACE_TOLERANCE, feet

SAMPLES = 256  # places looked at on each face
SEARCH_RADIUS = 0.8  # m from where the body is now
REACH_SHARE = 0.95  # of an arm's reach, beyond which nothing is put
MIN_SPACE = 0.01  # m that have to be free round the body
ROOM = 0.10  # m that a hand beside it needs; less counts as farther away
ROOM_WEIGHT = 3.0  # m of way that a missing metre of room is worth
TURN_COST = 0.1  # m of way that a turn by a right angle is worth
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


def removal_places(
    scene: Scene,
    state: SceneState,
    name: str,
    keep_out: Sequence[Sweep],
    unsteady: frozenset[str],
    rng: np.random.Generator,
) -> Iterator[np.ndarray]:
    """Poses (7,) at which a body is out of the way, the best first: the one that the task gives, then computed ones.

    Computed are places on what carries the body now, then on fixed bodies, then on movable ones; each first as the
    body is turned now and then turned by a right angle. Nearer ones come first, those with room for a hand round them
    before.

    Args:
        keep_out: where something will pass.
        unsteady: bodies on which nothing may be put, as they will move.
    """
    search = _Search(scene, state, name, tuple(keep_out), rng)
    given = scene.removable.get(name)
    if given is not None and search.clear_of_ways(given) > 0.0:
        yield np.asarray(given, float)
    faces = level_faces(scene, state, unsteady | {name})
    here = [f for f in faces if search.stands_on(f)]
    others = [f for f in faces if not search.stands_on(f)]
    sorts = [here]
    for fixed in _FIXED_FIRST:
        sorts.append([f for f in others if (scene.bodies[f.owner].kind == BodyKind.FIXED) == fixed])
    for sort in sorts:
        for yaw in YAWS:
            yield from search.best(sort, yaw)


class _Search:
    """Candidates for one body's place, filtered and ranked."""

    def __init__(self, scene: Scene, state: SceneState, name: str, keep_out: tuple[Sweep, ...], rng):
        self.scene, self.state, self.name, self.keep_out = scene, state, name, keep_out
        self.T = state.poses[name]
        self.shapes = body_set(scene.bodies[name])
        self.unit = _halton(SAMPLES, rng)
        self.others = placed(scene, state, [other for other in scene.bodies if other != name])
        self.standing_bodies = placed_bodies(scene, state, name)
        links = [
            (vertices, radius, *sphere, edges)
            for robot, r in scene.robots.items()
            for _, vertices, radius, sphere, edges in posed_links(r, state.q[robot], state.gripper[robot])
        ]
        self.robots = hull_set(links)
        arms = [(r, load_arm(r.model)) for r in scene.robots.values()]
        self.shoulders = np.array([apply(r.base_pose, arm.p_joint[0]) for r, arm in arms]).reshape(-1, 3)
        self.reach = np.array([arm.reach()[0] for _, arm in arms])
        self.lowest = feet(self.shapes, rotation_matrix(self.T))[1] + float(self.T[2])

    def stands_on(self, face: Face) -> bool:
        """Whether the body is at the height of a face, and over it."""
        x, y = self.T[:2]
        return abs(face.height - self.lowest) <= FACE_TOLERANCE and bool(_inside(face.polygon, np.array([[x, y]]))[0])

    def clear_of_ways(self, T: np.ndarray) -> float:
        """Distance in metres from where others will pass, at most ROOM."""
        return nearest(self.keep_out, {self.name: transformed(self.shapes, T)}, ROOM).get(self.name, ROOM)

    def best(self, faces: Sequence[Face], yaw: float) -> list[np.ndarray]:
        """Up to PER_GROUP poses (7,) on some faces with the body turned by ``yaw`` from now, the best first."""
        ranked = sorted((c for face in faces for c in self._on(face, yaw)), key=lambda c: c[0])
        chosen: list[np.ndarray] = []
        for _, T in ranked:
            if all(np.linalg.norm(T[:3] - other[:3]) >= APART for other in chosen):
                chosen.append(T)
            if len(chosen) == PER_GROUP:
                break
        return chosen

    def _on(self, face: Face, yaw: float) -> list[tuple[float, np.ndarray]]:
        """(cost in metres, pose) of all free places on a face."""
        turn = from_rpy((0, 0, 0), (0, 0, yaw))
        turned = multiply(turn, np.r_[0.0, 0.0, 0.0, self.T[3:]])
        height = face.height - feet(self.shapes, rotation_matrix(turned))[1]
        xy = self._samples(face)
        xy = xy[_inside(face.polygon, xy)]
        positions = np.column_stack([xy, np.full(len(xy), height)])
        positions = positions[self._reachable(positions)]
        if not len(positions):
            return []
        poses = np.column_stack([positions, np.tile(turned[3:], (len(positions), 1))])
        holds = standing(self.scene.bodies[self.name], np.vstack([self.T, poses]), self.standing_bodies)[1:]
        around = self._above(face.height)
        turn_cost = TURN_COST if yaw else 0.0
        found = []
        for T in poses[holds]:
            body = {self.name: transformed(self.shapes, T)}
            space = nearest([around], body, ROOM).get(self.name, ROOM)
            if space < MIN_SPACE:
                continue
            room = self.clear_of_ways(T)
            if room < MIN_SPACE:
                continue
            missing = 2.0 * ROOM - space - room
            found.append((np.linalg.norm(T[:3] - self.T[:3]) + ROOM_WEIGHT * missing + turn_cost, T))
        return found

    def _samples(self, face: Face) -> np.ndarray:
        """Positions (M, 2): half of them round where the body is, denser there, half of them all over the face."""
        half = len(self.unit) // 2
        angle = 2.0 * np.pi * self.unit[:half, 0]
        ring = self.T[:2] + SEARCH_RADIUS * self.unit[:half, 1, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        low, high = face.polygon.min(axis=0), face.polygon.max(axis=0)
        return np.concatenate([ring, low + self.unit[half:] * (high - low)])

    def _reachable(self, positions: np.ndarray) -> np.ndarray:
        far = np.linalg.norm(positions[:, None] - self.shoulders, axis=2)
        return (far <= REACH_SHARE * self.reach).any(axis=1)

    def _above(self, height: float) -> Sweep:
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


def _inside(polygon: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Which points (M, 2) lie in a convex counter-clockwise polygon (n, 2)."""
    edge = np.roll(polygon, -1, axis=0) - polygon
    to = points[:, None] - polygon
    return (edge[:, 0] * to[:, :, 1] - edge[:, 1] * to[:, :, 0] >= 0.0).all(axis=1)


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
