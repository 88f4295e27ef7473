"""Pictures without masks are segmented by what is known of shapes and poses."""

from dataclasses import replace

import numpy as np
import pytest

from hmap.perception.pictures import Picture
from hmap.perception.segmentation import Segmentation
from hmap_core.scenes import load_scene
from hmap_core.simulation.camera import intrinsics
from hmap_core.simulation.world import SimulatedWorld
from hmap_core.transforms import multiply, pose
from hmap_core.types import BodyKind

NOISE = 0.003  # of a depth, relative
SEEN = 100  # pixels; of smaller pictures of a body the edge is too large a part


def pictures(task):
    """Noisy pictures of a task's cameras without masks, each with the true mask as body -> (H, W), and the state."""
    rng = np.random.default_rng(0)
    scene = load_scene(task, 0)
    world = SimulatedWorld(scene)
    for camera in scene.cameras.values():
        image = world.render(camera)
        depth = image.depth * (1.0 + NOISE * rng.standard_normal(image.depth.shape))
        picture = Picture(camera, 0.0, depth, np.zeros(depth.shape, np.int32), {}, intrinsics(camera))
        true = {name: image.mask == number for number, name in image.names.items()}
        yield scene, picture, true, world.state()


@pytest.mark.parametrize("task", ["tunnel", "bookshelf", "tunnel_tool"])
def test_pixels_of_bodies_are_found_in_a_noisy_picture(task):
    found = 0
    for scene, picture, true, state in pictures(task):
        labelled = Segmentation(scene).label(picture, state)
        for name, number in labelled.names.items():
            ours, theirs = labelled.mask == number, true.get(name, np.zeros(picture.depth.shape, bool))
            if theirs.sum() > SEEN:
                found += 1
                assert (ours & theirs).sum() > 0.9 * max(ours.sum(), theirs.sum())
        fixed = [true[name] for name in true if name in scene.robots or scene.bodies[name].kind is BodyKind.FIXED]
        assert (labelled.mask[np.any(fixed, axis=0)] > 0).mean() < 0.01
    assert found


def test_nothing_belongs_to_a_body_that_is_not_where_it_is_said_to_be():
    scene, picture, true, state = next(pictures("tunnel"))
    moved = replace(state, poses=state.poses | {"bar": multiply(pose((0.0, 0.0, 0.3)), state.poses["bar"])})
    labelled = Segmentation(scene).label(picture, moved)
    assert not (labelled.mask[true["bar"]] == labelled.names["bar"]).any()


def test_a_picture_without_a_measurement_shows_nothing():
    scene, picture, _, state = next(pictures("tunnel"))
    empty = replace(picture, depth=np.full(picture.depth.shape, np.nan))
    assert not Segmentation(scene).label(empty, state).mask.any()
