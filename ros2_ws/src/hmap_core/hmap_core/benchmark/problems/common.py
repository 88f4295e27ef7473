"""What several problems share: the table, the Panda, and attempts until an instance is right."""

from collections.abc import Callable

import numpy as np

from hmap_core.benchmark.instances import MotionInstance, box
from hmap_core.exceptions import Code, PlannerError
from hmap_core.scenes import load_robot_model
from hmap_core.transforms import pose
from hmap_core.types import Body, Robot

TABLE_SIZE = (2.4, 2.4, 0.1)  # m; its top is at z = 0
TABLE = "table"
MAX_ATTEMPTS = 200
SAFE = 0.005  # m that postures which prove an instance feasible keep from everything


def table() -> Body:
    return box(TABLE, TABLE_SIZE, pose((0.0, 0.0, -TABLE_SIZE[2] / 2.0)))


def panda(name: str = "panda", base: np.ndarray | None = None) -> Robot:
    """A Panda at home."""
    model = load_robot_model("panda")
    return Robot(name, model, pose() if base is None else base, model.home)


def yaw_quaternion(yaw: float) -> np.ndarray:
    """Quaternion (4,) xyzw of a turn (rad) about z."""
    return np.array([0.0, 0.0, np.sin(yaw / 2.0), np.cos(yaw / 2.0)])


def sampled(
    attempt: Callable[[int, np.random.Generator], MotionInstance | None], name: str, seed: int
) -> MotionInstance:
    """The first instance that an attempt with generators of this problem and seed does not give up on.

    Raises:
        PlannerError: none in MAX_ATTEMPTS; a wrong problem, not a wrong seed.
    """
    for k in range(MAX_ATTEMPTS):
        instance = attempt(seed, np.random.default_rng([seed, k, *name.encode()]))
        if instance is not None:
            return instance
    raise PlannerError(f"problem '{name}', seed {seed}: no instance in {MAX_ATTEMPTS} attempts", Code.INTERNAL)
