"""The picture of a plan shows what it should, where it should."""

from dataclasses import replace

import matplotlib.image
import numpy as np
import plan_fixtures
import pytest
import simulation_fixtures as sim
from PIL import Image

from hmap_core import transforms
from hmap_core.cli import main
from hmap_core.exceptions import InputError
from hmap_core.simulation.camera import intrinsics
from hmap_core.types import BodyKind, Goal
from hmap_core.viz import animation
from hmap_core.viz.animation import animate
from hmap_core.viz.key_frames import key_samples
from hmap_core.viz.layers import Canvas
from hmap_core.viz.picture import Painter, draw, render
from hmap_core.viz.stage import Stage
from hmap_core.viz.view import camera_around, camera_for

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
    camera = camera_for(plan, WIDTH, HEIGHT)
    with Painter(plan, camera) as painter:
        pixels = painter.frame(0)
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


@pytest.mark.parametrize(
    "center", [(-5.0, 0.0, 1.0), (5.0, 0.0, 1.0), (0.0, -5.0, 1.0), (0.0, 5.0, 1.0), (0.0, 0.0, -1.0)]
)
def test_a_sphere_outside_the_picture_is_not_drawn(center):
    camera = sim.scene().cameras["top"]
    shape = (camera.height, camera.width)
    canvas = Canvas(camera, np.full((*shape, 3), 255, np.uint8), np.full(shape, 2.0))
    canvas.sphere(transforms.apply(camera.pose, np.array(center)), 0.05, (1.0, 0.0, 0.0), 0.5)
    assert np.all(canvas.color == 1.0)


def test_key_frames_tell_begin_and_end_of_contact(plan):
    contact = plan.segments[1]
    samples = key_samples(plan)
    assert 4 <= len(samples) <= 6 and samples == sorted(set(samples))
    assert plan.trajectory.time[samples[0]] == pytest.approx(contact.start)
    assert plan.trajectory.time[samples[-1]] == pytest.approx(contact.end)


def test_a_plan_that_does_nothing_is_drawn(plan):
    trajectory = plan.trajectory
    still = replace(
        trajectory,
        time=trajectory.time[:1],
        joints={name: q[:1] for name, q in trajectory.joints.items()},
        gripper={name: opening[:1] for name, opening in trajectory.gripper.items()},
        objects={name: poses[:1] for name, poses in trajectory.objects.items()},
    )
    assert draw(replace(plan, trajectory=still, segments=()), WIDTH, HEIGHT).shape == (HEIGHT, WIDTH, 3)


def test_a_wall_does_not_hide_the_object(plan):
    """The usual view is from beyond the object; a wall there moves the camera to where the object is seen."""
    wall = sim.box("wall", (0.02, 1.5, 0.6), (0.65, 0.05, 0.3), BodyKind.FIXED)
    walled = replace(plan, scene=replace(plan.scene, bodies={**plan.scene.bodies, "wall": wall}))
    middle = transforms.pose((0.5, 0.05, 0.03))[:3]
    with Stage(walled) as stage:
        camera = camera_for(walled, WIDTH, HEIGHT)
        assert stage.world.first_hits(camera.pose[:3], np.array([middle])) != ["wall"]
        usual = camera_around(np.array([middle - 0.3, middle + 0.3]), 0.0, WIDTH, HEIGHT)
        assert stage.world.first_hits(usual.pose[:3], np.array([middle])) == ["wall"]


def test_animation_shows_the_whole_plan(plan, tmp_path, monkeypatch):
    monkeypatch.setattr(animation, "WIDTH", 96)
    monkeypatch.setattr(animation, "HEIGHT", 64)
    seen = []
    animate(plan, tmp_path / "plan.gif", lambda done, of: seen.append((done, of)))
    with Image.open(tmp_path / "plan.gif") as gif:
        assert gif.format == "GIF" and gif.size == (96, 64)
        assert gif.n_frames > 10
        first = np.asarray(gif.convert("RGB"))
        gif.seek(gif.n_frames - 1)
        assert np.abs(first.astype(int) - np.asarray(gif.convert("RGB"))).max() > 50
    assert seen[-1][0] == seen[-1][1] == len(seen)


def test_picture_is_a_png(plan, tmp_path):
    render(plan, tmp_path / "plan.png")
    assert matplotlib.image.imread(tmp_path / "plan.png").shape[2] in (3, 4)


def test_folder_that_is_not_there_is_an_input_error(plan, tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        render(plan, tmp_path / "no" / "plan.png")


def test_an_animation_is_a_gif(tmp_path, capsys):
    assert main(["plan", "bolt", "--out", str(tmp_path / "plan.json"), "--animation", str(tmp_path / "plan.mp4")]) == 2
    assert ".gif" in capsys.readouterr().err
