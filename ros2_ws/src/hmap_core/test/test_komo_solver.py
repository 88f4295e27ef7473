"""The compiled solver: its algebra against numpy and finite differences, and what it promises about results."""

import numpy as np
import pytest
from core_fixtures import arm, frames, model, no_collisions, random_pose, random_q
from geometry_fixtures import coal_distance, coal_hull

from hmap_core.collision.gjk import signed_distance
from hmap_core.collision.scene_model import CollisionModel
from hmap_core.kinematics.chain import Chain
from hmap_core.kinematics.model import KinematicModel, PlacedArm
from hmap_core.komo import lagrangian as augmented
from hmap_core.komo import newton
from hmap_core.komo.allowances import RELAXATION, relaxed, verification
from hmap_core.komo.arrays import Multipliers
from hmap_core.komo.banded import PADDING, cholesky_solve
from hmap_core.komo.features import axis_alignment, joint_position, pose_params, relative_pose, relative_position
from hmap_core.komo.features.base import MAX_DIM
from hmap_core.komo.ik import follow_ik, solve_ik_batch
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.options import IK_OPTIONS, SolverOptions
from hmap_core.komo.path_collisions import path_violations
from hmap_core.komo.scratch import new_model, new_multipliers, new_scratch
from hmap_core.komo.transcription import KomoProblem
from hmap_core.transforms import IDENTITY, apply, distance, from_matrix, multiply, pose

BOX = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
PHASES = (4, 3)


def home(name="panda"):
    return arm(name).model.home


def with_links(world, *boxes, min_distance=0.01, phases=-1, opening=0.0):
    """All links of all arms, which keep away from boxes given as (size (3,), pose (7,))."""
    scene = CollisionModel()
    links = []
    for placed in world.arms.values():
        for hull in placed.arm.hulls:
            if hull.frame:
                frame = world.frame(placed.name, hull.frame)
                links.append(scene.add(hull.link, hull.at(opening), hull.radius, frame, hull.sphere_at(opening)))
    around = [scene.add(f"box {k}", apply(T, BOX * size), 0.0, 0) for k, (size, T) in enumerate(boxes)]
    scene.keep_apart(links, around, min_distance, phases)
    return scene


# --- algebra


