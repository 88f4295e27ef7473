"""What a camera sees of an object, and the cloud of a depth picture."""

import numpy as np
import pytest
from geometry_fixtures import box, yaw

from hmap_core.contacts.camera import project, visible_points
from hmap_core.contacts.cloud import cloud_from_depth, merge_clouds
from hmap_core.contacts.solids import interval, solids
from hmap_core.contacts.surface import sample_surface
from hmap_core.exceptions import InputError
from hmap_core.transforms import IDENTITY, apply, from_rpy, inverse, multiply, pose
from hmap_core.types import Body, BodyKind, Camera, Shape, ShapeKind

CUBE = box("cube", (0.1, 0.1, 0.1), (0, 0, 0))
T_CUBE = pose((0.3, 0.1, 0.1))
OVERHEAD = Camera("overhead", from_rpy((0.3, 0.1, 1.5), (np.pi, 0, 0)))  # looks down


def rng():
    return np.random.default_rng(0)


def test_only_the_top_is_seen_from_above():
    cloud = visible_points(CUBE, T_CUBE, [], [OVERHEAD], rng(), 400)
    assert 40 < len(cloud) < 100  # a sixth of the surface
    np.testing.assert_allclose(cloud.points[:, 2], 0.05, atol=1e-12)
    np.testing.assert_allclose(cloud.normals, np.tile([0, 0, 1.0], (len(cloud), 1)), atol=1e-12)
    assert cloud.seen.all()


def test_unseen_points_come_as_a_second_choice():
    cloud = visible_points(CUBE, T_CUBE, [], [OVERHEAD], rng(), 400, include_unseen=True)
    assert len(cloud) == 400
    np.testing.assert_array_equal(cloud.seen, cloud.normals[:, 2] > 0.5)


def test_an_occluder_casts_an_exact_shadow():
    """A plate over the half x > 0 of the cube, right above it, hides that half."""
    plate = box("plate", (0.2, 0.4, 0.01), (0.4, 0.1, 0.16))
    cloud = visible_points(CUBE, T_CUBE, [(plate, plate.pose)], [OVERHEAD], rng(), 4000)
    # the camera is 1.35 m above the top, the plate's lower edge at x = 0.3 is straight above the middle
    assert cloud.points[:, 0].max() < 1e-9
    assert cloud.points[:, 0].max() > -0.005
    everything = visible_points(CUBE, T_CUBE, [(plate, pose((5, 5, 5)))], [OVERHEAD], rng(), 4000)
    assert everything.points[:, 0].max() > 0.045


def test_the_picture_has_edges():
    narrow = Camera("narrow", OVERHEAD.pose, 640, 480, fov_y=2 * np.arctan(0.02 / 1.35))
    cloud = visible_points(CUBE, T_CUBE, [], [narrow], rng(), 4000)
    local = apply(inverse(narrow.pose), apply(T_CUBE, cloud.points))
    assert np.abs(local[:, 1]).max() < 0.02 + 1e-9
    assert 0.018 < np.abs(local[:, 1]).max()
    assert np.abs(local[:, 0]).max() > 0.024  # wider than high
    away = Camera("away", from_rpy((0.3, 0.1, 1.5), (0, 0, 0)))  # looks up
    assert len(visible_points(CUBE, T_CUBE, [], [away], rng(), 400)) == 0


def test_the_body_hides_itself_and_inner_points_are_dropped():
    shapes = (Shape(ShapeKind.BOX, (0.1, 0.1, 0.1)), Shape(ShapeKind.BOX, (0.3, 0.3, 0.02), pose((0, 0, 0.06))))
    mushroom = Body("mushroom", BodyKind.MOVABLE, shapes, pose())
    cloud = visible_points(mushroom, T_CUBE, [], [OVERHEAD], rng(), 2000)
    np.testing.assert_allclose(cloud.points[:, 2], 0.07, atol=1e-12)
    everywhere = visible_points(mushroom, T_CUBE, [], [OVERHEAD], rng(), 2000, include_unseen=True)
    between = (np.abs(everywhere.points[:, 2] - 0.05) < 1e-6) & np.all(
        np.abs(everywhere.points[:, :2]) < 0.0499, axis=1
    )
    assert not between.any()  # the faces that lie on each other


def test_clouds_depend_on_the_seed_alone():
    a, b = (visible_points(CUBE, T_CUBE, [], [OVERHEAD], rng(), 100) for _ in range(2))
    np.testing.assert_array_equal(a.points, b.points)
    c = visible_points(CUBE, T_CUBE, [], [OVERHEAD], np.random.default_rng(1), 100)
    assert a.points.shape != c.points.shape or not np.allclose(a.points, c.points)
    assert len(visible_points(CUBE, T_CUBE, [], [], rng(), 100)) == 0
    with pytest.raises(InputError):
        visible_points(CUBE, T_CUBE, [], [], rng(), 0)


