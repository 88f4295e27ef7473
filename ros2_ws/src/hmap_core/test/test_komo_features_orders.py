"""Features over time: differences of order 1 and 2, what comes before the path, targets, and the time of a step."""

import numpy as np
import pytest
from core_fixtures import no_collisions, random_pose, random_q
from komo_fixtures import WORLDS, evaluate, world_of
from test_komo_features import BETWEEN, links

from hmap_core.komo.features import joint_limits, joint_position, joint_rate_limits, pose_params, relative_pose, stable
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.options import SolverOptions
from hmap_core.komo.transcription import KomoProblem

PHASES = (2, 3)
STEPS = sum(PHASES)
TAU = 0.1  # s
STEP = 1e-6  # rad, m
# A path moves by STEP_SIZE per step, so that differences over TAU^2 do not drown in rounding.
STEP_SIZE = 0.2  # rad, m
BOUND = {0: 1e-8, 1: 1e-7, 2: 1e-6}  # rounding over STEP, which the division by TAU^order makes larger
# To the optimum, not to what is good enough.
CONVERGED = SolverOptions(mu=1.0, mu_growth=2.0, tolerance=1e-7, outer=100, iterations=2000, step_tolerance=1e-6,
                          gain_tolerance=1e-9)  # fmt: skip


def random_path(chain, rng):
    """A configuration (n,) and a path (STEPS, n) from there."""
    moves = STEP_SIZE * rng.normal(size=(STEPS + 1, len(chain.lower)))
    whole = np.clip(random_q(chain, rng) + np.cumsum(moves, axis=0), chain.lower, chain.upper)
    return whole[0], whole[1:]


def expected_values(problem, path, start):
    """The rows of the linearisation, by differences of what the kernels say at each configuration."""
    whole = np.concatenate([[start, start], path])
    found = {}
    for index, objective in enumerate(problem.objectives):
        for row, step in enumerate(objective.steps):
            values = []
            for k in range(objective.order + 1):
                feature = objective.feature
                if objective.params is not None:
                    feature = type(feature)(
                        feature.name, feature.kernel, feature.dim, feature.frames, np.asarray(objective.params[row])
                    )
                values.append(evaluate(feature, problem.chain, whole[step + 2 - k])[0])
            value = {
                0: lambda v: v[0],
                1: lambda v: (v[0] - v[1]) / TAU,
                2: lambda v: (v[0] - 2 * v[1] + v[2]) / TAU**2,
            }[objective.order](values)
            target = 0.0 if objective.target is None else objective.target
            for component, number in enumerate(value - target):
                found[index, int(step), component] = number
    return found


def assert_linearised(problem, path, start):
    """Values are those differences, and the Jacobian is their derivative by every step of the path."""
    linear = problem.linearise(path, start)
    expected = expected_values(problem, path, start)
    assert sorted(linear.rows) == sorted(expected)
    order = np.array([problem.objectives[index].order for index, _, _ in linear.rows])
    np.testing.assert_allclose(linear.values, [expected[row] for row in linear.rows], rtol=1e-9, atol=1e-9)
    columns = []
    for step in STEP * np.eye(path.size):
        ends = [problem.linearise((path.ravel() + s * step).reshape(path.shape), start).values for s in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2 * STEP))
    error = np.abs(linear.jacobian - np.array(columns).T).max(axis=1)
    assert (error <= np.array([BOUND[k] for k in order])).all(), error