@pytest.mark.parametrize("n, bandwidth", [(1, 0), (7, 6), (40, 1), (70, 20), (84, 41)])
def test_banded_cholesky_solves_as_numpy_does(n, bandwidth):
    rng = np.random.default_rng(n)
    band = np.abs(np.subtract.outer(np.arange(n), np.arange(n))) <= bandwidth
    full = rng.normal(size=(n, n)) * band
    full = full + full.T + 4 * (bandwidth + 1) * np.eye(n)
    rows = np.zeros((n, bandwidth + 1 + PADDING))
    for i in range(n):
        for k in range(min(n - 1 - i, bandwidth) + 1):
            rows[i, k] = full[i, i + k]
    b = rng.normal(size=n)
    x = b.copy()
    assert cholesky_solve(rows.copy(), x, bandwidth)
    np.testing.assert_allclose(x, np.linalg.solve(full, b), rtol=1e-9, atol=1e-12)
    rows[n // 2, 0] = -1.0
    assert not cholesky_solve(rows, b.copy(), bandwidth)


def dense(H, n):
    """Symmetric matrix of the solver's row storage."""
    N = len(H)
    full = np.zeros((N, N))
    for i in range(N):
        for k in range(min(N - 1 - i, 3 * n - 1) + 1):
            full[i, i + k] = full[i + k, i] = H[i, k]
    return full


def test_smoothness_is_the_sum_of_squared_differences():
    rng = np.random.default_rng(1)
    T, n, w_acc, w_vel = 6, 3, 0.7, 0.3
    X, prefix = rng.normal(size=(T, n)), rng.normal(size=(2, n))
    H, G = np.zeros((T * n, 3 * n + PADDING)), np.zeros(T * n)
    cost = augmented._smoothness(X, prefix, w_acc, w_vel, H, G)

    def value(X):
        whole = np.concatenate([prefix, X.reshape(T, n)])
        return (
            0.5 * w_acc * (np.diff(whole, 2, axis=0) ** 2).sum() + 0.5 * w_vel * (np.diff(whole[1:], axis=0) ** 2).sum()
        )

    assert cost == pytest.approx(value(X))
    steps = 1e-5 * np.eye(T * n)
    gradient = [(value(X.ravel() + s) - value(X.ravel() - s)) / 2e-5 for s in steps]
    np.testing.assert_allclose(G, gradient, atol=1e-6)
    full = dense(H, n)
    A = np.diff(np.eye(T + 2), 2, axis=0)[:, 2:]
    V = np.diff(np.eye(T + 1), 1, axis=0)[:, 1:]
    np.testing.assert_allclose(full, np.kron(w_acc * A.T @ A + w_vel * V.T @ V, np.eye(n)), atol=1e-12)


class Lagrangian:
    """The solver's merit of a random problem in which everything is active, with its derivatives."""

    def __init__(self, names, seed):
        rng = np.random.default_rng(seed)
        world = model(*names)
        self.T, self.n = sum(PHASES), world.n
        tip = world.tip(next(iter(world.arms)))
        scene = with_links(world, (0.5 * np.ones(3), random_pose(rng, 0.4)), (0.3 * np.ones(3), random_pose(rng, 0.4)),
                           min_distance=0.05)  # fmt: skip
        links = [s for s, f in enumerate(scene.frames) if f]
        ball = scene.add("attached ball", np.zeros((1, 3)), 0.15, tip)
        scene.keep_apart(links[:4], [ball], 0.02, 0b10)  # both move
        self.problem = KomoProblem(world.chain, PHASES, scene, SolverOptions(substeps=3, velocity=0.1))
        add = self.problem.add
        params = [pose_params(random_pose(rng, 0.1), random_pose(rng, 0.5)) for _ in range(3)]
        add(Objective(relative_pose(tip, IDENTITY, IDENTITY), ObjectiveType.EQ, [1, 3, 6], scale=2.0, params=params))
        add(Objective(relative_position(tip, (0, 0, 0.1), (0.3, 0.2, 0.4), 2), ObjectiveType.INEQ, range(7), scale=3.0))
        add(Objective(axis_alignment(tip, (0, 0, 1), (0, 0, -1)), ObjectiveType.SOS, range(7), scale=5.0))
        add(Objective(joint_position(np.zeros(self.n)), ObjectiveType.SOS, [4], scale=0.5))
        add(
            Objective(
                relative_position(tip, (0, 0, 0), (0, 0, 0)), ObjectiveType.EQ, range(7), order=1, target=(0, 0, 1)
            )
        )
        add(Objective(axis_alignment(tip, (1, 0, 0), (0, 0, -1)), ObjectiveType.SOS, [0, 1, 5], order=2, scale=4.0))
        add(Objective(joint_position(np.zeros(self.n)), ObjectiveType.INEQ, [0, 1, 2, 6], order=1))
        self.problem.tau = 0.5
        self.X = np.array([random_q(world.chain, rng) for _ in range(self.T)])
        self.X[2] = world.chain.upper + 0.05  # beyond the limits
        self.prefix = np.array([random_q(world.chain, rng)] * 2)
        self.terms, self.cols, self.samples = self.problem.terms(), self.problem.arrays(), self.problem.samples()
        lam = rng.normal(size=(len(self.terms.kernel), MAX_DIM))
        lam[self.terms.type == 2] = np.abs(lam[self.terms.type == 2])
        pairs = rng.uniform(0, 1, (self.T * 3, len(self.cols.a))) * rng.integers(0, 2, (self.T * 3, 1))
        self.multipliers = Multipliers(lam, pairs, rng.uniform(0, 1, (self.T, self.n, 2)), np.full(1, 50.0))

    def scratch(self):
        return scratch_for(self)

    def evaluate(self, X, scratch=None):
        """(merit, cost, worst equality, worst inequality, gradient, Hessian as the solver stores it)."""
        path = np.ascontiguousarray(X.reshape(self.T, self.n))
        model = new_model(self.T, self.n, self.terms, self.cols, self.samples)
        found = augmented.evaluate(
            path, self.prefix, self.problem.chain, self.terms, self.cols, self.samples, self.problem.options.packed,
            self.multipliers, model, scratch or self.scratch(), 0.0,
        )  # fmt: skip
        H, b = np.zeros((X.size, 3 * self.n + PADDING)), np.zeros(X.size)
        newton._assemble(path, self.prefix, self.problem.chain, self.multipliers, model, np.zeros(X.size), H, b)
        return *found[:4], -b, H


def scratch_for(of):
    return new_scratch(of.T, of.n, of.problem.chain, of.terms, of.cols, of.samples, of.prefix)


@pytest.mark.parametrize("names", [("panda",), ("panda", "iiwa")], ids="+".join)
@pytest.mark.parametrize("seed", range(3))
def test_the_gradient_is_that_of_the_merit(names, seed):
    """Objectives, limits, collisions at and between the steps, all with multipliers."""
    lagrangian = Lagrangian(names, seed)
    _, _, _, worst, G, H = lagrangian.evaluate(lagrangian.X)
    assert worst > 0.01
    x, h = lagrangian.X.ravel(), 1e-6
    expected = np.array(
        [(lagrangian.evaluate(x + s)[0] - lagrangian.evaluate(x - s)[0]) / (2 * h) for s in h * np.eye(x.size)]
    )
    # where a pair's nearest features change within the step the difference is off: few may be
    off = np.abs(G - expected) > 1e-3 * (1 + np.abs(expected))
    assert off.mean() < 0.03, np.flatnonzero(off)
    eigenvalues = np.linalg.eigvalsh(dense(H, lagrangian.n))
    assert eigenvalues.min() > -1e-9 * eigenvalues.max()  # Gauss-Newton


def test_what_is_left_alone_between_evaluations_changes_nothing():
    """The same values with a memory of which pairs were far apart as without."""
    lagrangian = Lagrangian(("panda",), 1)
    lagrangian.multipliers.pairs[:] = 0.0  # pairs with a multiplier are always looked at
    rng = np.random.default_rng(5)
    scratch = lagrangian.scratch()
    X = lagrangian.X.copy()
    for k in range(40):
        X += rng.normal(size=X.shape) * (0.3 if k % 10 == 9 else 0.02)
        remembered, fresh = lagrangian.evaluate(X, scratch), lagrangian.evaluate(X)
        assert remembered[0] == pytest.approx(fresh[0], rel=1e-9)
        np.testing.assert_allclose(remembered[4], fresh[4], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("grown", [1.0, 3.0])
def test_multipliers_updated_in_place_are_those_of_what_is_violated(grown):
    """The model with new multipliers and penalty is the one that is made anew with them."""
    lagrangian = Lagrangian(("panda",), 2)
    mult, old = lagrangian.multipliers, 50.0
    before = mult.pairs.copy()
    structure = lagrangian.problem.chain, lagrangian.terms, lagrangian.cols, lagrangian.samples
    options, scratch = lagrangian.problem.options.packed, lagrangian.scratch()
    model = new_model(lagrangian.T, lagrangian.n, *structure[1:])
    arguments = lagrangian.X, lagrangian.prefix, *structure, options, mult, model, scratch
    augmented.evaluate(*arguments, 0.0)
    mult.mu[0] = grown * old
    merit, _, worst_eq, worst_ineq, change = augmented.evaluate(*arguments, old)
    fresh = lagrangian.evaluate(lagrangian.X)
    assert merit == pytest.approx(fresh[0], rel=1e-9)
    assert (worst_eq, worst_ineq) == pytest.approx((fresh[2], fresh[3]), rel=1e-9)
    H, b = np.zeros((lagrangian.X.size, 3 * lagrangian.n + PADDING)), np.zeros(lagrangian.X.size)
    newton._assemble(lagrangian.X, lagrangian.prefix, structure[0], mult, model, np.zeros(b.size), H, b)
    np.testing.assert_allclose(-b, fresh[4], rtol=1e-9, atol=1e-7)
    np.testing.assert_allclose(H, fresh[5], rtol=1e-9, atol=1e-7)
    for t in range(lagrangian.T):
        sample = structure[3].first[t + 1] - 1
        violation = pair_violations(structure[0], structure[2], lagrangian.X[t], structure[3].mask[sample])
        expected = np.maximum(0.0, before[sample] + old * violation)
        asked = violation > -np.inf
        np.testing.assert_allclose(mult.pairs[sample][asked], expected[asked], atol=1e-3)
    assert (mult.pairs > before).any() and (mult.pairs < before).any() and change > 0.0


def test_collisions_between_the_steps_are_seen():
    """A box that only the middle of an interval touches."""
    world = model("iiwa")
    q0, q1 = np.array([-0.6, 1.2, 0, -0.6, 0, 0.4, 0]), np.array([0.6, 1.2, 0, -0.6, 0, 0.4, 0])
    placed = next(iter(world.arms.values()))
    middle = multiply(placed.T_world_base, placed.arm.end_effector((q0 + q1) / 2))
    scene = with_links(world, (0.05 * np.ones(3), pose(middle[:3])), min_distance=0.0)
    found = {}
    for substeps in (1, 2):
        problem = KomoProblem(world.chain, (2,), scene, SolverOptions(substeps=substeps))
        X, prefix = np.array([q0, q1]), np.array([q0, q0])
        structure = world.chain, problem.terms(), problem.arrays(), problem.samples()
        found[substeps] = augmented.evaluate(
            X, prefix, *structure, problem.options.packed, new_multipliers(2, 7, *structure[1:], 10.0),
            new_model(2, 7, *structure[1:]), new_scratch(2, 7, *structure, prefix), 0.0,
        )[3]  # fmt: skip
    assert found[1] <= 0.0 < 0.02 < found[2]


# --- results


def ik_problem(world, name, scene=None):
    problem = KomoProblem(world.chain, (1,), scene or no_collisions(), IK_OPTIONS)
    problem.add(Objective(relative_pose(world.tip(name), IDENTITY, IDENTITY), ObjectiveType.EQ, [0]))
    return problem


def reached(world, name, q, T):
    placed = world.arms[name]
    return distance(multiply(placed.T_world_base, placed.arm.end_effector(q)), T)


@pytest.mark.parametrize("kind", ["panda", "iiwa"])
def test_ik_reaches_what_can_be_reached(kind):
    rng = np.random.default_rng(1)
    world = model(kind)
    name, placed = next(iter(world.arms.items()))
    problem = ik_problem(world, name)
    low, high = world.chain.lower + 0.2, world.chain.upper - 0.2
    goals = np.array(
        [multiply(placed.T_world_base, placed.arm.end_effector(rng.uniform(low, high))) for _ in range(100)]
    )
    params = np.array([pose_params(world.T_tip_ee(name), T) for T in goals])
    done = np.zeros(len(goals), bool)
    for _ in range(12):
        start = rng.uniform(low, high, (len(goals), world.n))
        q, feasible = solve_ik_batch(problem, params, start, start)
        for k in np.flatnonzero(feasible):
            apart = reached(world, name, q[k], goals[k])
            assert apart[0] < 1e-4 and apart[1] < 1e-4
            assert (q[k] >= world.chain.lower - 1e-4).all() and (q[k] <= world.chain.upper + 1e-4).all()
        done |= feasible
    assert done.mean() > 0.97


def test_what_is_out_of_reach_is_infeasible():
    world = model("panda")
    name = next(iter(world.arms))
    problem = ik_problem(world, name)
    params = pose_params(world.T_tip_ee(name), pose((3.0, 0, 0)))[None]
    assert not solve_ik_batch(problem, params, home()[None], home()[None])[1].any()


def test_ik_keeps_clear_of_a_box_and_says_when_it_cannot():
    rng = np.random.default_rng(2)
    world = model("panda")
    name, placed = next(iter(world.arms.items()))
    goal = multiply(placed.T_world_base, placed.arm.end_effector(home()))
    inside = with_links(world, (0.1 * np.ones(3), goal), min_distance=0.005)
    start = np.tile(home(), (5, 1)) + 0.3 * rng.normal(size=(5, 7))
    params = np.tile(pose_params(world.T_tip_ee(name), goal), (5, 1))
    assert not solve_ik_batch(ik_problem(world, name, inside), params, start, start)[1].any()
    elbow = np.array(placed.arm.frames(home())[1][4])
    beside = with_links(world, (0.05 * np.ones(3), pose(apply(placed.T_world_base, elbow))), min_distance=0.005)
    q, feasible = solve_ik_batch(ik_problem(world, name, beside), params, start, start)
    assert feasible.any()
    for k in np.flatnonzero(feasible):
        violation, _ = path_violations(q[k][None], np.array([1]), world.chain, beside.arrays(), 0.0)
        assert violation[0] <= 1e-4


def obstacle_problem(steps=16):
    """From one side of a post to the other; the straight line goes through it."""
    world = model("iiwa")
    start, goal = np.array([-0.8, 1.0, 0, -0.9, 0, 0.6, 0]), np.array([0.8, 1.0, 0, -0.9, 0, 0.6, 0])
    placed = next(iter(world.arms.values()))
    middle = multiply(placed.T_world_base, placed.arm.end_effector((start + goal) / 2))
    boxes = [(np.array([0.06, 0.06, 0.5]), multiply(placed.T_world_base, pose((0.75, 0.0, middle[2] - 0.45))))]
    scene = with_links(world, *boxes, min_distance=0.01)
    problem = KomoProblem(world.chain, (steps,), scene)
    problem.add(Objective(joint_position(goal), ObjectiveType.EQ, [steps - 1]))
    initial = start + np.linspace(0, 1, steps + 1)[1:, None] * (goal - start)
    return world, scene, boxes, problem, start, initial, goal


def coal_clearance(world, boxes, path, opening=0.0):
    """Smallest distance of any link from any box along a path, straight between its points, by coal."""
    fine = [a + s * (b - a) for a, b in zip(path, path[1:], strict=False) for s in np.linspace(0, 1, 6)]
    solids = [(coal_hull(BOX * size), T) for size, T in boxes]
    worst = np.inf
    for placed in world.arms.values():
        hulls = [(coal_hull(hull.at(opening)), hull) for hull in placed.arm.hulls if hull.frame]
        for q in fine:
            R, p = placed.arm.frames(q)
            for shape, hull in hulls:
                matrix = np.eye(4)
                matrix[:3, :3], matrix[:3, 3] = R[hull.frame], p[hull.frame]
                T = multiply(placed.T_world_base, from_matrix(matrix))
                worst = min(worst, *(coal_distance(shape, T, box, T_box) - hull.radius for box, T_box in solids))
    return worst


def test_an_obstacle_on_the_way_is_avoided_at_the_steps_and_between():
    world, scene, boxes, problem, start, initial, goal = obstacle_problem()
    assert coal_clearance(world, boxes, np.concatenate([start[None], initial])) < -0.01
    result = problem.solve(start, initial)
    assert result.feasible, result.worst
    path = np.concatenate([start[None], result.path])
    np.testing.assert_allclose(path[-1], goal, atol=1e-4)
    assert (path >= world.chain.lower - 1e-4).all() and (path <= world.chain.upper + 1e-4).all()
    assert coal_clearance(world, boxes, path) > 0.003  # the min_distance, less what it may use up between the samples


def test_the_same_problem_gives_the_same_path():
    first, second = (obstacle_problem()[3:6] for _ in range(2))
    a, b = first[0].solve(*first[1:]), second[0].solve(*second[1:])
    np.testing.assert_array_equal(a.path, b.path)
    assert a.iterations == b.iterations


def test_limits_are_kept_when_the_goal_lies_beyond():
    world = model("panda")
    goal = np.minimum(home(), world.chain.upper)
    goal[5] = world.chain.upper[5] + 0.2
    problem = KomoProblem(world.chain, (8,), no_collisions())
    problem.add(Objective(joint_position(goal), ObjectiveType.SOS, [7], scale=100.0))
    result = problem.solve(home(), np.repeat(home()[None], 8, 0))
    assert result.feasible
    assert result.path[-1, 5] == pytest.approx(world.chain.upper[5], abs=2e-4)
    problem.objectives[0] = Objective(joint_position(goal), ObjectiveType.EQ, [7])
    result = problem.solve(home(), np.repeat(home()[None], 8, 0))
    assert not result.feasible and result.worst


def test_an_infeasible_path_names_the_pair():
    world, scene, boxes, problem, start, initial, goal = obstacle_problem()
    placed = next(iter(world.arms.values()))
    at_goal = multiply(placed.T_world_base, placed.arm.end_effector(goal))
    problem.collisions = with_links(world, (0.1 * np.ones(3), at_goal), min_distance=0.01)
    result = problem.solve(start, initial)
    assert not result.feasible
    assert "box 0" in result.worst or "joint_position" in result.worst


def test_a_target_that_is_no_number_is_infeasible():
    world = model("panda")
    problem = KomoProblem(world.chain, (4,), no_collisions())
    problem.add(Objective(joint_position(np.full(7, np.nan)), ObjectiveType.EQ, [3]))
    assert not problem.solve(home(), np.repeat(home()[None], 4, 0)).feasible


# --- verification


def brute_force(world, cols, path, masks):
    """Worst minimum distance violation of each configuration, every pair asked exactly."""
    return np.array([pair_violations(world.chain, cols, q, mask).max() for q, mask in zip(path, masks, strict=True)])


def pair_violations(chain, cols, q, mask):
    """Violation (P,) of each pair's min_distance, -inf for those that the mask leaves out."""
    R, p = frames(chain, q)
    found, witness = np.full(len(cols.a), -np.inf), np.zeros((3, 3))

    def shape(s):
        f = cols.frame[s]
        return cols.vertices[cols.start[s] : cols.start[s + 1]], R[f], p[f], cols.radius[s]

    for k in np.flatnonzero(cols.phases & mask):
        found[k] = cols.min_distance[k] - signed_distance(*shape(cols.a[k]), *shape(cols.b[k]), witness)
    return found


@pytest.mark.parametrize("floor", [0.0, -0.02])
def test_path_violations_are_those_of_brute_force(floor):
    """Along a path in which pairs come near, part, and jump: what was left alone must not be missed."""
    rng = np.random.default_rng(3)
    world = model("panda", "iiwa")
    boxes = [(rng.uniform(0.1, 0.3, 3), random_pose(rng, 0.7)) for _ in range(3)]
    scene = with_links(world, *boxes, min_distance=0.02, phases=0b01)
    links = [s for s, f in enumerate(scene.frames) if f]
    left = [s for s in links if scene.frames[s] <= 7]
    scene.keep_apart([s for s in left if scene.frames[s] > 4], [s for s in links if s not in left][2:], 0.01, 0b11)
    cols = scene.arrays()
    corners = [random_q(world.chain, rng) for _ in range(5)]
    path = np.concatenate([np.linspace(a, b, 25) for a, b in zip(corners, corners[1:], strict=False)])
    path = np.concatenate([path, [corners[0]], path[::7]])  # and jumps
    masks = rng.integers(1, 4, len(path))
    violation, pair = path_violations(path, masks, world.chain, cols, floor)
    expected = brute_force(world, cols, path, masks)
    above = expected > floor
    assert 0.1 < above.mean() < 0.95
    np.testing.assert_allclose(violation[above], expected[above], atol=5e-6)
    assert (pair[above] >= 0).all() and (pair[expected < floor - 1e-6] == -1).all()


def test_stretched_arms_that_sweep_are_not_missed():
    """Here points move nearly as fast as the bound says, so whatever is left alone for too long shows."""
    bases = pose(), pose((1.8, 0, 0), (0, 0, 1, 0))  # their tips overlap when they point at each other
    world = KinematicModel([PlacedArm(name, arm("iiwa"), T) for name, T in zip("ab", bases, strict=True)])
    stretched = np.array([0, np.pi / 2, 0, 0, 0, 0, 0])
    tip = world.arms["a"].arm.end_effector(stretched)
    scene = with_links(world, (0.1 * np.ones(3), tip), min_distance=0.005, phases=0b01)
    links = [s for s, f in enumerate(scene.frames) if f]
    left, right = ([s for s in links if (scene.frames[s] <= 7) == side] for side in (True, False))
    scene.keep_apart(left[-2:], right[-2:], 0.005, 0b10)
    cols = scene.arrays()
    path = np.tile(stretched, (150, 2))
    path[:, [0, 7]] = np.linspace(-2.5, 2.5, 150)[:, None]  # they meet at full speed
    for mask in (0b01, 0b10):
        masks = np.full(len(path), mask)
        expected = brute_force(world, cols, path, masks)
        violation, _ = path_violations(path, masks, world.chain, cols, 0.0)
        assert 3 <= (expected > 0.0).sum() <= 50
        np.testing.assert_allclose(violation, np.maximum(expected, 0.0), atol=5e-6)


def test_a_slider_that_moves_as_fast_as_the_bound_says_is_not_missed():
    """The tightest case: any pair that is left alone for longer than the bound allows is missed here."""
    turned = np.array([[[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]])  # the joint slides along x
    zero, one = np.zeros(1), np.ones(1)
    indices = np.zeros(1, np.int64), turned, np.zeros((1, 3)), np.ones(1, np.int64), np.zeros(2, np.int64)
    chain = Chain(*indices, zero, 3.0 * one, one)
    scene = CollisionModel()
    ball = scene.add("ball", np.zeros((1, 3)), 0.005, 1)
    marks = [scene.add(f"mark {x}", np.array([[x, 0.0, 0.0]]), 0.005, 0) for x in (0.3, 1.0, 2.0)]
    scene.keep_apart([ball], marks, 0.0)
    path = np.linspace(0.0, 2.5, 1501)[:, None]
    path = np.concatenate([path, path[::-1]])
    violation, pair = path_violations(path, np.ones(len(path), np.int64), chain, scene.arrays(), 0.0)
    expected = 0.01 - np.abs(path - [[0.3, 1.0, 2.0]])
    np.testing.assert_allclose(violation, np.maximum(0.0, expected.max(1)), atol=1e-9)
    hit = expected.max(1) > 1e-9
    np.testing.assert_array_equal(pair[hit], expected.argmax(1)[hit])


def test_relaxed_lets_a_start_be_where_it_is():
    world, scene, boxes, problem, start, initial, goal = obstacle_problem()
    cols = problem.arrays()
    q = initial[len(initial) // 2]  # in the post
    mask = np.array([1])
    before, _ = path_violations(q[None], mask, world.chain, cols, 0.0)
    assert before[0] > 0.0
    easier = relaxed(world.chain, cols, q, 1)
    assert path_violations(q[None], mask, world.chain, easier, 0.0)[1][0] == -1
    assert (easier.min_distance <= cols.min_distance).all()
    changed = easier.min_distance < cols.min_distance
    assert 0 < changed.sum() < len(changed)
    # by no more than what was missing
    assert (cols.min_distance - easier.min_distance).max() == pytest.approx(before[0] + RELAXATION, abs=1e-6)
    np.testing.assert_array_equal(relaxed(world.chain, cols, start, 1).min_distance, cols.min_distance)


def test_verification_allows_most_of_a_minimum_distance_and_never_half_a_millimetre_less():
    scene = CollisionModel()
    shape = scene.add("a", np.zeros((1, 3)), 0.1, 0)
    for min_distance in (0.003, 0.0003, 0.0, -0.0003):
        scene.keep_apart([shape], [shape], min_distance)
    np.testing.assert_allclose(verification(scene.arrays()).min_distance, [0.001, -0.0002, -0.0005, -0.0008])


def test_following_stops_at_a_jump_and_at_what_cannot_be_reached():
    world = model("panda")
    name, placed = next(iter(world.arms.items()))
    problem = ik_problem(world, name)
    T = multiply(placed.T_world_base, placed.arm.end_effector(home()))
    line = [multiply(T, pose((0.0, 0.01 * k, 0.0))) for k in range(10)]
    params = lambda poses: np.array([pose_params(world.T_tip_ee(name), T) for T in poses])  # noqa: E731
    path = follow_ik(problem, params(line), home(), 0.5)
    assert len(path) == 10
    assert np.abs(np.diff(path, axis=0)).max() < 0.2
    for q, goal in zip(path, line, strict=True):
        assert max(reached(world, name, q, goal)) < 1e-4
    jump = line[:4] + [multiply(line[4], pose(quaternion=(0, 0, 1, 1)))] + line[5:]
    assert len(follow_ik(problem, params(jump), home(), 0.5)) == 4
    assert len(follow_ik(problem, params(jump), home(), 3.0)) > 4
    away = line[:6] + [multiply(line[6], pose((3.0, 0, 0)))]
    assert len(follow_ik(problem, params(away), home(), 0.5)) == 6


def test_terms_are_unrolled_by_step():
    world = model("panda")
    problem = KomoProblem(world.chain, (2, 3), no_collisions())
    rows = [np.full(6, k) for k in range(3)]
    problem.add(Objective(relative_position(7), ObjectiveType.EQ, [4, 0, 2], params=rows))
    problem.add(Objective(joint_position(home()), ObjectiveType.SOS, [2]))
    terms = problem.terms()
    assert terms.step.tolist() == [0, 2, 2, 4]
    steps = terms.by_sample[problem.samples().first]  # all are at the steps, not between them
    assert steps.tolist() == [0, 1, 1, 3, 3, 4]
    starts = [terms.params[o] for o, kind in zip(terms.offset, terms.type, strict=True) if kind == 1]
    assert starts == [1.0, 2.0, 0.0]
    assert (problem.steps, problem.last(0), list(problem.span(1))) == (5, 1, [2, 3, 4])
    assert problem.phase_of_step().tolist() == [0, 0, 1, 1, 1]
