"""Noise of measured poses neither sinks bodies into what they stand on nor lets them hover, tilt or touch walls."""

import numpy as np
import pytest

from hmap_core import transforms
from hmap_core.collision.convex import convex_set, set_distance
from hmap_core.planner.assembly import scene_at
from hmap_core.planner.preconditions import check_bodies
from hmap_core.scenes import load_scene
from hmap_core.stability.supports import on_supports

NOISE = 0.001  # m


@pytest.fixture
def scene(tmp_path):
    file = tmp_path / "noise.yaml"
    file.write_text("""
schema: 1
mode: physical
fixed:
  table: {shape: box, size: [2.0, 2.0, 0.1], pose: {xyz: [0, 0, 0]}}
  wall: {shape: box, size: [0.5, 0.02, 0.2], pose: {xyz: [0.5, 0.3, 0.15]}}
movable:
  box: {shape: box, size: [0.05, 0.06, 0.08], pose: {xyz: [0.5, -0.2, 0.09], rpy_deg: [0, 0, 30]}, mass: 0.3}
  lid: {shape: box, size: [0.05, 0.05, 0.02], pose: {xyz: [0.5, -0.2, 0.14]}, mass: 0.1}
  can: {shape: cylinder, size: [0.03, 0.1], pose: {xyz: [0.3, 0.2, 0.1]}, mass: 0.3}
  beside: {shape: box, size: [0.05, 0.06, 0.08], pose: {xyz: [0.5, 0.26, 0.09]}, mass: 0.3}
robots:
  arm: {model: panda, base: {xyz: [-0.5, 0, 0.05]}}
goal: {object: box, pose: {xyz: [0.6, 0.0, 0.09]}}
""")
    return load_scene(str(file))


def noisy(scene, rng):
    """The start as motion capture with markers 10 cm apart measures it."""
    state = scene.start_state()
    for name, body in scene.bodies.items():
        if body.kind != "fixed":
            turn = rng.normal(0.0, NOISE / 0.1, 3)
            T = transforms.from_rpy(rng.normal(0.0, NOISE, 3), turn)
            state.poses[name] = np.concatenate(
                [state.poses[name][:3] + T[:3], transforms.quaternion_multiply(T[3:], state.poses[name][3:])]
            )
    return state


@pytest.mark.parametrize("seed", range(8))
def test_bodies_stand_where_they_are_measured_with_noise(scene, seed):
    measured = noisy(scene, np.random.default_rng(seed))
    state = on_supports(scene, measured, NOISE)
    check_bodies(scene_at(scene, state), scene.goal)  # penetration and hanging
    start = scene.start_state()
    for name in ("box", "lid", "can", "beside"):
        away, angle = transforms.distance(state.poses[name], start.poses[name])
        assert away < 5.0 * NOISE and angle < 5.0 * NOISE / 0.1
        assert state.poses[name][2] == pytest.approx(start.poses[name][2], abs=2e-5), name
        up = transforms.rotation_matrix(state.poses[name])[2, 2]
        assert up == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(state.poses["box"][:2], measured.poses["box"][:2], atol=1e-9)
    wall = [convex_set(scene.bodies[name].shapes) for name in ("beside", "wall")]
    assert set_distance(wall[0], state.poses["beside"], wall[1], state.poses["wall"]) > -1e-4


def test_what_is_farther_away_than_noise_stays_as_measured(scene):
    state = scene.start_state()
    state.poses["box"] = state.poses["box"] + 0.3 * np.eye(7)[2]
    state.poses["can"] = transforms.from_rpy(state.poses["can"][:3] + [0.0, 0.0, 0.05], [0.3, 0.1, 0.0])
    found = on_supports(scene, state, NOISE)
    for name in ("box", "can"):
        np.testing.assert_array_equal(found.poses[name], state.poses[name])


def test_without_noise_nothing_is_changed(scene):
    state = noisy(scene, np.random.default_rng(0))
    assert on_supports(scene, state, 0.0) is state


def test_an_exact_state_stays_as_it_is(scene):
    start = scene.start_state()
    found = on_supports(scene, start, NOISE)
    for name, T in start.poses.items():
        np.testing.assert_allclose(found.poses[name], T, atol=1e-6)
