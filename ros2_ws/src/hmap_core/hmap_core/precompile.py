"""Compiles everything once, so that no user waits for it: ``python -m hmap_core.precompile``.

It runs the real planner on small jobs of every kind; what numba compiles on the way stays in the cache.
"""

import sys
import time

import numpy as np

from hmap_core.compile_cache import remove_old_caches
from hmap_core.planner import plan
from hmap_core.scenes import load_scene
from hmap_core.transforms import from_rpy, pose
from hmap_core.types import Body, BodyKind, Shape, ShapeKind
from hmap_core.waypoints import ObjectPathProblem, plan_waypoints

TIME_LIMIT = 1200.0  # s for each job; compiling is slow on a busy machine
TASKS = ("published/tunnel", "tunnel")  # one kinematic, one physical


def _spatial_path() -> None:
    """A free body turned in space, round a wall: SE(3), with obstacles of every kind of shape."""
    brick = Body("brick", BodyKind.MOVABLE, (Shape(ShapeKind.BOX, (0.1, 0.05, 0.05)),), pose(), 0.1)
    wall = Body("wall", BodyKind.FIXED, (Shape(ShapeKind.BOX, (0.02, 0.4, 0.4)),), pose((0.3, 0, 0.5)))
    ball = Body("ball", BodyKind.FIXED, (Shape(ShapeKind.SPHERE, (0.05,)),), pose((0.3, 0.5, 0.5)))
    post = Body("post", BodyKind.FIXED, (Shape(ShapeKind.CYLINDER, (0.05, 0.4)),), pose((0.3, -0.5, 0.5)))
    problem = ObjectPathProblem(
        brick, pose((0, 0, 0.5)), from_rpy((0.6, 0, 0.5), (0.5, 0.5, 1.0)), (wall, ball, post), "spatial"
    )
    plan_waypoints(problem, np.random.default_rng(0), TIME_LIMIT)


def main() -> int:
    remove_old_caches()
    began = time.monotonic()
    for name, job in [(task, lambda task=task: plan(load_scene(task), time_limit=TIME_LIMIT)) for task in TASKS] + [
        ("a path in space", _spatial_path)
    ]:
        print(f"compiling for {name} ...", file=sys.stderr, flush=True)
        job()
    print(f"compiled in {time.monotonic() - began:.0f} s", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
