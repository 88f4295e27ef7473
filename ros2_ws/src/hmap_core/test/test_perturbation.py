"""Worlds that are off: what differs, by how much, and who knows of it."""

import json
from dataclasses import replace

import numpy as np
import plan_fixtures
import pytest
import simulation_fixtures as sim

from hmap_core import plan_file, transforms
from hmap_core.benchmark import robustness
from hmap_core.cli import main
from hmap_core.evaluation.trial import Trial, TrialResult
from hmap_core.exceptions import InputError
from hmap_core.scenes import load_scene
from hmap_core.simulation.engines import ENGINES, open_world
from hmap_core.simulation.perturbation import Perturbation
from hmap_core.types import BodyKind, Goal

ALL = "friction=0.3,mass=0.5,pose=0.002:1"


@pytest.fixture(scope="module")
def drag():
    box = sim.box("box", (0.06, 0.06, 0.06), (0.5, -0.1, 0.03))
    scene = sim.scene(box, goal=Goal("box", transforms.pose((0.5, 0.2, 0.03))))
    plan = plan_fixtures.drag_plan(scene, "box", 0.06, np.array([0.0, 0.3, 0.0]))
    contact = transforms.pose((0.0, 0.0, 0.0), plan_fixtures.DOWN)
    segments = [replace(s, contact_pose=contact if s.object else None) for s in plan.segments]
    return replace(plan, segments=tuple(segments))


def test_text_is_read():
    assert Perturbation.parse(ALL) == Perturbation(0.3, 0.5, 0.002, float(np.deg2rad(1.0)))
    assert Perturbation.parse("pose=0.01") == Perturbation(position=0.01)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "names nothing"),
        ("frictoin=0.3", "'frictoin' is not known"),
        ("friction", "friction= is no number"),
        ("mass=x", "mass=x is no number"),
        ("mass=nan", "mass=nan; 0 to 0.95"),
        ("friction=1.5", "friction=1.5; 0 to 0.95"),
        ("pose=2:1", "pose=2; 0 to 0.1"),
        ("pose=0.002:", "pose= is no number"),
    ],
)
def test_bad_text_is_refused(text, says):
    with pytest.raises(InputError, match=says):
        Perturbation.parse(text)


def test_values_are_off_within_their_ranges():
    scene = load_scene("bookshelf", seed=1)
    perturbation = Perturbation.parse(ALL)
    worlds = [perturbation.apply(scene, seed) for seed in range(20)]
    shares = {"friction": set(), "mass": set()}
    for world in worlds:
        for name, body in scene.bodies.items():
            other = world.bodies[name]
            assert abs(other.friction / body.friction - 1.0) <= 0.3 + 1e-9
            shares["friction"].add(other.friction / body.friction)
            if body.kind is BodyKind.FIXED:
                np.testing.assert_array_equal(other.pose, body.pose)
                continue
            shares["mass"].add(other.mass / body.mass)
            assert abs(other.mass / body.mass - 1.0) <= 0.5 + 1e-9
            assert np.abs(other.pose[:2] - body.pose[:2]).max() <= 0.002 and other.pose[2] == body.pose[2]
            assert transforms.distance(other.pose, body.pose)[1] <= np.deg2rad(1.0) + 1e-9
    assert min(shares["friction"]) < 0.8 and max(shares["mass"]) > 1.3
    assert not np.array_equal(worlds[0].bodies["book"].pose, worlds[1].bodies["book"].pose)


def test_the_same_seed_gives_the_same_world():
    scene, perturbation = load_scene("puck_move", seed=0), Perturbation.parse(ALL)
    for name, body in perturbation.apply(scene, 3).bodies.items():
        np.testing.assert_array_equal(body.pose, perturbation.apply(scene, 3).bodies[name].pose)


def test_a_body_without_room_is_not_put_into_its_walls():
    walls = [sim.box(f"wall{y}", (0.2, 0.02, 0.1), (0.5, y, 0.05), BodyKind.FIXED) for y in (-0.0405, 0.0405)]
    scene = sim.scene(sim.box("box", (0.06, 0.06, 0.06), (0.5, 0.0, 0.03)), *walls)
    for seed in range(10):
        pose = Perturbation.parse("pose=0.02:5").apply(scene, seed).bodies["box"].pose
        assert abs(pose[1]) <= 0.0007


@pytest.mark.parametrize("engine", ENGINES)
def test_only_the_world_knows(engine, drag):
    actual = Perturbation.parse("friction=0.3,mass=0.5,pose=0.05").apply(drag.scene, 1)
    world = open_world(drag.scene, engine, actual)
    try:
        assert world.scene is drag.scene
        np.testing.assert_allclose(world.body_pose("box"), actual.bodies["box"].pose, atol=1e-9)
    finally:
        world.close()


def test_the_command_executes_samples(drag, tmp_path, capsys):
    path = tmp_path / "plan.json"
    plan_file.save(drag, path)
    arguments = ["execute", str(path), "--perturb", "friction=0.2,mass=0.2,pose=0.002:1", "--samples", "2"]
    assert main([*arguments, "--open-loop", "--engine", "mujoco", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["solved"] and document["solved_samples"] == len(document["samples"]) == 2
    first, second = (sample["goal_error"]["position_m"] for sample in document["samples"])
    assert first != second


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--samples", "3"], "--samples needs --perturb"),
        (["--open-loop", "--replans", "2"], "--open-loop allows no new plans"),
        (["--engine", "bulet"], "engine 'bulet' is not known"),
        (["--perturb", "weight=3"], "'weight' is not known"),
    ],
)
def test_bad_options_are_refused(options, says, drag, tmp_path, capsys):
    path = tmp_path / "plan.json"
    plan_file.save(drag, path)
    assert main(["execute", str(path), *options]) == 2
    assert says in capsys.readouterr().err


def test_the_report_counts_open_and_closed_loop():
    trials = [Trial("bolt", seed, 1.0, replans, sample=seed) for seed in range(4) for replans in (0, 3)]
    results = [TrialResult(t.seed, valid=True, solved=t.max_replans > 0 or t.seed == 0, reason="slip") for t in trials]
    found = robustness.rows(trials, results)
    document = robustness.to_dict(found)
    assert [document["bolt"][mode]["solved"] for mode in ("open_loop", "closed_loop")] == [1, 4]
    low, high = document["all"]["closed_loop"]["interval_95"]
    assert low == pytest.approx(0.51, abs=0.01) and high == pytest.approx(1.0)
    assert len(robustness.table(found)) == 3 and len(robustness.failures(trials, results)) == 3
