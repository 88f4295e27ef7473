"""The picture of a plan shows what it should, where it should."""

from dataclasses import replace

import matplotlib.image
import numpy as np
import plan_fixtures
import pytest
import simulation_fixtures as sim

from hmap_core import transforms
from hmap_core.exceptions import InputError
from hmap_core.simulation.camera import intrinsics
from hmap_core.types import Goal
from hmap_core.viz.layers import Canvas
from hmap_core.viz.picture import draw, render
from hmap_core.viz.view import camera_for

WIDTH, HEIGHT = 240, 140


@pytest.fixture(scope="module")
def plan():
    box = sim.box("box", (0.06, 0.06, 0.06), (0.5, -0.1, 0.03))
    scene = sim.scene(box, goal=Goal("box", transforms.pose((0.5, 0.2, 0.03))))
    plan = plan_fixtures.drag_plan(scene, "box", 0.06, np.array([0.0, 0.3, 0.0]))
    return replace(plan, waypoints=np.array([transforms.pose((0.5, 0.0, 0.03)), scene.goal.pose]))


def pixel(camera, point) -> tuple[int, int]:
    x, y, z = transforms.apply(transforms.inverse(camera.pose), np.asarray(point, float))
    K = intrinsics(camera)
    return round(K[1, 1] * y / z + K[1, 2]), round(K[0, 0] * x / z + K[0, 2])


def test_waypoints_are_red(plan):
    pixels = draw(plan, WIDTH, HEIGHT)
    camera = camera_for(plan, WIDTH, HEIGHT)
    row, column = pixel(camera, plan.waypoints[0][:3])
    red, green, blue = pixels[row, column].astype(int)
    assert red > green + 30 and red > blue + 30


def test_everything_that_matters_is_in_the_picture(plan):
    camera = camera_for(plan, WIDTH, HEIGHT)
    for point in [*plan.waypoints[:, :3], plan.scene.robots["left"].base_pose[:3], plan.scene.bodies["box"].pose[:3]]:
        row, column = pixel(camera, point)
        assert 0 <= row < HEIGHT and 0 <= column < WIDTH


def test_hidden_parts_of_a_layer_are_fainter():
    camera = sim.scene().cameras["top"]
    shape = (camera.height, camera.width)
    canvas = Canvas(camera, np.full((*shape, 3), 255, np.uint8), np.full(shape, 1.0))
    depth = np.full(shape, 0.5)
    depth[:, : shape[1] // 2] = 2.0
    canvas.ghost(np.zeros((*shape, 3)), depth, np.ones(shape, bool), alpha=0.5, hidden=0.1)
    assert canvas.color[0, 0, 0] == pytest.approx(0.9)
    assert canvas.color[0, -1, 0] == pytest.approx(0.5)


def test_picture_is_a_png(plan, tmp_path):
    render(plan, tmp_path / "plan.png")
    assert matplotlib.image.imread(tmp_path / "plan.png").shape[2] in (3, 4)


def test_folder_that_is_not_there_is_an_input_error(plan, tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        render(plan, tmp_path / "no" / "plan.png")
