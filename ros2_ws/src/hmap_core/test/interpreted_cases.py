"""Small jobs for all of the optimiser's compiled code: ``python interpreted_cases.py OUT.npz`` runs them uncompiled.

Each is a function of nothing that returns numbers. They are small since plain Python takes a thousand times longer.
"""

import sys

import numpy as np

if __name__ == "__main__":
    from interpreted import install

    install()

from core_fixtures import KINDS, arm, model, no_collisions, random_hull, random_pose, random_q  # noqa: E402
from komo_fixtures import evaluate, world_of  # noqa: E402
from test_komo_features import BETWEEN  # noqa: E402

from hmap_core.collision.convex import (  # noqa: E402
    convex_set,
    from_hulls,
    set_distance,
    sets_closer,
    signed_distance,
    transformed,
)
from hmap_core.collision.scene_model import CollisionModel  # noqa: E402
from hmap_core.kinematics.simplify import simplify_hull  # noqa: E402
from hmap_core.komo.allowances import relaxed  # noqa: E402
from hmap_core.komo.features import (  # noqa: E402
    axis_alignment,
    joint_limits,
    joint_position,
    pose_params,
    relative_pose,
    relative_position,
    stable,
)
from hmap_core.komo.ik import follow_ik, solve_ik_batch  # noqa: E402
from hmap_core.komo.objective import Objective, ObjectiveType  # noqa: E402
from hmap_core.komo.options import IK_OPTIONS, SolverOptions  # noqa: E402
from hmap_core.komo.path_collisions import path_violations  # noqa: E402
from hmap_core.komo.transcription import KomoProblem  # noqa: E402
from hmap_core.transforms import IDENTITY, multiply, pose, rotation_matrix  # noqa: E402
from hmap_core.types import Shape, ShapeKind  # noqa: E402

EQ, INEQ, SOS = ObjectiveType.EQ, ObjectiveType.INEQ, ObjectiveType.SOS
HOME = arm("panda").model.home
BALL = np.zeros((1, 3))
# So that both go the same way to the last digit, a path is let go on for a few steps only.
FEW = SolverOptions(outer=4, inner=4, iterations=12, refinements=1)


def _round(points: int) -> tuple[np.ndarray, float]:
    """A hull of so many vertices that climbing along its edges pays."""
    rng = np.random.default_rng(points)
    vertices = rng.normal(size=(points, 3))
    return 0.1 * vertices / np.linalg.norm(vertices, axis=1, keepdims=True), 0.0


def distances() -> list[float]:
    """Far, near and in deep overlap, of every pair of kinds; and flat things that touch."""
    rng = np.random.default_rng(1)
    found, witness = [], np.zeros((3, 3))
    for a in KINDS:
        for b in KINDS:
            for spread in (0.6, 0.1, 0.01):
                A, B = random_hull(rng, a), random_hull(rng, b)
                T = random_pose(rng, spread)
                found.append(
                    signed_distance(A[0], np.eye(3), np.zeros(3), A[1], B[0], rotation_matrix(T), T[:3], B[1], witness)
                )
                found += list(witness[0])
    square = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    for other in (square, BALL, np.array([[0.3, 0.3, -1.0], [0.3, 0.3, 1.0]])):
        found.append(signed_distance(square, np.eye(3), np.zeros(3), 0.0, other, np.eye(3), np.zeros(3), 0.0, witness))
    return found


def sets() -> list[float]:
    rng = np.random.default_rng(2)
    A, B = (from_hulls([random_hull(rng, kind) for kind in KINDS]) for _ in range(2))
    found = []
    for _ in range(3):
        T_a, T_b = random_pose(rng, 0.4), random_pose(rng, 0.4)
        found.append(set_distance(A, T_a, B, T_b))
        a, b = transformed(A, T_a), transformed(B, T_b)
        arrays = [(s.vertices, s.start, s.radius, s.center, s.bound, np.eye(3), np.zeros(3)) for s in (a, b)]
        found += [float(sets_closer(*arrays[0], *arrays[1], min_distance)) for min_distance in (0.0, 0.3)]
    vertices, radius = simplify_hull(_round(40)[0], 0.01)
    return [*found, len(vertices), radius]


def feature_values() -> list[float]:
    """Value and Jacobian of every feature, of an arm and a free body."""
    rng = np.random.default_rng(3)
    world = world_of("panda", "spatial")
    q, found = random_q(world.chain, rng), []
    features = [make(rng, world.tip("panda_0"), world.tip("spatial_1")) for make in BETWEEN.values()]
    features += [relative_pose(7, random_pose(rng, 0.1), random_pose(rng, 0.5)) for _ in range(6)]  # every quadrant
    features += [
        joint_position(np.zeros(3), 4),
        joint_position(np.zeros(3), 11),
        joint_limits(-np.ones(3), np.ones(3), 11),
    ]
    for feature in features:
        for values in evaluate(feature, world.chain, q):
            found += list(values.ravel())
    return found


def derivatives() -> list[float]:
    """The linearisation of a path with objectives of every order."""
    rng = np.random.default_rng(4)
    world = world_of("planar", "spatial")
    problem = KomoProblem(world.chain, (2, 1), no_collisions(), tau=0.5)
    for order in (0, 1, 2):
        problem.add(Objective(stable(3, 9), EQ, range(3), order=order))
        problem.add(Objective(relative_position(3, (0.1, 0, 0)), SOS, [0, 2], target=np.ones(3), order=order))
    path = np.array([random_q(world.chain, rng) for _ in range(4)])
    linear = problem.linearise(path[1:], path[0])
    return [*linear.values, *linear.jacobian.ravel()]


