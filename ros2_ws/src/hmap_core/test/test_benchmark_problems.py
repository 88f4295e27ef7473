"""The benchmark's problems: the same seed gives the same instance, starts are free, and what we claim is true."""

import numpy as np
import pytest

from hmap_core.benchmark.instances import MotionInstance
from hmap_core.benchmark.judge import judge
from hmap_core.benchmark.problems.common import panda
from hmap_core.benchmark.registry import PROBLEMS
from hmap_core.benchmark.sampling import configurations_at, end_effector

MOTIONS = {name: p for name, p in PROBLEMS.items() if isinstance(p.instance(0), MotionInstance)}
MANY = 400  # instances over all problems


@pytest.mark.parametrize("name", MOTIONS)
def test_seeds(name):
    one, same, other = (MOTIONS[name].instance(seed) for seed in (3, 3, 4))
    for a, b in zip(one.targets, same.targets, strict=True):
        assert np.array_equal(a.T_world_ee, b.T_world_ee)
    assert [b.pose.tolist() for b in one.scene.bodies.values()] == [b.pose.tolist() for b in same.scene.bodies.values()]
    assert not np.allclose(one.targets[0].T_world_ee, other.targets[0].T_world_ee)


@pytest.mark.parametrize("name", MOTIONS)
def test_starts_are_free_and_solutions_are_not_given_away(name):
    for seed in range(3):
        instance = MOTIONS[name].instance(seed)
        still = np.repeat(instance.start[None], instance.steps + 1, axis=0)
        found = judge(instance, still)
        assert found and all("misses the target" in text for text in found)


def test_configurations_reach_their_pose():
    robot, rng = panda(), np.random.default_rng(1)
    T = end_effector(robot, np.array([0.4, 0.2, -0.3, -1.9, 0.2, 2.0, 0.5]))
    found = configurations_at(robot, T, rng)
    assert len(found) > 3
    for q in found:
        assert np.allclose(end_effector(robot, q)[:3], T[:3], atol=1e-5)
    lower, upper = robot.model.position_limits
    assert (found >= lower).all() and (found <= upper).all()


@pytest.mark.parametrize("name", MOTIONS)
def test_we_claim_nothing_that_is_wrong(name):
    assert _claims(name, range(2)) > 0


@pytest.mark.slow
@pytest.mark.parametrize("name", MOTIONS)
def test_we_claim_nothing_that_is_wrong_in_many(name):
    each = -(-MANY // len(MOTIONS))
    # some contacts on surfaces cannot be reached; of all else nearly everything is solved
    assert _claims(name, range(100, 100 + each)) > each // 4


def _claims(name: str, seeds) -> int:
    """How many instances our side claims to have solved, each of which has to be."""
    problem, claims = MOTIONS[name], 0
    for seed in seeds:
        instance = problem.instance(seed)
        answer = problem.hmap.solve(instance, problem.hmap.prepare(instance))
        if answer.claimed:
            assert problem.judge(instance, answer.path) == [], f"{name}, seed {seed}"
            claims += 1
    return claims