@pytest.mark.parametrize(
    "shape",
    [
        Shape(ShapeKind.BOX, (0.2, 0.1, 0.05), pose((0.1, 0, 0), yaw(0.3))),
        Shape(ShapeKind.CYLINDER, (0.05, 0.2), pose((0, 0.1, 0), (0.5, 0.5, 0.5, 0.5))),
        Shape(ShapeKind.SPHERE, (0.07,), pose((0, 0, 0.2))),
        Shape(ShapeKind.CAPSULE, (0.04, 0.1), pose((0, 0.1, 0), (0.5, 0.5, 0.5, 0.5))),
    ],
)
def test_surfaces_rays_and_normals_agree(shape):
    """Samples lie on the surface: a ray along the normal leaves there, and goes in just below."""
    points, normals = sample_surface((shape,), 300, rng())
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    arrays = solids([(shape, IDENTITY)]).arrays
    t = np.empty(2)
    for p, n in zip(points, normals, strict=True):
        interval(0, p, n, *arrays, t)
        assert t[0] < -1e-3 and abs(t[1]) < 1e-9


def test_a_mesh_is_its_hull(tmp_path):
    path = tmp_path / "tetra.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    shape = Shape(ShapeKind.MESH, (0.1, 0.1, 0.1), pose((0.2, 0, 0)), path)
    points, normals = sample_surface((shape,), 300, rng())
    arrays = solids([(shape, IDENTITY)]).arrays
    t = np.empty(2)
    slanted = 0
    for p, n in zip(points, normals, strict=True):
        interval(0, p, n, *arrays, t)
        assert t[0] < 0.0 and abs(t[1]) < 1e-9
        slanted += np.allclose(n, 1 / np.sqrt(3))
    assert 80 < slanted < 190  # sqrt(3) / (3 + sqrt(3)) of the area: 110


def rendered(camera, T_obj, half):
    """Depth picture and mask of a cube of half extent ``half``, by rays through the pixels."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    focal = camera.height / 2 / np.tan(camera.fov_y / 2)
    K = np.array([[focal, 0, camera.width / 2], [0, focal, camera.height / 2], [0, 0, 1]])
    rays = np.stack([(u - K[0, 2]) / focal, (v - K[1, 2]) / focal, np.ones(u.shape)], axis=-1).reshape(-1, 3)
    T = multiply(inverse(T_obj), camera.pose)
    origin = T[:3]
    directions = apply(np.r_[np.zeros(3), T[3:]], rays)
    with np.errstate(divide="ignore"):
        a, b = (-half - origin) / directions, (half - origin) / directions
    near, far = np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)
    mask = (near < far).reshape(u.shape)
    return np.where(mask, near.reshape(u.shape), np.nan), mask, K


def test_the_cloud_of_a_depth_picture_lies_on_the_object():
    camera = Camera("tilted", from_rpy((0.3, -0.7, 0.9), (np.deg2rad(-135), 0, 0)))
    depth, mask, K = rendered(camera, T_CUBE, 0.05)
    assert mask.sum() > 1000
    depth[np.nonzero(mask)[0][0], np.nonzero(mask)[1][0]] -= 0.3  # a flying pixel
    cloud = cloud_from_depth(depth, mask, K, camera.pose, T_CUBE)
    assert len(cloud) > 200
    on_surface = np.abs(np.abs(cloud.points).max(axis=1) - 0.05)
    assert on_surface.max() < 0.003  # the flying pixel is gone; cells at edges average over two faces
    inner = np.sort(np.abs(cloud.points), axis=1)[:, 1] < 0.035
    faces = np.zeros_like(cloud.points)
    axis = np.abs(cloud.points).argmax(axis=1)
    faces[np.arange(len(faces)), axis] = np.sign(cloud.points[np.arange(len(faces)), axis])
    assert np.sum(cloud.normals * faces, axis=1)[inner].min() > 0.99
    assert len(merge_clouds([cloud, cloud])) == 2 * len(cloud)


def test_depth_pictures_without_the_object_and_wrong_ones():
    K = np.eye(3)
    nothing = cloud_from_depth(np.full((4, 4), np.nan), np.ones((4, 4), bool), K, IDENTITY, IDENTITY)
    assert len(nothing) == 0 and len(merge_clouds([])) == 0
    with pytest.raises(InputError):
        cloud_from_depth(np.ones((4, 4)), np.ones((4, 5), bool), K, IDENTITY, IDENTITY)


def test_projection_of_the_point_the_camera_looks_at():
    np.testing.assert_allclose(project(OVERHEAD, np.array([[0.3, 0.1, 0.5]])), [[320, 240, 1.0]], atol=1e-9)
