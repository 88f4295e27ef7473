"""The judge's bounds for many pairs at once clear nothing that a look at every sample would not."""

import math

import numpy as np
import pytest
import validation_fixtures as plans
from scipy.spatial.transform import Rotation

from hmap_core.validation import collision, contacts, document, judge, limits, pairs, rigid, support
from hmap_core.validation.bounds import Bounds, PartBoxes
from hmap_core.validation.pairs import PairBuilder
from hmap_core.validation.report import Findings
from hmap_core.validation.world import World


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    return plans.write_gantry(tmp_path_factory.mktemp("gantry"))


@pytest.fixture(scope="module", params=[plans.carry, plans.touch, plans.push, plans.tool_use])
def world(urdf, request):
    return World(document.read(request.param(urdf)))


def measured(world, pair):
    """Distances (N,) of a pair at every sample."""
    a, b = world.tracks[pair.a], world.tracks[pair.b]
    return np.array([pair.gauge.distance(a.at(k), b.at(k)) for k in range(world.samples)])


def made(world):
    return PairBuilder(world, set()).build()


def test_gaps_of_boxes_are_lower_bounds_at_every_sample(world):
    boxes, samples = PartBoxes(world), np.arange(world.samples)
    for pair in made(world):
        a, b = boxes.rows([pair])
        assert np.all(boxes.gaps(a, b, samples) <= measured(world, pair) + 1e-9)


@pytest.mark.parametrize("threshold", [-1e-3, 0.0, 0.02, 0.2])
def test_steps_that_are_not_suspicious_stay_above_the_threshold(world, threshold):
    pairs = [pair for pair in made(world) if pair.moves]
    runs = Bounds(world, PartBoxes(world), pairs).uncleared(np.full(len(pairs), threshold))
    cleared = 0
    for i, pair in enumerate(pairs):
        clear = np.ones(world.samples - 1, bool)
        for first, last in runs.get(i, ()):
            assert 0 <= first < last < world.samples
            assert clear[first:last].all(), "runs overlap"
            clear[first:last] = False
        distance = measured(world, pair)
        assert np.all(np.minimum(distance[:-1], distance[1:])[clear] >= threshold - 1e-9)
        cleared += clear.sum()
    assert cleared > 0


def test_nothing_is_suspicious_where_all_is_far(world):
    pairs = [pair for pair in made(world) if pair.moves and measured(world, pair).min() > 0.3]
    assert pairs
    assert Bounds(world, PartBoxes(world), pairs).uncleared(np.zeros(len(pairs))) == {}


def test_the_clearance_is_the_smallest_measured_distance(world):
    pairs = made(world)
    smallest = min(measured(world, pair).min() for pair in pairs if pair.clearance)
    found = collision.check(world, pairs, Findings()).every
    assert found <= smallest + 1e-12
    assert found == pytest.approx(smallest, abs=limits.PENETRATION)  # it may be less between two samples


def test_pairs_judged_a_few_at_a_time_give_the_same(world, monkeypatch):
    pairs = made(world)
    together = collision.check(world, pairs, Findings()).every
    monkeypatch.setattr(limits, "MAX_PAIR_SAMPLES", world.samples)
    assert collision.check(world, pairs, Findings()).every == pytest.approx(together, abs=1e-12)


def test_the_gap_of_a_contact_is_never_below_the_measured_one(world):
    state = {name: np.array(poses) for name, poses in world.poses.items()}
    found = contacts.collect(world)
    assert found
    for contact in found:
        pairs = [[(a, b) for a in parts for b in world.parts_of(contact.object)] for parts in contact.touching.values()]
        combine = np.max if contact.kind == "grasp" and not contact.by_tool else np.min
        exact = [
            combine([min(_distance(world, a, b, k) for a, b in owner) for owner in pairs])
            for k in range(contact.segment.first, contact.segment.last + 1)
        ]
        assert np.all(contact.gap >= np.array(exact) - 1e-9)
        assert np.array_equal(contact.gap <= limits.CONTACT_GAP, np.array(exact) <= limits.CONTACT_GAP)
    assert all(np.array_equal(poses, world.poses[name]) for name, poses in state.items())


def _distance(world, a, b, k):
    (pair,) = [pair for pair in made(world) if {pair.a, pair.b} == {a, b}]
    return pair.gauge.distance(world.tracks[pair.a].at(k), world.tracks[pair.b].at(k))


def test_a_contact_that_opens_is_measured(urdf):
    plan = plans.carry(urdf)
    held = plans.segment(plan, "grasp")
    k = plans.sample(plan, (held["start"] + held["end"]) / 2)
    plan["trajectory"]["objects"][held["object"]][k][0] += 0.5  # out of the fingers, at this sample only
    contact = next(c for c in contacts.collect(World(document.read(plan))) if c.kind == "grasp")
    wrong = np.flatnonzero(contact.gap > limits.CONTACT_GAP) + contact.segment.first
    assert wrong.tolist() == [k]
    assert 0.3 < contact.gap.max() < 0.5


