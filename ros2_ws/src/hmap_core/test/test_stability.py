"""How bodies rest: on faces, in cradles, leaning, kept by what stands around; and the equilibrium of stacks."""

import numpy as np
import pytest
from geometry_fixtures import box

from hmap_core.collision.convex import convex_set
from hmap_core.stability.contact_patches import intersection, patches
from hmap_core.stability.equilibrium import Contact, in_equilibrium
from hmap_core.stability.mass import centre_of_mass
from hmap_core.stability.rest import rests
from hmap_core.stability.resting_faces import resting_faces
from hmap_core.transforms import apply, from_rpy, pose
from hmap_core.types import Body, BodyKind, Shape, ShapeKind
from hmap_core.waypoints import stable_poses

GROUND = box("ground", (2.0, 2.0, 0.1), (0.0, 0.0, -0.05))
DOWN = np.array([0.0, 0.0, -1.0])


def body(*shapes: Shape, friction: float = 0.6) -> Body:
    return Body("thing", BodyKind.MOVABLE, shapes, pose(), 0.1, friction)


def cuboid(size, at=(0.0, 0.0, 0.0)) -> Shape:
    return Shape(ShapeKind.BOX, tuple(size), pose(at))


BALL = body(Shape(ShapeKind.SPHERE, (0.03,)))
ROD = body(Shape(ShapeKind.CYLINDER, (0.02, 0.1)))
LYING = (0.0, np.pi / 2, 0.0)


def ring(gap: float, wall: float = 0.012) -> Body:
    span = 2 * (0.03 + gap) + 0.008
    at = span / 2
    walls = [
        cuboid((span, 0.008, wall), (0.0, at, wall / 2)),
        cuboid((span, 0.008, wall), (0.0, -at, wall / 2)),
        cuboid((0.008, span, wall), (at, 0.0, wall / 2)),
        cuboid((0.008, span, wall), (-at, 0.0, wall / 2)),
    ]
    return Body("ring", BodyKind.FIXED, tuple(walls), pose(), 0.0, 0.6)


def rails() -> Body:
    sides = (cuboid((0.3, 0.01, 0.02), (0.0, y, 0.01)) for y in (0.015, -0.015))
    return Body("rails", BodyKind.FIXED, tuple(sides), pose(), 0.0, 0.6)


def faces_of(*shapes: Shape):
    own = convex_set(shapes)
    return resting_faces(own, tuple(centre_of_mass(own)))


@pytest.mark.parametrize(
    ("shape", "count"),
    [
        (Shape(ShapeKind.BOX, (0.11, 0.15, 0.022)), 6),
        (Shape(ShapeKind.CYLINDER, (0.03, 0.1)), 2),  # not on its side
        (Shape(ShapeKind.CYLINDER, (0.1, 0.1)), 2),
        (Shape(ShapeKind.SPHERE, (0.03,)), 0),
        (Shape(ShapeKind.CAPSULE, (0.03, 0.1)), 0),
    ],
)
def test_resting_faces(shape, count):
    faces = faces_of(shape)
    assert len(faces) == count
    assert list(faces) == sorted(faces, key=lambda face: -face.steadiness)


def test_a_body_lies_on_its_resting_faces():
    shapes = (cuboid((0.1, 0.06, 0.04)), cuboid((0.02, 0.02, 0.1), (0.03, 0.0, 0.05)))
    points = convex_set(shapes).vertices
    for face in faces_of(*shapes):
        assert (points @ face.R.T)[:, 2].min() == pytest.approx(-face.height, abs=1e-6)
        assert np.linalg.det(face.R) == pytest.approx(1.0)


def test_a_thin_column_does_not_count_as_standing_on_its_end():
    assert len(faces_of(cuboid((0.01, 0.01, 0.3)))) == 4


def test_a_ball_rests_in_a_ring_and_nowhere_else():
    at = pose((0.0, 0.0, 0.03))
    assert rests(BALL, at, [GROUND, ring(0.006)])
    assert not rests(BALL, at, [GROUND])
    assert not rests(BALL, at, [GROUND, ring(0.05)])  # it rolls too far
    assert not rests(BALL, pose((0.0, 0.0, 0.05)), [GROUND, ring(0.006)])


def test_a_rod_rests_between_rails_but_not_across_them_or_on_the_ground():
    height = 0.02 + np.sqrt(0.02**2 - 0.01**2)
    assert rests(ROD, from_rpy((0.0, 0.0, height), LYING), [GROUND, rails()])
    assert not rests(ROD, from_rpy((0.0, 0.0, 0.04), (np.pi / 2, 0.0, 0.0)), [GROUND, rails()])
    assert not rests(ROD, from_rpy((0.0, 0.0, 0.02), LYING), [GROUND])


