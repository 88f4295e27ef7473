"""Nodes of the graph: placements at which an object stands by itself between two contacts."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hmap_core.collision.convex import transformed
from hmap_core.komo.shapes import body_set
from hmap_core.planner.obstruction import LIFT
from hmap_core.planner.placements import MIN_SPACE, REACH_SHARE, Face, PlaceSearch, level_faces
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.planner.sweep import nearest
from hmap_core.planner.tools import extent
from hmap_core.stability.mass import centre_of_mass
from hmap_core.stability.resting_faces import resting_faces
from hmap_core.transforms import quaternion_multiply, quaternions, rotation_matrix
from hmap_core.types import BodyKind, Scene, SceneState
from hmap_core.waypoints import stable_poses

YAWS = np.arange(8) * np.pi / 4  # rad about the vertical, relative to the start, the goal or the support's edge
PER_FACE = 10  # placements of one resting face on one support
ON_SUPPORT = 400  # samples of one resting face on one support
INSIDE_EDGE = (0.01, 0.025)  # m, distances of the centre of mass from an edge over which the object sticks out
ALONG_EDGE = (0.5, 0.25, 0.75)  # shares of an edge at which the object is placed
LEAST_OVERHANG = 0.015  # m by which the object sticks out, at least
SAME_TILT = 1e-3  # of the vertical direction in the body frame
SAME_HEIGHT = 1e-3  # m
GAP_STEP = 0.02  # m between checks of the support between two placements
WAY_WEIGHT = 0.5  # cost of a metre between start, placement and goal


@dataclass(frozen=True, eq=False)
class Placement:
    """A stable pose of the object.

    Attributes:
        pose: (7,) T_world_obj.
        up: (3,) vertical direction in the object's frame.
        cost: rank among the placements, small for near ones.
        over_edge: whether the object sticks out over an edge of its support.
    """

    pose: np.ndarray
    up: np.ndarray
    cost: float = 0.0
    over_edge: bool = False

    @staticmethod
    def at(pose: np.ndarray) -> "Placement":
        """The placement at a pose (7,)."""
        return Placement(pose, rotation_matrix(pose)[2])

    def slides_to(self, other: "Placement") -> bool:
        """Whether both have the same height and tilt, so that the object may be pushed from one to the other."""
        if abs(float(self.pose[2]) - float(other.pose[2])) >= SAME_HEIGHT:
            return False
        return bool(np.abs(self.up - other.up).max() < SAME_TILT)


def carried_between(scene: Scene, state: SceneState, object: str, a: Placement, b: Placement) -> bool:
    """Whether supports carry an object between two placements, but for gaps that are shorter than the object.

    Args:
        scene, state: the world, and where everything is.
        object: name of the object.
        a, b: placements with the same height and tilt.
    """
    steps = max(1, int(np.ceil(np.linalg.norm(b.pose[:3] - a.pose[:3]) / GAP_STEP)))
    poses = np.tile(a.pose, (steps + 1, 1))
    poses[:, :3] += np.linspace(0.0, 1.0, steps + 1)[:, None] * (b.pose[:3] - a.pose[:3])
    around = placed_bodies(scene, state, object)
    stands = stable_poses(scene.bodies[object], np.vstack([a.pose + LIFT, poses]), around)[1:]
    gap = longest = 0
    for stable in stands:
        gap = 0 if stable else gap + 1
        longest = max(longest, gap)
    return longest * GAP_STEP <= extent(scene, object)


def intermediate_placements(
    scene: Scene, state: SceneState, object: str, T_goal: np.ndarray, rng: np.random.Generator
) -> list[Placement]:
    """Stable and free placements of an object within reach, the cheapest first.

    Args:
        scene, state: the world, and where everything is.
        object: name of the object.
        T_goal: (7,) its goal pose, world frame.
        rng: the only source of randomness.
    """
    search = _Sampler(scene, state, object, T_goal, rng)
    found = [placement for face in search.supports() for placement in search.on(face)]
    return sorted(found, key=lambda placement: placement.cost)


class _Sampler:
    """Samples placements of one object."""

    def __init__(self, scene: Scene, state: SceneState, object: str, T_goal: np.ndarray, rng: np.random.Generator):
        self.scene, self.state, self.object, self.rng = scene, state, object, rng
        self.start, self.goal = state.poses[object], T_goal
        self.places = PlaceSearch(scene, state, object, (), rng)
        self.body, self.shapes = scene.bodies[object], body_set(scene.bodies[object])
        centre = centre_of_mass(self.shapes)
        self.centre = centre
        self.around = placed_bodies(scene, state, object)
        self.turns = [(face, quaternions(face.R[None])[0]) for face in resting_faces(self.shapes, tuple(centre))]

    def supports(self) -> list[Face]:
        """Level faces of bodies that stay where they are."""
        moving = {name for name in self.scene.removable} | {self.object}
        tools = {name for name, body in self.scene.bodies.items() if body.kind == BodyKind.TOOL}
        return level_faces(self.scene, self.state, frozenset(moving | tools))

    def on(self, face: Face) -> Iterator[Placement]:
        """Placements on one support."""
        around = self.places.above(face.height)
        for resting, turn in self.turns:
            poses, over = self._poses(face, resting.height, turn)
            positions = poses[:, :3]
            near = self.places.stretch(positions, REACH_SHARE) <= 0.0
            poses, over = poses[near], over[near]
            if not len(poses):
                continue
            stands = stable_poses(self.body, np.vstack([poses[0] + LIFT, poses]), self.around)[1:]
            poses, over = poses[stands], over[stands]
            cost = self._cost(poses)
            for own, most in ((over, PER_FACE), (~over, PER_FACE)):
                count = 0
                for k in np.argsort(np.where(own, cost, np.inf), kind="stable")[: own.sum()]:
                    space = nearest([around], {self.object: transformed(self.shapes, poses[k])}, MIN_SPACE)
                    if self.object not in space:
                        yield Placement(poses[k], resting.R.T @ [0.0, 0.0, 1.0], float(cost[k]), bool(over[k]))
                        count += 1
                    if count == most:
                        break

    def _cost(self, poses: np.ndarray) -> np.ndarray:
        way = np.linalg.norm(poses[:, :3] - self.start[:3], axis=1) + np.linalg.norm(
            poses[:, :3] - self.goal[:3], axis=1
        )
        return WAY_WEIGHT * way + self.places.stretch(poses[:, :3], 0.0).clip(0.0) * WAY_WEIGHT

    def _poses(self, face: Face, height: float, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poses (M, 7) on a support with the body turned, and which of them (M,) stick out over an edge."""
        inner = self._inner(face, height, turn)
        outer = self._over_edges(face, height, turn)
        poses = np.array([*inner, *outer]).reshape(-1, 7)
        return poses, np.arange(len(poses)) >= len(inner)

    def _inner(self, face: Face, height: float, turn: np.ndarray) -> list[np.ndarray]:
        xy = self.places.samples(face)
        yaw = self._yaws(turn)
        turned = [_about_vertical(turn, angle) for angle in yaw]
        chosen = self.rng.integers(len(turned), size=len(xy))
        return [np.r_[p, face.height + height, turned[k]] for p, k in zip(xy, chosen, strict=True)]

    def _yaws(self, turn: np.ndarray) -> np.ndarray:
        """Turns (K,) about the vertical: those of start and goal where the body lies on the same face, in quarters."""
        up = rotation_matrix(np.r_[np.zeros(3), turn])[2]
        yaws = []
        for T in (self.start, self.goal):
            R = rotation_matrix(T)
            if np.abs(R[2] - up).max() < SAME_TILT:
                R = R @ rotation_matrix(np.r_[np.zeros(3), turn]).T
                yaws.append(np.arctan2(R[1, 0], R[0, 0]) + YAWS[::2])
        return np.concatenate(yaws) if yaws else YAWS

    def _over_edges(self, face: Face, height: float, turn: np.ndarray) -> list[np.ndarray]:
        """Poses at which the body sticks out over an edge of its support, with a side along that edge."""
        points = self.shapes.vertices @ rotation_matrix(np.r_[np.zeros(3), turn]).T
        centre = rotation_matrix(np.r_[np.zeros(3), turn]) @ self.centre
        found = []
        corners = face.polygon
        for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            length = float(np.linalg.norm(b - a))
            along = (b - a) / length
            outward = np.array([along[1], -along[0]])
            edge_yaw = float(np.arctan2(along[1], along[0]))
            for angle in edge_yaw + YAWS[::2]:
                R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
                middle = R @ centre[:2]
                reach = float((points[:, :2] @ R.T @ outward).max() - middle @ outward)
                for inside in INSIDE_EDGE:
                    if reach - inside < LEAST_OVERHANG:
                        continue
                    for share in ALONG_EDGE:
                        xy = a + share * length * along - inside * outward - middle
                        found.append(np.r_[xy, face.height + height, _about_vertical(turn, angle)])
        return found


def _about_vertical(quaternion: np.ndarray, angle: float) -> np.ndarray:
    return quaternion_multiply(np.array([0.0, 0.0, np.sin(0.5 * angle), np.cos(0.5 * angle)]), quaternion)