def _scene(world):
    """Some links of a Panda between a ball, a box and a round hull."""
    scene = CollisionModel()
    placed = next(iter(world.arms.values()))
    links = [
        scene.add(hull.link, hull.vertices, hull.radius, hull.frame, hull.sphere, edges=hull.edges)
        for hull in placed.arm.hulls[4:8]
    ]
    tip = multiply(placed.T_world_base, placed.arm.end_effector(HOME))
    box = convex_set([Shape(ShapeKind.BOX, (0.1, 0.1, 0.3))])
    around = scene.add_set("box", transformed(box, multiply(tip, pose((0.0, 0.12, 0.1)))), 0)
    around.append(scene.add("ball", BALL + tip[:3] + [0.0, -0.3, 0.0], 0.1, 0))
    ball = from_hulls([_round(30)])
    [held] = scene.add_set("held", ball, 7, speed=1.5)
    around += scene.add_set("post", transformed(ball, pose(tip[:3] + [0.2, 0.2, 0.0])), 0)
    scene.keep_apart(links, around, 0.01)
    scene.keep_apart([held], around, 0.005)
    scene.keep_apart(links[:1], [held], 0.002, 0b10)
    return scene


def path() -> list[float]:
    """A path of two phases past obstacles, with every type of objective, and one that begins too near."""
    world = model("panda")
    problem = KomoProblem(world.chain, (2, 2), _scene(world), FEW)
    goal = HOME + [0.4, 0.1, 0.0, 0.2, 0.0, 0.1, 0.0]
    problem.add(Objective(relative_position(7, (0, 0, 0.1), (0.6, 0.2, 0.5)), INEQ, range(4), 3.0))
    problem.add(Objective(axis_alignment(7, (0, 0, 1), (0, 0, -1)), SOS, range(4), 5.0))
    problem.add(Objective(stable(7, 0), EQ, [3], order=1))
    problem.add_objective(joint_position(goal), EQ, (1.0,))
    found = problem.solve(HOME, HOME + np.linspace(0.25, 1.0, 4)[:, None] * (goal - HOME))
    return [*found.path.ravel(), found.cost, found.worst_equality, found.worst_inequality, found.iterations]


def from_nothing() -> list[float]:
    """A path whose first guess is the solver's own, with restarts; it cannot be kept between the steps."""
    world = world_of("planar")
    scene = CollisionModel()
    ball = scene.add("ball", BALL, 0.02, 3)
    scene.keep_apart([ball], [scene.add("post", BALL + [0.3, 0.0, 0.2], 0.05, 0)], 0.01)
    problem = KomoProblem(world.chain, (2, 2), scene, FEW)
    problem.add_objective(joint_position(np.array([0.6, 0.4, 0.5])), EQ, (2.0,))
    found = problem.solve(np.zeros(3), restarts=1)
    return [*found.path.ravel(), float(found.feasible), found.iterations, found.attempts]


def impossible() -> list[float]:
    """What cannot be: the solver has to say so, and what it is."""
    world = world_of("planar")
    problem = KomoProblem(world.chain, (2,), no_collisions(), FEW)
    problem.add_objective(joint_position(np.array([5.0, 0.0, 0.0])), EQ, (1.0,))
    found = problem.solve(np.zeros(3))
    problem.add_objective(joint_position(np.full(3, np.nan)), EQ, (1.0,))
    no_number = problem.solve(np.zeros(3), np.zeros((2, 3)))
    return [float(found.feasible), len(found.worst) > 0, found.iterations, float(no_number.feasible)]


def ik() -> list[float]:
    """Inverse kinematics: a batch, and one after the other along a line until it jumps."""
    world = model("panda")
    name, placed = next(iter(world.arms.items()))
    problem = KomoProblem(world.chain, (1,), _scene(world), IK_OPTIONS)
    problem.add(Objective(relative_pose(world.tip(name), world.T_tip_ee(name), IDENTITY), EQ, [0]))
    here = multiply(placed.T_world_base, placed.arm.end_effector(HOME))
    poses = [multiply(here, pose((0.0, 0.0, -0.01 * k))) for k in range(3)] + [multiply(here, pose((0.0, 0.0, 2.0)))]
    params = np.array([pose_params(world.T_tip_ee(name), T) for T in poses])
    q, feasible = solve_ik_batch(problem, params[[0, 3]], np.tile(HOME + 0.05, (2, 1)), np.tile(HOME, (2, 1)))
    line = follow_ik(problem, params, HOME, 0.3)
    return [*q[0], *feasible.astype(float), *line.ravel(), *placed.arm.end_effectors(line).ravel()]


def violations() -> list[float]:
    """Of a path that runs through things, and the minimum distances that a start has."""
    world = model("panda")
    problem = KomoProblem(world.chain, (3,), _scene(world))
    rng = np.random.default_rng(7)
    path = HOME + np.cumsum(0.1 * rng.normal(size=(4, 7)), axis=0)
    violation, pair = path_violations(path, np.ones(4, np.int64), world.chain, problem.arrays(), -0.05)
    eased = relaxed(world.chain, problem.arrays(), path[2], 1)
    return [*violation, *pair, *eased.min_distance]


CASES = (distances, sets, feature_values, derivatives, path, from_nothing, impossible, ik, violations)


def main(out: str) -> None:
    np.savez(out, **{case.__name__: np.array(case(), float) for case in CASES})


if __name__ == "__main__":
    main(sys.argv[1])
