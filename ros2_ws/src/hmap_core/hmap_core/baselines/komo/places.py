"""Random places at which an object may be released between two contacts."""

import numpy as np

from hmap_core.planner.object_path import object_path_problem
from hmap_core.planner.protocols import ObjectPathQuery
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.types import Goal, Scene, SceneState
from hmap_core.waypoints import stable_poses
from hmap_core.waypoints.checker import Geometry, ObjectChecker
from hmap_core.waypoints.search import search_bounds

DRAWN = 200  # places at most until one is free
SPREAD = 0.1  # m, standard deviation from the line between start and goal
EVERYWHERE = 0.5  # share of the places that may be anywhere
ON_THE_LINE = 0.5  # share of the others that are on the line


class Places:
    """Places of the goal's object, as high and turned as at its start or at its goal.

    Args:
        scene, state: the world, and where everything is.
        goal: of the object.
    """

    def __init__(self, scene: Scene, state: SceneState, goal: Goal):
        problem = object_path_problem(ObjectPathQuery(scene, state, goal, 0, np.inf))
        self._checker = ObjectChecker(problem, Geometry(problem), False, 0.0)
        self._problem, self._bounds = problem, search_bounds(problem, self._checker)
        self._around = placed_bodies(scene, state, goal.object)

    def draw(self, rng: np.random.Generator) -> np.ndarray | None:
        """A place (7,) where the object stands by itself and touches nothing else; None where none was found."""
        start, goal = self._problem.start, self._problem.goal
        for _ in range(DRAWN):
            place = (start if rng.random() < 0.5 else goal).copy()
            if rng.random() < EVERYWHERE:
                place[:2] = rng.uniform(*self._bounds)[:2]
            else:
                place[:2] = start[:2] + rng.random() * (goal[:2] - start[:2])
                if rng.random() >= ON_THE_LINE:
                    place[:2] += SPREAD * rng.normal(size=2)
            if self._checker.pose_free(place):
                if stable_poses(self._problem.body, np.array([start, place, goal]), self._around)[1]:
                    return place
        return None
