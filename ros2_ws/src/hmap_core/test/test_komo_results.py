"""What a solve says of itself: how it ended, what is violated, and what restarts, a limit and an old plan change."""

import numpy as np
import pytest
from core_fixtures import model, no_collisions
from test_komo_solver import BOX, home, ik_problem, obstacle_problem, reached, with_links

from hmap_core.collision.scene_model import CollisionModel
from hmap_core.exceptions import InputError
from hmap_core.kinematics import FreeBody, Freedom, KinematicModel
from hmap_core.komo.features import joint_position, pose_params, relative_pose
from hmap_core.komo.ik import solve_ik
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.options import SolverOptions
from hmap_core.komo.result import Status
from hmap_core.komo.transcription import KomoProblem
from hmap_core.transforms import IDENTITY, multiply, pose

EQ, INEQ = ObjectiveType.EQ, ObjectiveType.INEQ
START, GOAL = np.array([-0.3, 0.0, 0.0]), np.array([0.3, 0.0, 0.0])
WALL = np.array([0.05, 0.4, 0.1])  # m: across the straight way, longer than thick
PIN = np.array([0.01, 0.02, 0.1])  # m: thinner than a step is long
BESIDE = (0.0, 0.02)  # m: the middle of the pin, not on the straight way


def disc_problem(obstacle=WALL, at=(0.0, 0.0), steps=8, **options) -> KomoProblem:
    """A disc in the plane that goes from START to GOAL past an obstacle of that size."""
    body = FreeBody("disc", Freedom.PLANAR, pose(), -np.ones(2), np.ones(2), 0.02)
    world = KinematicModel([body])
    scene = CollisionModel()
    disc = scene.add("disc", np.zeros((1, 3)), 0.02, world.tip("disc"))
    scene.keep_apart([disc], [scene.add("obstacle", BOX * obstacle + [*at, 0.0], 0.0, 0)], 0.003)
    problem = KomoProblem(world.chain, (steps,), scene, SolverOptions(**options))
    problem.add_objective(joint_position(GOAL), EQ, (1.0,))
    return problem


def jump(**options) -> KomoProblem:
    """A pin that a straight path has between two steps, where no sample looks."""
    return disc_problem(PIN, BESIDE, steps=3, substeps=1, coarse=0, **options)


# --- status


@pytest.mark.parametrize(
    "problem, arguments, status",
    [
        (disc_problem(np.full(3, 0.01)), {"restarts": 2}, Status.FEASIBLE),
        (disc_problem(at=GOAL[:2]), {}, Status.INFEASIBLE),
        (jump(refinements=0), {}, Status.BETWEEN_STEPS),
        (jump(), {}, Status.FEASIBLE),
        (jump(), {"time_limit": 0.0}, Status.TIME_LIMIT),
        (disc_problem(), {"restarts": 5, "time_limit": 0.0}, Status.TIME_LIMIT),
    ],
    ids=["free", "goal inside", "not refined", "refined", "no time to refine", "no time to restart"],
)
def test_how_it_ended(problem, arguments, status):
    result = problem.solve(START, **arguments)
    assert result.status == status, result.worst
    assert result.feasible == (status == Status.FEASIBLE) == (result.worst == "")
    assert result.path.shape == (problem.steps, 3)
    assert result.iterations > 0
    if arguments.get("time_limit") == 0.0:
        assert result.attempts == 1


def test_restarts_find_the_way_that_the_straight_guess_misses():
    alone, again = disc_problem().solve(START), disc_problem().solve(START, restarts=8)
    assert not alone.feasible and alone.attempts == 1
    assert again.feasible and 1 < again.attempts <= 9
    assert again.iterations > alone.iterations
    assert np.abs(again.path[:, 1]).max() > WALL[1] / 2  # round the end of the wall
    np.testing.assert_allclose(again.path[-1], GOAL, atol=1e-4)


def test_restarts_are_repeatable_and_leave_nothing_behind():
    first, second = disc_problem(), disc_problem()
    a = first.solve(START, restarts=8, rng=np.random.default_rng(3))
    b = second.solve(START, restarts=8, rng=np.random.default_rng(3))
    again = first.solve(START, restarts=8, rng=np.random.default_rng(3))
    for other in (b, again):
        np.testing.assert_array_equal(a.path, other.path)
        assert (a.iterations, a.attempts) == (other.iterations, other.attempts)


def test_an_earlier_plan_makes_the_next_one_cheap():
    """Another goal, a little beside: the path goes on from the old one."""
    _, _, _, problem, start, initial, goal = obstacle_problem()
    before = problem.solve(start, initial)
    beside = goal + 0.02 * np.array([1, -1, 1, -1, 1, -1, 1])
    problem.objectives[0] = Objective(joint_position(beside), EQ, [problem.steps - 1])
    scratch = start + np.linspace(0, 1, problem.steps + 1)[1:, None] * (beside - start)
    anew, warm = problem.solve(start, scratch), problem.solve(start, before.path)
    assert before.feasible and anew.feasible and warm.feasible
    np.testing.assert_allclose(warm.path[-1], beside, atol=1e-4)
    assert warm.iterations < anew.iterations


# --- what is violated


