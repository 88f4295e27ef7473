"""Things that only the cameras know of: seen, followed, and forgotten when they are gone."""

from dataclasses import replace

import numpy as np
import pytest

from hmap.perception.detected_objects import DetectedObjects
from hmap.perception.pictures import Picture
from hmap_core.scenes import load_scene
from hmap_core.simulation.camera import intrinsics
from hmap_core.simulation.dynamic import sphere
from hmap_core.simulation.world import SimulatedWorld
from hmap_core.types import BodyKind, Shape, ShapeKind

RADIUS = 0.04
PLACE, ELSEWHERE = np.array([-0.1, 0.25, 0.3]), np.array([-0.1, 0.1, 0.3])
NEAR = 0.005  # m


@pytest.fixture(scope="module")
def scene():
    return load_scene("tunnel", 0)


@pytest.fixture
def world(scene):
    with SimulatedWorld(scene) as world:
        yield world


def picture(world, scene, time: float) -> Picture:
    camera = next(iter(scene.cameras.values()))
    image = world.render(camera)
    names = {name: number for number, name in image.names.items()}
    return Picture(camera, time, image.depth, image.mask, names, intrinsics(camera))


def test_a_body_of_the_scene_is_not_detected_as_new(world, scene):
    detected_objects = DetectedObjects(scene)
    assert not detected_objects.update(picture(world, scene, 0.0))
    assert not detected_objects.bodies


def test_a_ball_is_seen_followed_and_forgotten(world, scene):
    detected_objects = DetectedObjects(scene)
    world.add_body(sphere("ball", RADIUS, PLACE))
    assert detected_objects.update(picture(world, scene, 0.0))
    seen = detected_objects.bodies["ball"]
    assert seen.shapes[0].kind is ShapeKind.SPHERE and seen.kind is BodyKind.FIXED
    assert np.linalg.norm(seen.pose[:3] - PLACE) < NEAR
    assert not detected_objects.update(picture(world, scene, 1.0))  # where it was
    world.move_body("ball", sphere("ball", RADIUS, ELSEWHERE).pose)
    assert detected_objects.update(picture(world, scene, 2.0))
    assert np.linalg.norm(detected_objects.bodies["ball"].pose[:3] - ELSEWHERE) < NEAR
    world.remove_body("ball")
    assert detected_objects.update(picture(world, scene, 3.0))
    assert not detected_objects.bodies


def test_a_name_that_no_body_may_have_is_replaced(world, scene):
    detected_objects = DetectedObjects(scene)
    world.add_body(sphere("ball", RADIUS, PLACE))
    seen = picture(world, scene, 0.0)
    number = seen.names.pop("ball")
    detected_objects.update(replace(seen, names=seen.names | {"coffee mug #2": number}))
    assert set(detected_objects.bodies) == {f"thing_{number}"}


def test_what_is_hidden_stays_where_it_was_seen_last(world, scene):
    detected_objects = DetectedObjects(scene)
    world.add_body(sphere("ball", RADIUS, PLACE))
    detected_objects.update(picture(world, scene, 0.0))
    screen = sphere("screen", 0.2, PLACE + 0.3 * (scene.cameras["overhead"].pose[:3] - PLACE))
    world.add_body(screen)
    detected_objects.update(picture(world, scene, 1.0))
    assert np.linalg.norm(detected_objects.bodies["ball"].pose[:3] - PLACE) < NEAR


def test_a_box_on_the_table_is_a_box_that_stands_on_it(world, scene):
    detected_objects = DetectedObjects(scene)
    size, top = (0.1, 0.12, 0.08), 0.05
    shape = Shape(ShapeKind.BOX, size)
    box = replace(sphere("box", RADIUS, np.array([-0.2, -0.5, top + 0.5 * size[2]])), shapes=(shape,))
    world.add_body(box)
    detected_objects.update(picture(world, scene, 0.0))
    seen = detected_objects.bodies["box"]
    assert seen.shapes[0].kind is ShapeKind.BOX
    assert np.linalg.norm(seen.pose[:3] - box.pose[:3]) < 2 * NEAR
    assert seen.pose[2] - 0.5 * seen.shapes[0].size[2] == pytest.approx(top, abs=NEAR)


def test_older_picture_of_another_camera_moves_and_removes_nothing(world, scene):
    detected_objects = DetectedObjects(scene)
    world.add_body(sphere("ball", RADIUS, PLACE))
    before = picture(world, scene, 1.0)
    world.move_body("ball", sphere("ball", RADIUS, ELSEWHERE).pose)
    assert detected_objects.update(picture(world, scene, 2.0))
    other = replace(before.camera, name="other")
    assert not detected_objects.update(replace(before, camera=other))
    assert not detected_objects.update(replace(before, camera=other, names={}))
    assert np.linalg.norm(detected_objects.bodies["ball"].pose[:3] - ELSEWHERE) < NEAR
