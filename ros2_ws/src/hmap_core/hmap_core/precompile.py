"""Compiles everything once, so that no user waits for it: ``python -m hmap_core.precompile``.

It runs the real planner on small jobs of every kind; what numba compiles on the way stays in the cache.
"""

import sys
import time
from collections.abc import Callable

import numpy as np

from hmap_core.baselines.cmgmp.demonstrations import demonstrations
from hmap_core.benchmark import many_parts
from hmap_core.compile_cache import mark_compiled, remove_old_caches
from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.features import joint_position
from hmap_core.komo.ik import solve_ik
from hmap_core.komo.objective import ObjectiveType
from hmap_core.komo.options import IK_OPTIONS
from hmap_core.komo.skeleton import Skeleton, SkeletonEntry, Symbol
from hmap_core.komo.skeleton_problem import SkeletonProblem
from hmap_core.komo.transcription import KomoProblem
from hmap_core.komo.workspace import Workspace
from hmap_core.learning.clearance import Boxes, probe_distances
from hmap_core.planner import HmapPlanner, ObjectPathQuery
from hmap_core.planner.object_path import BidirectionalSearch
from hmap_core.scenes import load_scene
from hmap_core.transforms import from_rpy, multiply, pose
from hmap_core.types import Body, BodyKind, Shape, ShapeKind
from hmap_core.waypoints import NoObjectPath, ObjectPathProblem, plan_waypoints

TIME_LIMIT = 1200.0  # s for each job; compiling is slow on a busy machine
# one kinematic, the others physical: with a removal, and with a tool
TASKS = ("published/tunnel", "tunnel", "bookshelf", "puck_around")
ATTACHED = (60, 120)  # parts of a body that an arm carries, and of what it passes
PATHS = ("tunnel", "puck_around")  # planar; one straight, one round an obstacle


def _planar_paths() -> None:
    """Before the tasks, whose object paths have a time limit of their own."""
    for task in PATHS:
        scene = load_scene(task)
        BidirectionalSearch().plan_path(ObjectPathQuery(scene, scene.start_state(), scene.goal, 0, TIME_LIMIT))


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


def _many_parts() -> None:
    """A path between so many shapes that their near pairs are found with trees, and one that no search finds."""
    cells = [(0.0, 0.1 * y, 0.1 * z) for y in range(-5, 6) for z in range(-5, 6) if max(abs(y), abs(z)) > 1]
    wall = Body("wall", BodyKind.FIXED, tuple(Shape(ShapeKind.BOX, (0.05, 0.1, 0.1), pose(c)) for c in cells), pose())
    rod = tuple(Shape(ShapeKind.BOX, (0.05, 0.05, 0.05), pose((0.05 * k, 0, 0))) for k in range(6))
    body = Body("rod", BodyKind.MOVABLE, rod, pose(), 0.1)
    for width in (0.0, 2.0):  # m, of a lid on the window
        lid = Body(
            "lid", BodyKind.FIXED, (Shape(ShapeKind.BOX, (0.01, width + 0.01, 9.0)),), pose((0.0, 5.0 - width, 0))
        )
        ends = pose((-0.5, 0.2, 0.2)), from_rpy((0.5, -0.2, 0.1), (0.5, 0.5, 1.0))
        problem = ObjectPathProblem(body, *ends, (wall, lid), "spatial")
        try:
            plan_waypoints(problem, np.random.default_rng(0), TIME_LIMIT, 500)
        except NoObjectPath:
            pass


def _many_pairs() -> None:
    """A transit with an attached body of so many parts that pairs are looked at in blocks."""
    many_parts.run_transit(*many_parts.attached(*ATTACHED, 0), TIME_LIMIT)


def _motions() -> None:
    """Motions from skeletons: one from nothing, one that cannot be, one with a velocity."""
    workspace = Workspace(load_scene(TASKS[1]), robots=["panda_1"])
    start = workspace.scene.robots["panda_1"]
    for ahead in (0.05, 3.0):  # m; the second is out of reach
        there = multiply(multiply(start.base_pose, load_arm(start.model).end_effector(start.q)), pose((0, 0, -ahead)))
        skeleton = Skeleton([SkeletonEntry(1, 1, Symbol.POSE_EQ, ("panda_1",), there)])
        problem = SkeletonProblem(skeleton, workspace, steps_per_phase=40)
        n = len(workspace.start)
        problem.add_objective(joint_position(np.zeros(n)), ObjectiveType.SOS, (1.0,), order=1)
        problem.add_objective(joint_position(np.full(n, 9.0)), ObjectiveType.INEQ)
        problem.solve(workspace.start, restarts=1)
        solve_ik(
            KomoProblem(problem.chain, (1,), problem.collisions, IK_OPTIONS, problem.objectives[:0]), np.zeros(0),
            workspace.start[None], workspace.start,
        )  # fmt: skip


def _contact_manifolds() -> None:
    """Where convex parts touch, for the baseline CMGMP."""
    problem = demonstrations(["push_along_walls"])["push_along_walls"].problem
    problem.contacts(problem.start)


def _distances() -> None:
    """Distances of points from boxes, for the learned proposer."""
    wall = Body("wall", BodyKind.FIXED, (Shape(ShapeKind.BOX, (0.02, 0.4, 0.4)),), pose())
    boxes = Boxes.around([(wall, wall.pose)])
    boxes.distances(np.zeros((1, 3)), 0.1)
    some, frames = np.zeros((1, 3)), np.eye(3)[None]
    probe_distances(
        frames, some, np.zeros(1), some, some, some, frames, some, np.zeros(1), boxes.R, boxes.p, boxes.half, 0.1, 1.0,
        np.empty((1, 1), np.float32), 0,
    )  # fmt: skip


def main() -> int:
    """Compile everything that planning needs; exit code 0."""
    remove_old_caches()
    began = time.monotonic()
    tasks = [(task, lambda task=task: HmapPlanner().plan(load_scene(task), time_limit=TIME_LIMIT)) for task in TASKS]
    jobs: list[tuple[str, Callable[[], object]]] = [
        ("a path in space", _spatial_path),
        ("a path among many parts", _many_parts),
        ("paths on a support", _planar_paths),
        ("a transit among many parts", _many_pairs),
        *tasks,
        ("motions from skeletons", _motions),
        ("distances from boxes", _distances),
        ("contact manifolds", _contact_manifolds),
    ]
    for name, job in jobs:
        print(f"compiling for {name} ...", file=sys.stderr, flush=True)
        job()
    mark_compiled()
    print(f"compiled in {time.monotonic() - began:.0f} s", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
