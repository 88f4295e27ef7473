"""Features from CasADi expressions: derivatives, both evaluators, the cache, threads, and the solver using one."""

import subprocess
from concurrent.futures import ThreadPoolExecutor

import casadi
import numpy as np
import pytest
from core_fixtures import model, no_collisions, random_pose
from komo_fixtures import assert_derivative, configurations, evaluate

from hmap_core.exceptions import InputError
from hmap_core.komo.features import above, relative_position, symbolic_feature
from hmap_core.komo.features.base import MAX_DIM
from hmap_core.komo.features.symbolic import find_compiler, library, symbolic_map
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.options import IK_OPTIONS
from hmap_core.komo.transcription import KomoProblem
from hmap_core.transforms import apply, from_rpy, inverse, multiply, pose, rotation_matrix

EVALUATORS = {"compiled": True, "interpreted": False}


@pytest.fixture(params=EVALUATORS, ids=list(EVALUATORS))
def use_compiler(request):
    if EVALUATORS[request.param] and find_compiler() is None:
        pytest.skip("no C compiler")
    return EVALUATORS[request.param]


def seen_from(frames, params):
    """Written as relative_position is."""
    body, reference = frames
    return reference.rotation.T @ (body.position + body.rotation @ params[:3] - reference.position) - params[3:]


def three_frames(frames, params):
    """Every entry of three frames matters, without a parameter."""
    a, b, c = frames
    turn = casadi.trace(a.rotation.T @ b.rotation @ c.rotation)
    return casadi.vertcat(casadi.sin(turn), casadi.dot(a.position, b.position) + casadi.norm_2(c.position), turn**2)


@pytest.mark.parametrize("names", [("panda",), ("iiwa", "panda")], ids="+".join)
def test_jacobians_are_the_derivatives(names, use_compiler):
    rng = np.random.default_rng(1)
    world = model(*names)
    ends = world.tip(list(world.arms)[0]), world.tip(list(world.arms)[-1])
    features = [
        symbolic_feature("seen from", seen_from, (ends[0], 0), rng.normal(size=6), use_compiler=use_compiler),
        symbolic_feature("seen from", seen_from, (3, ends[1]), rng.normal(size=6), use_compiler=use_compiler),
        symbolic_feature("three frames", three_frames, (ends[0], 4, ends[1]), use_compiler=use_compiler),
        *above(ends[0], random_pose(rng, 0.2), 0.05, random_pose(rng, 0.5), (0.2, 0.1), ends[1] - 2),
    ]
    for q in configurations(world.chain, rng):
        for feature in features:
            assert_derivative(feature, world.chain, q, 1e-7)  # the third derivatives of ``three_frames`` are large


def test_it_equals_the_feature_written_by_hand(use_compiler):
    rng = np.random.default_rng(2)
    world = model("iiwa", "panda")
    for _ in range(5):
        offset, target, q = rng.normal(size=3), rng.normal(size=3), rng.uniform(world.chain.lower, world.chain.upper)
        params = np.concatenate([offset, target])
        ours = symbolic_feature("seen from", seen_from, (7, 12), params, use_compiler=use_compiler)
        theirs = relative_position(7, offset, target, 12)
        for a, b in zip(evaluate(ours, world.chain, q), evaluate(theirs, world.chain, q), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-12)


def test_above_says_what_it_says():
    world = model("panda")
    q = np.array([0.1, -0.4, 0.2, -2.0, 0.3, 1.6, 0.5])
    base, arm = next(iter(world.arms.values())).T_world_base, next(iter(world.arms.values())).arm
    tip = multiply(base, multiply(arm.end_effector(q), inverse(world.T_tip_ee("panda_0"))))
    T_support = from_rpy((0.4, 0.2, 0.3), (0.0, 0.0, 0.4))
    T_object = multiply(T_support, from_rpy((0.03, -0.02, 0.07), (0.0, 0.0, 1.0)))  # 2 cm over it, turned
    offset = multiply(inverse(tip), T_object)
    standing, within = above(7, offset, 0.05, T_support, (0.1, 0.05))
    r, _ = evaluate(standing, world.chain, q)
    np.testing.assert_allclose(r, [0.02, 0, 0, 0], atol=1e-9)
    r, _ = evaluate(within, world.chain, q)
    np.testing.assert_allclose(r, [-0.07, -0.07, -0.13, -0.03], atol=1e-9)


def test_the_solver_stands_an_object_on_a_tilted_table(use_compiler, monkeypatch):
    """Anywhere on the rectangle, upright, bottom on the surface, while a cost pulls beyond the edge."""
    if not use_compiler:
        monkeypatch.setattr("hmap_core.komo.features.symbolic.find_compiler", lambda: None)
    world = model("panda")
    placed = next(iter(world.arms.values()))
    T_support = multiply(placed.T_world_base, from_rpy((0.5, 0.1, 0.1), (0.1, -0.1, 0.3)))
    T_ee_object = from_rpy((0.0, 0.0, 0.03), (np.pi, 0.0, 0.2))
    T_tip_object = multiply(world.T_tip_ee("panda_0"), T_ee_object)
    standing, within = above(world.tip("panda_0"), T_tip_object, 0.04, T_support, (0.08, 0.06))
    far = apply(T_support, [0.5, 0.0, 0.04])
    problem = KomoProblem(world.chain, (1,), no_collisions(), IK_OPTIONS)
    problem.add(Objective(standing, ObjectiveType.EQ, [0]))
    problem.add(Objective(within, ObjectiveType.INEQ, [0]))
    pull = relative_position(world.tip("panda_0"), T_tip_object[:3], far)
    problem.add(Objective(pull, ObjectiveType.SOS, [0], scale=10.0))
    home = placed.arm.model.home
    result = problem.solve(home, home[None])
    assert result.feasible, result.worst
    T_object = multiply(multiply(placed.T_world_base, placed.arm.end_effector(result.path[0])), T_ee_object)
    local = multiply(inverse(T_support), T_object)
    np.testing.assert_allclose(rotation_matrix(local)[:, 2], [0, 0, 1], atol=1e-3)
    assert local[2] == pytest.approx(0.04, abs=1e-3)
    assert local[0] == pytest.approx(0.08, abs=1e-3)  # at the edge that it is pulled to
    assert abs(local[1]) <= 0.0601