def test_products_of_many_rotations_with_one():
    rotations = Rotation.random(20, random_state=1)
    R, B, v = rotations.as_matrix(), Rotation.random(random_state=2).as_matrix(), np.array([0.1, -0.2, 0.3])
    assert rigid.apply(R, B) == pytest.approx(R @ B)
    assert rigid.apply(R, v) == pytest.approx(R @ v)
    axis, angles = v / np.linalg.norm(v), np.linspace(-3.0, 3.0, 20)
    expected = rotations * Rotation.from_rotvec(angles[:, None] * axis)
    assert rigid.rotated(R, axis, angles) == pytest.approx(expected.as_matrix())


def test_turn_along_rotations_is_exact_for_small_and_large_turns():
    axis = np.array([0.6, 0.0, 0.8])
    turns = np.array([0.0, 1e-7, 1e-3, 1.0, 3.0, np.pi])
    R = Rotation.from_rotvec(np.cumsum(np.append(0.5, turns))[:, None] * axis).as_matrix()
    assert rigid.step_angles(R) == pytest.approx(turns, abs=1e-7)
    assert rigid.step_angles(R)[1:3] == pytest.approx(turns[1:3], rel=1e-6)


@pytest.mark.parametrize("many", [math.inf, 0], ids=["few parts", "many parts"])
@pytest.mark.parametrize("reach", [0.0, 0.05, 0.5])
def test_pairs_that_are_left_out_stay_farther_apart_than_that(world, reach, many, monkeypatch):
    monkeypatch.setattr(pairs, "MANY", many)
    builder = PairBuilder(world, set())
    near, every = builder.build(reach), builder.build()
    kept = {(pair.a, pair.b) for pair in near}
    assert [(pair.a, pair.b) for pair in every if (pair.a, pair.b) in kept] == [(pair.a, pair.b) for pair in near]
    left = [pair for pair in every if (pair.a, pair.b) not in kept]
    assert all(measured(world, pair).min() > reach for pair in left)
    assert left or reach > 0.05


@pytest.mark.parametrize("made", [plans.carry, plans.touch, plans.push, plans.tool_use])
def test_worlds_of_many_parts_are_judged_as_those_of_few(urdf, made, monkeypatch):
    """Valid plans, and one in which everything is 30 mm lower."""
    for drop in (0.0, 0.03):
        plan = made(urdf)
        for poses in plan["trajectory"]["objects"].values():
            for pose in poses:
                pose[2] -= drop
        monkeypatch.setattr(pairs, "MANY", math.inf)
        before = judge.check(plan)
        monkeypatch.setattr(pairs, "MANY", 0)
        after = judge.check(plan)
        assert after.violations == before.violations and after.valid == (drop == 0.0)
        assert after.min_clearance_m == before.min_clearance_m
        assert after.min_held_clearance_m == before.min_held_clearance_m


@pytest.mark.parametrize("many", [math.inf, 0], ids=["few parts", "many parts"])
@pytest.mark.parametrize(("gap", "found"), [(0.005, 0.005), (0.2, 0.2), (0.6, None), (-5e-4, -5e-4)])
def test_the_clearance_of_held_bodies_is_that_from_other_bodies(urdf, gap, found, many, monkeypatch):
    """The robot's hand is nearer to the bodies that it moves, and does not count."""
    monkeypatch.setattr(pairs, "MANY", many)
    wall = plans.box("wall", (0.1, 0.1, 0.2), (0.2 + plans.SIDE / 2 + 0.05 + gap, 0.0, 0.1), "fixed")
    report = judge.check(plans.carry(urdf, extra=(wall,)))
    assert report.min_held_clearance_m == (None if found is None else pytest.approx(found, abs=1e-6))
    assert report.min_clearance_m < 0.1


@pytest.mark.parametrize("near", [judge.NEAR, -1.0])
def test_the_clearance_is_that_of_the_nearest_pair_however_far_that_is(urdf, near, monkeypatch):
    """Where no pair is near, the others are looked at as well."""
    plan = plans.carry(urdf)
    before = judge.check(plan)
    monkeypatch.setattr(judge, "NEAR", near)
    post = plan["scene"]["bodies"][0] | {"size": [0.1, 0.1, 0.1]}
    plan["scene"]["bodies"] += [post | {"name": f"far{k}", "pose": plans.pose(9.0 + k, 5.0, 0.5)} for k in range(200)]
    after = judge.check(plan)
    assert after.valid == before.valid and after.violations == before.violations
    assert after.min_clearance_m == pytest.approx(before.min_clearance_m)


def test_a_support_is_found_among_the_nearest_pairs_as_among_all(world, monkeypatch):
    bodies = [name for name, body in world.document.bodies.items() if not body.fixed]
    places = [(name, k) for name in bodies for k in range(0, world.samples, 7)]
    found = [support.SupportFinder(world).at(name, k, released=True) for name, k in places]

    def every(finder, name, k, reach):
        others = [part for part in world.parts if part.link is None and part.holder != name]
        return [(part, other) for part in world.parts_of(name) for other in others]

    monkeypatch.setattr(support.SupportFinder, "_nearest_pairs", every)
    assert found == [support.SupportFinder(world).at(name, k, released=True) for name, k in places]
    assert any(one.bodies for one in found)