def out_of_reach(phases, when) -> KomoProblem:
    world = model("panda")
    problem = KomoProblem(world.chain, phases, no_collisions())
    tip = world.tip(next(iter(world.arms)))
    problem.add_objective(relative_pose(tip, IDENTITY, pose((3.0, 0, 0))), EQ, when)
    return problem


@pytest.mark.parametrize("phases, when", [((4,), 1), ((3, 5), 1), ((3, 5), 2)])
def test_an_objective_is_named_with_its_frames_and_its_time(phases, when):
    worst = out_of_reach(phases, (when,)).solve(home(), np.repeat(home()[None], sum(phases), 0)).worst
    assert worst.startswith("eq relative_pose[0] of frames 7, 0 off by 2.")
    assert worst.endswith(f"at time {when}.00")


def test_a_pair_is_named_with_its_depth_and_its_time():
    problem = jump(refinements=0)
    result = problem.solve(START)
    assert result.worst.startswith("disc and obstacle closer than allowed by") and "mm" in result.worst
    assert 0.0 < float(result.worst.rsplit(" ", 1)[1]) < 1.0
    assert result.worst_inequality > 0.005


def test_a_joint_limit_is_named():
    problem = disc_problem(PIN, iterations=0, inner=0, outer=1, coarse=0)
    problem.objectives.clear()
    path = np.tile(START, (8, 1))
    path[5, 0] = 1.9
    result = problem.solve(START, path)
    assert result.status == Status.INFEASIBLE
    assert result.worst == "joint 1 exceeds its limit by 0.9 at time 0.75"


# --- what may be asked


@pytest.mark.parametrize(
    "times, steps",
    [
        ((), range(8)),
        ((0.0,), range(1)),
        ((1.0,), range(2, 3)),
        ((2.0,), range(7, 8)),
        ((0.0, 1.0), range(3)),
        ((1.0, 2.0), range(3, 8)),
        ((1.0, 1.0), range(2, 3)),
        ((1.6, 2.0), range(6, 8)),
    ],
    ids=str,
)
def test_times_in_phases_are_steps(times, steps):
    problem = KomoProblem(model("panda").chain, (3, 5), no_collisions())
    assert problem.steps_at(times) == steps
    problem.add_objective(joint_position(home()), EQ, times)
    assert list(problem.objectives[-1].steps) == list(steps)


@pytest.mark.parametrize("times", [(-0.1,), (2.1,), (1.0, 0.5), (0.0, 1.0, 2.0), (float("nan"),)], ids=str)
def test_times_outside_of_the_phases_are_errors(times):
    problem = KomoProblem(model("panda").chain, (3, 5), no_collisions())
    with pytest.raises(InputError, match="0 to 2"):
        problem.add_objective(joint_position(home()), EQ, times)
    assert not problem.objectives


@pytest.mark.parametrize(
    "change, says",
    [
        ({"order": 3}, "order 3; allowed: 0 to 2"),
        ({"order": -1}, "order -1"),
        ({"target": np.zeros(6)}, r"\(6,\); it has to be \(7,\)"),
        ({"scale": 0.0}, "scale 0.0"),
        ({"scale": float("nan")}, "scale nan"),
        ({"steps": [0, 4]}, "steps 0 to 4; allowed: 0 to 3"),
        ({"steps": [-1]}, "steps -1 to -1"),
    ],
)
def test_an_objective_that_does_not_fit_is_an_error(change, says):
    problem = KomoProblem(model("panda").chain, (4,), no_collisions())
    with pytest.raises(InputError, match=says) as error:
        problem.add(Objective(joint_position(home()), **{"type": INEQ, "steps": [0], **change}))
    assert "joint_position" in str(error.value)
    assert not problem.objectives


# --- one configuration


def test_ik_from_one_start_after_the_other():
    """The first is at home beside the goal's configuration, the second in it: who is feasible first is taken."""
    world = model("panda")
    name, placed = next(iter(world.arms.items()))
    rng = np.random.default_rng(4)
    configuration = rng.uniform(world.chain.lower + 0.3, world.chain.upper - 0.3)
    goal = multiply(placed.T_world_base, placed.arm.end_effector(configuration))
    params = pose_params(world.T_tip_ee(name), goal)
    starts = np.concatenate([rng.uniform(world.chain.lower, world.chain.upper, (8, world.n)), configuration[None]])
    q = solve_ik(ik_problem(world, name), params, starts, home())
    assert q is not None and max(reached(world, name, q, goal)) < 1e-4
    alone = solve_ik(ik_problem(world, name), params, configuration[None])  # stays near itself
    np.testing.assert_allclose(alone, configuration, atol=1e-4)
    pulled = solve_ik(ik_problem(world, name), params, configuration[None], home())
    assert np.linalg.norm(pulled - home()) < np.linalg.norm(alone - home()) - 1e-3
    away = pose_params(world.T_tip_ee(name), pose((3.0, 0, 0)))
    assert solve_ik(ik_problem(world, name), away, starts, home()) is None
    blocked = with_links(world, (0.1 * np.ones(3), goal), min_distance=0.005)
    assert solve_ik(ik_problem(world, name, blocked), params, starts, home()) is None
