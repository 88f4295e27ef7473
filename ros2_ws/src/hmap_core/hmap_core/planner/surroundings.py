"""What stands around an object or a robot in a state."""

from dataclasses import replace

import numpy as np

from hmap_core.types import Body, Scene, SceneState

PHYSICAL_MIN_DISTANCE = 0.01  # m round an object's path where there is room: pushed objects stray


def placed_bodies(scene: Scene, state: SceneState, without: str) -> tuple[Body, ...]:
    """All bodies but one, at their present poses."""
    return tuple(replace(b, pose=state.poses[name]) for name, b in scene.bodies.items() if name != without)


def away_from_home(scene: Scene, state: SceneState, robot: str) -> tuple[str, ...]:
    """The other robots that have to go home before one may work."""
    return tuple(n for n in scene.robots if n != robot and not np.allclose(state.q[n], scene.robots[n].model.home))


def nearest_first(scene: Scene, object: str, state: SceneState, robots) -> tuple[str, ...]:
    """Names of robots, sorted by the distance of their bases from an object."""
    place = state.poses[object][:2]
    return tuple(sorted(robots, key=lambda name: float(np.linalg.norm(scene.robots[name].base_pose[:2] - place))))
