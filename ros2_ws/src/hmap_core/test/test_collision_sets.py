"""Sets of convex shapes: bounds, shapes of every kind, and the questions asked about pairs of sets."""

import numpy as np
import pytest
from core_fixtures import KINDS, random_hull, random_pose, single
from geometry_fixtures import coal_distance
from geometry_fixtures import coal_shape as exact_shape

from hmap_core.collision.convex import CYLINDER_SIDES, convex_set, from_hulls, set_distance, sets_closer, transformed
from hmap_core.collision.pairs import pair_distance, place_centers
from hmap_core.collision.scene_model import CollisionModel
from hmap_core.collision.simplex import WORK
from hmap_core.exceptions import Code, InputError
from hmap_core.transforms import IDENTITY, multiply, pose, rotation_matrix
from hmap_core.types import Shape, ShapeKind


def random_set(rng, count=4):
    hulls = [(v + rng.uniform(-0.3, 0.3, 3), r) for v, r in (random_hull(rng, k) for k in rng.choice(KINDS, count))]
    return from_hulls(hulls)


def each_pair(A, T_a, B, T_b):
    return [
        set_distance(single((A.hull(i), A.radius[i])), T_a, single((B.hull(j), B.radius[j])), T_b)
        for i in range(len(A))
        for j in range(len(B))
    ]


def closer(A, T_a, B, T_b, min_distance):
    return sets_closer(
        A.vertices, A.start, A.radius, A.center, A.bound, rotation_matrix(T_a), T_a[:3],
        B.vertices, B.start, B.radius, B.center, B.bound, rotation_matrix(T_b), T_b[:3], min_distance,
    )  # fmt: skip


def test_a_set_is_as_far_as_its_nearest_shape():
    rng = np.random.default_rng(1)
    answers = []
    for _ in range(40):
        A, B = random_set(rng), random_set(rng)
        T_a, T_b = random_pose(rng, 0.7), random_pose(rng, 0.7)
        nearest = min(each_pair(A, T_a, B, T_b))
        assert set_distance(A, T_a, B, T_b) == pytest.approx(nearest, abs=2e-6)
        assert set_distance(A, T_a, B, T_b, nearest + 0.01) == pytest.approx(nearest, abs=2e-6)
        assert set_distance(A, T_a, B, T_b, nearest - 0.01) > nearest - 0.01
        for min_distance in (0.0, 0.05, nearest + 1e-5, nearest - 1e-5):
            answers.append(closer(A, T_a, B, T_b, min_distance))
            assert answers[-1] == (nearest < min_distance)
    assert {True, False} == set(answers)


def test_bounding_spheres_hold_their_shapes():
    rng = np.random.default_rng(2)
    for _ in range(50):
        A = random_set(rng)
        for s in range(len(A)):
            farthest = np.linalg.norm(A.hull(s) - A.center[s], axis=1).max() + A.radius[s]
            assert farthest <= A.bound[s] + 1e-12
            assert A.bound[s] <= 1.3 * (farthest + A.radius[s]) + 1e-12


def test_transformed_sets_are_the_sets_at_that_pose():
    rng = np.random.default_rng(3)
    A, B = random_set(rng), random_set(rng)
    for _ in range(20):
        T, T_b = random_pose(rng, 0.6), random_pose(rng, 0.6)
        moved = transformed(A, T)
        assert set_distance(moved, IDENTITY, B, T_b) == pytest.approx(set_distance(A, T, B, T_b), abs=2e-6)