@pytest.mark.parametrize("names", WORLDS, ids="+".join)
@pytest.mark.parametrize("order", [0, 1, 2])
def test_differences_of_every_feature(names, order):
    """At the first steps of the path too, before which the start stands still."""
    rng = np.random.default_rng(order)
    world = world_of(*names)
    problem = KomoProblem(world.chain, PHASES, no_collisions(), tau=TAU)
    for kind in BETWEEN:
        if kind in ("distance", "clearance", "relative_pose"):
            continue  # below: where the nearest piece changes, or at half a turn, a difference has no derivative
        frame, reference = links(world)[-1]
        feature = BETWEEN[kind](rng, frame, reference)
        target = rng.normal(size=feature.dim)
        problem.add(Objective(feature, ObjectiveType.EQ, range(STEPS), 2.0, target=target, order=order))
    problem.add(Objective(joint_position(np.zeros(2), 1), ObjectiveType.SOS, [0, 3], order=order))
    start, path = random_path(world.chain, rng)
    assert_linearised(problem, path, start)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("kind", ["distance", "clearance", "relative_pose"])
def test_differences_of_what_is_smooth_in_pieces(kind, order):
    rng = np.random.default_rng(10 + order)
    world = world_of("panda", "spatial")
    problem = KomoProblem(world.chain, PHASES, no_collisions(), tau=TAU)
    feature = BETWEEN[kind](rng, world.tip("panda_0"), world.tip("spatial_1"))
    problem.add(Objective(feature, ObjectiveType.INEQ, range(STEPS), order=order))
    start, path = random_path(world.chain, rng)
    assert_linearised(problem, path, start)


def test_orders_types_and_parameters_by_step_stand_side_by_side():
    """Objectives of all orders in one problem, some with parameters of their own at each step."""
    rng = np.random.default_rng(5)
    world = world_of("iiwa", "planar")
    problem = KomoProblem(world.chain, PHASES, no_collisions(), tau=TAU)
    params = [pose_params(random_pose(rng, 0.1), random_pose(rng, 0.5)) for _ in range(2)]
    problem.add(
        Objective(relative_pose(7, random_pose(rng, 0), random_pose(rng, 0)), ObjectiveType.EQ, [4, 1], 1.0, params)
    )
    problem.add(Objective(stable(10, 7), ObjectiveType.EQ, problem.span(1), order=1))
    problem.add(Objective(joint_limits(-np.ones(3), np.ones(3), 7), ObjectiveType.INEQ, [0, 2]))
    problem.add(Objective(joint_position(np.zeros(10)), ObjectiveType.SOS, range(STEPS), order=2))
    start, path = random_path(world.chain, rng)
    assert_linearised(problem, path, start)


def test_a_path_at_rest_has_no_differences():
    world = world_of("panda", "spatial")
    problem = KomoProblem(world.chain, PHASES, no_collisions(), tau=TAU)
    for order in (1, 2):
        problem.add(Objective(stable(7, 13), ObjectiveType.EQ, range(STEPS), order=order))
    start = random_q(world.chain, np.random.default_rng(6))
    linear = problem.linearise(np.tile(start, (STEPS, 1)), start)
    np.testing.assert_allclose(linear.values, 0.0, atol=1e-9)


def test_velocity_limits_are_kept():
    """Two joints that have to go far in few steps go as fast as they may."""
    world = world_of("panda")
    home = next(iter(world.arms.values())).arm.model.home
    problem = KomoProblem(world.chain, (10,), no_collisions(), CONVERGED, tau=TAU)
    feature, target = joint_rate_limits([-1.0, -0.5], [1.0, 0.5], 2)
    problem.add(Objective(feature, ObjectiveType.INEQ, range(10), target=target, order=1))
    goal = home + np.array([0, 0, 0.95, -0.45, 0, 0, 0.3])
    problem.add(Objective(joint_position(goal), ObjectiveType.EQ, [9]))
    result = problem.solve(home, home + np.linspace(0.1, 1, 10)[:, None] * (goal - home))
    assert result.feasible, result.worst
    speed = np.abs(np.diff(np.concatenate([home[None], result.path]), axis=0)) / TAU
    tolerance = problem.options.tolerance
    assert speed[:, 2].max() == pytest.approx(1.0, abs=10 * tolerance)
    assert speed[:, 3].max() == pytest.approx(0.5, abs=10 * tolerance)
    assert np.abs(result.path[-1] - goal).max() <= 2 * tolerance