@pytest.mark.parametrize(("degrees", "friction", "stays"), [(20.0, 0.6, True), (60.0, 0.2, False)])
def test_leaning_needs_friction(degrees, friction, stays):
    board, wall = body(cuboid((0.01, 0.05, 0.2)), friction=friction), box("wall", (0.02, 1.0, 0.5), (0.1, 0.0, 0.25))
    turn = from_rpy((0.0, 0.0, 0.0), (0.0, np.deg2rad(degrees), 0.0))
    corners = apply(turn, convex_set(board.shapes).vertices)
    T = np.r_[0.09 - corners[:, 0].max(), 0.0, -corners[:, 2].min(), turn[3:]]
    assert rests(board, T, [GROUND, wall]) is stays


def test_what_is_only_clamped_between_walls_does_not_rest():
    walls = [box(f"wall{x}", (0.02, 0.1, 0.1), (x, 0.0, 0.05)) for x in (-0.0395, 0.0395)]
    assert not rests(body(cuboid((0.06,) * 3)), pose((0.0, 0.0, 0.06)), walls)


def test_over_an_edge_the_centre_of_mass_decides():
    block = body(cuboid((0.05, 0.05, 0.1)))
    assert rests(block, pose((0.98, 0.0, 0.05)), [GROUND])
    assert not rests(block, pose((1.01, 0.0, 0.05)), [GROUND])


def test_the_ends_of_a_path_count_as_stable_in_a_ring_at_another_height():
    high = box("high", (0.2, 0.2, 0.1), (0.5, 0.0, 0.05))
    nest = ring(0.006)
    there = Body("there", BodyKind.FIXED, nest.shapes, pose((0.5, 0.0, 0.1)), 0.0, 0.6)
    path = np.array([pose((0.0, 0.0, 0.03)), pose((0.2, 0.0, 0.2)), pose((0.5, 0.0, 0.13))])
    np.testing.assert_array_equal(stable_poses(BALL, path, [GROUND, nest, high, there]), [True, False, True])
    assert not stable_poses(BALL, path, [GROUND, nest, high])[-1]


def stack(offset: float) -> bool:
    """Whether a box on a box on the ground is in equilibrium; the upper one is shifted by ``offset`` m."""
    size = (0.06, 0.06, 0.04)
    lower, upper = box("lower", size, (0.0, 0.0, 0.02)), box("upper", size, (offset, 0.0, 0.06))
    sets = [convex_set((cuboid(size, b.pose[:3]),)) for b in (lower, upper)]
    ground = convex_set((cuboid((2.0, 2.0, 0.1), (0.0, 0.0, -0.05)),))
    contacts = [Contact(patch, 0) for patch in patches(sets[0], ground, 0.5)]
    contacts += [Contact(patch, 1, 0) for patch in patches(sets[1], sets[0], 0.5)]
    return in_equilibrium([0.1, 0.3], np.array([lower.pose[:3], upper.pose[:3]]), contacts, DOWN)


def test_the_equilibrium_of_a_stack():
    assert stack(0.0) and stack(0.025)
    assert not stack(0.035)


def test_the_load_of_a_stack_can_topple_what_carries_it():
    """Each body is above its support, but the whole is not."""
    plate, load, post = (0.2, 0.06, 0.02), (0.04, 0.04, 0.04), (0.06, 0.06, 0.1)
    at = [(0.02, 0.0, 0.11), (0.1, 0.0, 0.14)]
    sets = [convex_set((cuboid(size, place),)) for size, place in zip((plate, load), at, strict=True)]
    below = convex_set((cuboid(post, (0.0, 0.0, 0.05)),))
    contacts = [Contact(patch, 0) for patch in patches(sets[0], below, 0.5)]
    carried = [Contact(patch, 1, 0) for patch in patches(sets[1], sets[0], 0.5)]
    assert in_equilibrium([0.2], np.array(at[:1]), contacts, DOWN)
    assert not in_equilibrium([0.2, 0.4], np.array(at), contacts + carried, DOWN)


def test_the_intersection_of_faces_edges_and_points():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    common = intersection(square, square + [0.5, 0.25])
    np.testing.assert_allclose([common.min(axis=0), common.max(axis=0)], [[0.5, 0.25], [1.0, 1.0]])
    segment = np.array([[-1.0, 0.5], [0.5, 0.5]])
    np.testing.assert_allclose(np.sort(intersection(segment, square), axis=0), [[0.0, 0.5], [0.5, 0.5]])
    np.testing.assert_allclose(np.sort(intersection(segment, segment + [1.0, 0.0]), axis=0), [[0.0, 0.5], [0.5, 0.5]])
    assert len(intersection(square, square + 2.0)) == 0
    np.testing.assert_allclose(intersection(np.array([[0.5, 0.5]]), square), [[0.5, 0.5]])
