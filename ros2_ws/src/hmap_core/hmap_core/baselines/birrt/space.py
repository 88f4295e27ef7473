"""The object's part of the configuration space: samples, distances, and checks of its motions."""

import numpy as np

from hmap_core.planner.object_path import object_path_problem
from hmap_core.planner.protocols import ObjectPathQuery
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.transforms import distance, interpolate
from hmap_core.types import Goal, Scene, SceneState
from hmap_core.waypoints import stable_poses
from hmap_core.waypoints.checker import Geometry, ObjectChecker, planar_pose, planar_projection, planar_yaw
from hmap_core.waypoints.search import search_bounds

TURN_LENGTH = 0.1  # m that count as much as 1 rad in the distance between two poses
STEP = 0.02  # m between two poses of a motion
TURN_STEP = 0.1  # rad
UNTURNED = 0.5  # share of the samples that keep the orientation of start or goal
PLANAR = 1e-3  # m and rad that a goal in the plane may be off


class ObjectSpace:
    """Poses of the object among everything that stands around.

    Args:
        scene, state: the world, and where everything is.
        goal: of the object.

    Attributes:
        planar: whether the object slides on its support: SE(2), else SE(3).
        start, goal: (7,) its poses.
    """

    def __init__(self, scene: Scene, state: SceneState, goal: Goal):
        problem = object_path_problem(ObjectPathQuery(scene, state, goal, 0, np.inf))
        self.start, self.goal = problem.start, problem.goal
        level = planar_projection(problem, problem.goal)
        self.planar = scene.motion == "planar" or (
            scene.motion == "auto" and max(distance(level, problem.goal)) < PLANAR
        )
        if self.planar:
            self.goal = level
        self._problem, self._placed = problem, placed_bodies(scene, state, goal.object)
        self._checker = ObjectChecker(problem, Geometry(problem), self.planar, problem.min_distance)
        self.bounds = search_bounds(problem, self._checker)

    def sample(self, rng: np.random.Generator) -> np.ndarray:
        """A random pose (7,)."""
        place = rng.uniform(*self.bounds)
        like = self.start if rng.random() < 0.5 else self.goal
        keep = rng.random() < UNTURNED
        if self.planar:
            yaw = planar_yaw(self.start, like) if keep else rng.uniform(-np.pi, np.pi)
            return planar_pose(self.start, float(place[0]), float(place[1]), yaw)
        quaternion = like[3:] if keep else rng.normal(size=4)
        return np.concatenate([place, quaternion / np.linalg.norm(quaternion)])

    def projected(self, T: np.ndarray) -> np.ndarray:
        """The nearest pose (7,) that the object can have: on its support in planar motion."""
        return planar_projection(self._problem, T) if self.planar else T

    def distances(self, poses: np.ndarray, T: np.ndarray) -> np.ndarray:
        """How far (M,) poses (M, 7) are from T (7,), in m."""
        turn = 2.0 * np.arccos(np.clip(np.abs(poses[:, 3:] @ T[3:]), 0.0, 1.0))
        return np.linalg.norm(poses[:, :3] - T[:3], axis=1) + TURN_LENGTH * turn

    def line(self, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Poses (m + 1, 7) straight from a to b (7,), a step apart or less."""
        far, turn = distance(a, b)
        steps = max(1, int(np.ceil(max(far / STEP, turn / TURN_STEP))))
        return np.array([a, *(interpolate(a, b, s) for s in np.arange(1, steps) / steps), b])

    def reached(self, poses: np.ndarray) -> int:
        """How many of the poses (m + 1, 7) after the first the object reaches freely."""
        for k in range(len(poses) - 1):
            if not self._checker.motion_free(poses[k], poses[k + 1]):
                return k
        return len(poses) - 1

    def stands(self, T: np.ndarray) -> bool:
        """Whether the object may be let go at T (7,)."""
        if self.planar or np.array_equal(T, self.start) or np.array_equal(T, self.goal):
            return True
        body = self._problem.body
        return bool(stable_poses(body, np.array([self.start, T, self.goal]), self._placed)[1])
