"""The broad phase over many collision pairs: it leaves out nothing that a look at each pair finds."""

import numpy as np
import pytest

from hmap_core.benchmark import many_parts
from hmap_core.komo import pair_blocks
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.pair_blocks import PairChecks, in_blocks
from hmap_core.komo.path_collisions import path_violations
from hmap_core.komo.sweep import between_violations
from hmap_core.planner.free_motion import plan_motion
from hmap_core.planner.transit import INTERVAL

RESOLUTION = 5e-4  # m


@pytest.fixture(scope="module")
def carrying():
    """An arm that carries a brick of about 60 parts, low beside a barrier of about 120, and where it shall bring it."""
    scene, state, ends = many_parts.attached(60, 120, 0)
    motion = plan_motion(scene, "arm", T_world_ee=ends[0], state=state, time_limit=60.0)
    state.q["arm"] = motion.trajectory.joints["arm"][-1]
    return scene, state, ends


def model_of(carrying):
    scene, state, _ = carrying
    manipulation = Manipulation(scene, state, "arm", None)
    return manipulation.model.chain, manipulation.standing_collisions().arrays(), state.q["arm"]


def paths(chain, q, count):
    """Random walks through configurations, some of which collide."""
    rng = np.random.default_rng(1)
    for _ in range(count):
        steps = rng.uniform(-INTERVAL, INTERVAL, (12, len(q)))
        yield np.clip(q + np.cumsum(np.concatenate([np.zeros((1, len(q))), steps]), axis=0), chain.lower, chain.upper)


def test_blocks_hold_each_pair_once_with_balls_round_their_shapes(carrying):
    _, cols, _ = model_of(carrying)
    assert len(cols.a) > pair_blocks.MANY_PAIRS
    more, blocks = in_blocks(cols)
    assert sorted(blocks.order.tolist()) == list(range(len(cols.a)))
    np.testing.assert_array_equal(cols.a[blocks.order], more.a)
    assert len(blocks.a) < len(cols.a) / 10
    for i in range(len(blocks.a)):
        own = slice(blocks.first[i], blocks.first[i + 1])
        assert blocks.need[i] == more.min_distance[own].max()
        for cluster, shapes in ((blocks.a[i], more.a[own]), (blocks.b[i], more.b[own])):
            away = np.linalg.norm(more.center[shapes] - more.center[cluster], axis=1) + more.bound[shapes]
            assert away.max() <= more.bound[cluster] + 1e-12
            assert (more.frame[shapes] == more.frame[cluster]).all()


def test_paths_violate_what_they_do_when_each_pair_is_looked_at(carrying):
    chain, cols, q = model_of(carrying)
    checks, hits = PairChecks(chain, cols), 0
    for path in paths(chain, q, 20):
        masks = np.ones(len(path), np.int64)
        plain, blocked = path_violations(path, masks, chain, cols, 0.0), checks.along(path, masks, 0.0)
        np.testing.assert_allclose(plain[0], blocked[0], atol=1e-6)
        np.testing.assert_array_equal(plain[1] >= 0, blocked[1] >= 0)
        plain = between_violations(path, masks[1:], chain, cols, RESOLUTION)
        blocked = checks.between(path, masks[1:], RESOLUTION)
        np.testing.assert_allclose(plain[0], blocked[0], atol=RESOLUTION)
        assert ((plain[0] > RESOLUTION) <= (blocked[1] >= 0)).all()
        hits += int((plain[1] >= 0).sum())
    assert 20 < hits < 200


def test_pairs_that_come_near_are_among_those_that_are_named_near(carrying):
    chain, cols, q = model_of(carrying)
    checks = PairChecks(chain, cols)
    path = next(paths(chain, q, 1))
    near = checks.near(path, 0.02)
    assert 0 < near.sum() < 0.5 * len(near)
    only = cols._replace(min_distance=cols.min_distance + 0.02, phases=np.where(near, 0, cols.phases))
    assert (path_violations(path, np.ones(len(path), np.int64), chain, only, 0.0)[1] < 0).all()


def test_a_body_of_many_parts_is_carried_past_many_parts(carrying, monkeypatch):
    """With blocks and without them."""
    scene, state, ends = carrying
    found = []
    for many in (pair_blocks.MANY_PAIRS, 10**9):
        for module in ("komo.pair_blocks", "planner.segments.transits"):
            monkeypatch.setattr(f"hmap_core.{module}.MANY_PAIRS", many)
        motion = plan_motion(scene, "arm", T_world_ee=ends[1], state=state, seed=0, time_limit=60.0)
        found.append(motion.trajectory.joints["arm"])
    assert all(len(q) > 50 for q in found)
