"""Which robot should touch an object: the nearest one, unless a ranker expects that it serves hardly any pose."""

import numpy as np

from hmap_core.planner.protocols import ManipulatorRanker
from hmap_core.planner.surroundings import nearest_first
from hmap_core.types import Scene, SceneState

# Probability that a hand serves more than a few poses, below which tools and other hands come before it: about what a
# search by hand costs, as a share of the choice of a tool with its contacts.
UNLIKELY = 0.25


def robot_order(
    ranker: ManipulatorRanker | None, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray
) -> tuple[str, ...]:
    """Names of all robots in the order in which their hands are queried for contacts.

    The nearest comes first. Robots that the ranker expects to serve hardly any pose follow the others: by distance
    alone the first of several robots already serves in 61 of 62 places of the data set where any does, so a ranker is
    not needed to choose between robots that may both serve.

    Args:
        ranker: estimates how far hands serve; None: only the distance counts.
        scene, state: the world, and where everything is.
        object: name of the object.
        object_poses: (M, 7) poses of the object from the present one on, world frame.
    """
    near = nearest_first(scene, object, state, tuple(scene.robots))
    if ranker is None or len(near) < 2:
        return near

    def unlikely(robots: tuple[str, ...]) -> np.ndarray:
        return ranker.hand_serves(scene, state, object, object_poses, robots) < UNLIKELY

    if not unlikely(near[:1])[0]:
        return near  # what is expected of the others would cost time, and change nothing unless this one fails
    last = dict(zip(near, (True, *unlikely(near[1:])), strict=True))
    return tuple(sorted(near, key=last.__getitem__))