def test_threads_do_not_meet(use_compiler):
    """Values from many threads at once are those of one."""
    rng = np.random.default_rng(3)
    world = model("iiwa", "panda")
    cases = []
    for _ in range(200):
        params = rng.normal(size=6)
        feature = symbolic_feature("seen from", seen_from, (7, 14), params, use_compiler=use_compiler)
        cases.append((feature, rng.uniform(world.chain.lower, world.chain.upper)))
    expected = [evaluate(feature, world.chain, q) for feature, q in cases]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda case: [evaluate(case[0], world.chain, case[1]) for _ in range(5)], cases))
    for (r, J), several in zip(expected, found, strict=True):
        for r_found, J_found in several:
            np.testing.assert_array_equal(r, r_found)
            np.testing.assert_array_equal(J, J_found)


def test_solvers_in_two_threads_find_what_one_finds(use_compiler):
    world = model("panda")
    home = next(iter(world.arms.values())).arm.model.home

    def solved(k):
        problem = KomoProblem(world.chain, (6,), no_collisions())
        params = [0.0, 0.0, 0.1, 0.4, 0.02 * k, 0.5]
        feature = symbolic_feature("seen from", seen_from, (7, 0), params, use_compiler=use_compiler)
        problem.add(Objective(feature, ObjectiveType.EQ, [5]))
        return problem.solve(home, np.repeat(home[None], 6, 0)).path

    expected = [solved(k) for k in range(6)]
    with ThreadPoolExecutor(2) as pool:
        for a, b in zip(expected, pool.map(solved, range(6)), strict=True):
            np.testing.assert_array_equal(a, b)


@pytest.mark.skipif(find_compiler() is None, reason="no C compiler")
def test_a_library_is_compiled_once(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    function = symbolic_map("seen from", seen_from, 2, 6, None).function
    file = library(function, find_compiler())
    assert file is not None and tmp_path in file.parents

    def fail(*args, **kwargs):
        raise AssertionError("compiled again")

    monkeypatch.setattr(subprocess, "run", fail)
    assert library(function, find_compiler()) == file


def test_a_compiler_that_fails_is_done_without(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    made = symbolic_map("seen from, with a broken compiler", seen_from, 2, 6, "/bin/false")
    assert not made.compiled and not list(tmp_path.rglob("*.so"))


def test_where_there_is_no_compiler_it_works_without(monkeypatch):
    monkeypatch.setenv("PATH", "")
    monkeypatch.setenv("CC", "no-such-compiler")
    assert find_compiler() is None
    world = model("panda")
    without = above(7, pose(), 0.05, pose(), (0.2, 0.1))
    monkeypatch.undo()
    for feature, other in zip(without, above(7, pose(), 0.05, pose(), (0.2, 0.1)), strict=True):
        for ours, theirs in zip(*(evaluate(f, world.chain, np.full(7, 0.3)) for f in (feature, other)), strict=True):
            np.testing.assert_allclose(ours, theirs, atol=1e-12)


def test_a_compiler_is_asked_for_where_the_user_says(tmp_path, monkeypatch):
    mine = tmp_path / "mycc"
    mine.touch(mode=0o755)
    monkeypatch.setenv("CC", str(mine))
    assert find_compiler() == str(mine)


def test_too_much_is_refused():
    with pytest.raises(InputError, match="4 frames; allowed: 1 to 3"):
        symbolic_feature("too wide", three_frames, (1, 2, 3, 4))
    with pytest.raises(InputError, match=f"{MAX_DIM + 1} components; allowed: 1 to {MAX_DIM}"):
        symbolic_feature("too long", lambda frames, params: casadi.repmat(frames[0].position[0], MAX_DIM + 1, 1), (1,))


def test_constants_have_no_slope(use_compiler):
    """Structural zeros are filled in."""
    world = model("panda")
    feature = symbolic_feature("constant", constant, (7,), use_compiler=use_compiler)
    r, J = evaluate(feature, world.chain, np.zeros(7))
    np.testing.assert_array_equal(r, [0.0, 2.0])
    np.testing.assert_array_equal(J, 0.0)


def constant(frames, params):
    return casadi.vertcat(casadi.SX(0), 2.0)


def test_pose_of_the_world_is_the_identity(use_compiler):
    feature = symbolic_feature("world", world_rotation, (0,), use_compiler=use_compiler)
    r, _ = evaluate(feature, model("panda").chain, np.zeros(7))
    np.testing.assert_array_equal(r, np.concatenate([pose()[:3], np.eye(3).reshape(-1)]))


def world_rotation(frames, params):
    return casadi.vertcat(frames[0].position, casadi.vec(frames[0].rotation.T))