@pytest.mark.parametrize(
    "shape",
    [
        Shape(ShapeKind.BOX, (0.1, 0.2, 0.3), pose((0.1, 0, 0.2), (0.3, 0.1, 0.5, 0.8))),
        Shape(ShapeKind.SPHERE, (0.07,), pose((0.1, 0, 0.2))),
        Shape(ShapeKind.CYLINDER, (0.06, 0.2), pose((0, 0.1, 0), (0.5, 0.2, 0.1, 0.4))),
    ],
    ids=lambda shape: shape.kind.value,
)
def test_shapes_are_what_coal_calls_them(shape):
    """A cylinder is a prism drawn round it: at most half a percent of its radius larger, nowhere smaller."""
    rng = np.random.default_rng(4)
    probe = Shape(ShapeKind.SPHERE, (0.03,))
    larger = shape.size[0] * (1 / np.cos(np.pi / CYLINDER_SIDES) - 1) if shape.kind == ShapeKind.CYLINDER else 0.0
    for _ in range(200):
        T_a, T_b = random_pose(rng, 0.3), random_pose(rng, 0.3)
        expected = coal_distance(exact_shape(shape), multiply(T_a, shape.pose), exact_shape(probe), T_b)
        d = set_distance(convex_set([shape]), T_a, convex_set([probe]), T_b)
        if expected > 0:
            assert expected - larger - 2e-6 <= d <= expected + 2e-6


def test_capsules_are_swept_segments():
    capsule = convex_set([Shape(ShapeKind.CAPSULE, (0.05, 0.2))])
    ball = convex_set([Shape(ShapeKind.SPHERE, (0.01,))])
    for z in (0.0, 0.05, 0.1):
        assert set_distance(capsule, IDENTITY, ball, pose((0.2, 0, z))) == pytest.approx(0.14, abs=1e-9)
    assert set_distance(capsule, IDENTITY, ball, pose((0, 0, 0.4))) == pytest.approx(0.24, abs=1e-9)


def test_a_missing_mesh_is_named(tmp_path):
    shape = Shape(ShapeKind.MESH, (1.0, 1.0, 1.0), mesh=tmp_path / "missing.stl")
    with pytest.raises(InputError, match="missing.stl") as error:
        convex_set([shape])
    assert error.value.code == Code.INVALID_SCENE


def test_pair_distance_is_exact_within_its_cutoff_and_a_bound_beyond():
    rng = np.random.default_rng(5)
    witness, work = np.zeros((3, 3)), np.zeros(WORK)
    beyond = 0
    for _ in range(30):
        scene = CollisionModel()
        for frame in (0, 1):
            for kind in KINDS:
                vertices, radius = random_hull(rng, kind)
                scene.add(kind, vertices + rng.uniform(-0.2, 0.2, 3), radius, frame)
        scene.keep_apart(range(4), range(4, 8), 0.01)
        cols = scene.arrays()
        T = [random_pose(rng, 0.5) for _ in range(2)]
        R, p = np.array([rotation_matrix(t) for t in T]), np.array([t[:3] for t in T])
        centers = np.empty((8, 3))
        place_centers(cols, R, p, centers)
        for k in range(len(cols.a)):
            a, b = scene.hulls[cols.a[k]], scene.hulls[cols.b[k]]
            exact = set_distance(single(a[:2]), T[0], single(b[:2]), T[1])
            d = pair_distance(cols, k, R, p, centers, 0.05, np.zeros(9, np.int16), witness, work)
            if exact <= 0.05:
                assert d == pytest.approx(exact, abs=2e-6)
            else:
                assert 0.05 - 2e-6 < d <= exact + 2e-6
                beyond += 1
    assert beyond > 0


def test_pairs_carry_names_minimum_distances_and_phases():
    scene = CollisionModel()
    a = scene.add("robot/link", np.zeros((1, 3)), 0.1, 1)
    b = scene.add_set("wall", single((np.eye(3), 0.0)), 0)
    scene.keep_apart([a], b, 0.004, 0b101)
    other = scene.copy()
    other.keep_apart([a], b, 0.0)
    cols = scene.arrays()
    assert scene.pair_name(0) == ("robot/link", "wall")
    assert (cols.min_distance.tolist(), cols.phases.tolist(), cols.frame.tolist()) == ([0.004], [0b101], [1, 0])
    assert len(other.pairs) == 2
