"""Pads of simulated fingers: where they are, and which robots have none."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from simulation_fixtures import panda_model

from hmap_core.kinematics.urdf import load_urdf
from hmap_core.scenes import load_robot_model
from hmap_core.simulation.finger_pads import HOLLOW, RADIUS, RECESS, RIM, SPREAD, with_pads


def test_each_finger_has_its_pad_in_front_of_its_hull(tmp_path):
    model = panda_model()
    own = load_urdf(with_pads(model, tmp_path)).hulls
    for link, inward in zip(model.gripper.finger_links, (-1.0, 1.0), strict=True):
        (hull, _), *pad = own[link]
        assert all(radius == RADIUS for _, radius in pad)
        pad = np.concatenate([points for points, _ in pad])
        assert len(pad) == len(SPREAD) ** 2
        ahead = pad[:, 1] * inward
        corners = np.abs(ahead - ahead.max()) < 1e-9
        half = model.gripper.pad_half_width
        np.testing.assert_allclose(np.abs(pad[corners][:, 0]), half + RIM - RADIUS, atol=1e-6)
        assert corners.sum() == 4 and ahead[~corners] == pytest.approx(ahead.max() - HOLLOW, abs=1e-9)
        front = ahead.max() + RADIUS
        assert front == pytest.approx(0.0, abs=2e-4)  # closed pads meet
        assert front - (hull[:, 1] * inward).max() == pytest.approx(RECESS, abs=1e-6)
        before = np.concatenate([points for points, _ in load_urdf(model.urdf).hulls[link]])
        assert (hull[:, 1] * inward).min() == pytest.approx((before[:, 1] * inward).min(), abs=1e-6)


def test_an_arm_without_gripper_is_loaded_as_it_is(tmp_path):
    model = replace(panda_model(), gripper=None)
    assert with_pads(model, tmp_path) == model.urdf and not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["fr3", "xarm7", "ur5e_2f85"])
def test_a_finger_of_several_parts_is_nowhere_thicker_than_they_are(name, tmp_path):
    """Beside an L is free space, for the planner and in the simulation."""
    model = load_robot_model(name)
    own, simulated = load_urdf(model.urdf).hulls, load_urdf(with_pads(model, tmp_path)).hulls
    for link in model.gripper.finger_links:
        hulls = [ConvexHull(points).equations for points, _ in own[link]]
        assert len(hulls) > 1
        for points, radius in simulated[link]:
            outside = [(points @ planes[:, :3].T + planes[:, 3]).max(axis=1) for planes in hulls]
            assert radius or np.min(outside, axis=0).max() < RECESS
        volume = sum(ConvexHull(points).volume for points, radius in simulated[link] if not radius)
        assert volume < sum(ConvexHull(points).volume for points, _ in own[link])
