"""Signed distances against coal and against the exact Minkowski difference."""

from itertools import combinations_with_replacement

import coal
import numpy as np
import pytest
from core_fixtures import KINDS, random_hull, random_pose, single
from geometry_fixtures import coal_distance, coal_hull
from scipy.spatial import ConvexHull

from hmap_core.collision.convex import set_distance
from hmap_core.collision.epa import FAR
from hmap_core.collision.gjk import distance_within, signed_distance
from hmap_core.collision.simplex import WORK
from hmap_core.transforms import IDENTITY, apply, rotation_matrix

PAIRS = list(combinations_with_replacement(KINDS, 2))
SOLID = [("box", "box"), ("box", "hull"), ("hull", "hull"), ("capsule", "hull")]  # with a volume to overlap
CASES = 300  # of each pair of kinds
TOLERANCE = 2e-6  # m


def measure(A, T_a, B, T_b):
    witness = np.zeros((3, 3))
    d = signed_distance(
        A[0], rotation_matrix(T_a), T_a[:3].copy(), A[1], B[0], rotation_matrix(T_b), T_b[:3].copy(), B[1], witness
    )
    return d, witness


def exact_depth(A, T_a, B, T_b) -> float:
    """Distance of the origin from the boundary of the Minkowski difference of two solids, plus their radii."""
    points = (apply(T_a, A[0])[:, None] - apply(T_b, B[0])[None]).reshape(-1, 3)
    return -ConvexHull(points).equations[:, 3].max() + A[1] + B[1]


def random_case(rng, kinds, spread):
    A, B = (random_hull(rng, kind) for kind in kinds)
    return A, B, random_pose(rng, spread), random_pose(rng, spread)


def coal_shape(hull):
    vertices, radius = hull
    if len(vertices) == 1:
        return coal.Sphere(radius)
    if len(vertices) == 2:
        return coal.Capsule(radius, float(np.ptp(vertices[:, 2])))
    return coal_hull(vertices)


@pytest.mark.parametrize("kinds", PAIRS, ids="-".join)
def test_separated_shapes_are_as_far_apart_as_coal_says(kinds):
    rng = np.random.default_rng(1)
    seen = 0
    while seen < CASES:
        A, B = (random_hull(rng, kind) for kind in kinds)
        T_a, T_b = random_pose(rng, 0.3), random_pose(rng, 0.3)
        expected = coal_distance(coal_shape(A), T_a, coal_shape(B), T_b)
        if expected <= 0:
            continue
        assert measure(A, T_a, B, T_b)[0] == pytest.approx(expected, abs=TOLERANCE)
        seen += 1


@pytest.mark.parametrize("kinds", SOLID, ids="-".join)
@pytest.mark.parametrize("spread", [0.1, 0.01], ids=["overlap", "deep overlap"])
def test_overlapping_shapes_are_as_deep_as_their_minkowski_difference(kinds, spread):
    rng = np.random.default_rng(2)
    seen = 0
    while seen < CASES // 3:
        A, B = (random_hull(rng, kind) for kind in kinds)
        T_a, T_b = random_pose(rng, spread), random_pose(rng, spread)
        depth = exact_depth(A, T_a, B, T_b)
        if depth <= A[1] + B[1]:
            continue
        assert measure(A, T_a, B, T_b)[0] == pytest.approx(-depth, abs=TOLERANCE)
        seen += 1


@pytest.mark.parametrize("kinds", PAIRS, ids="-".join)
@pytest.mark.parametrize("spread", [0.3, 0.03], ids=["mostly apart", "mostly overlapping"])
def test_moving_by_the_distance_along_the_normal_makes_them_touch(kinds, spread):
    rng = np.random.default_rng(3)
    for _ in range(CASES):
        A, B, T_a, T_b = random_case(rng, kinds, spread)
        d, witness = measure(A, T_a, B, T_b)
        assert np.linalg.norm(witness[0]) == pytest.approx(1.0, abs=1e-9)
        touching = T_a - np.concatenate([d * witness[0], np.zeros(4)])
        assert measure(A, touching, B, T_b)[0] == pytest.approx(0.0, abs=5e-6)


@pytest.mark.parametrize("kinds", PAIRS, ids="-".join)
@pytest.mark.parametrize("spread", [0.3, 0.03], ids=["mostly apart", "mostly overlapping"])
def test_witness_points_lie_on_the_shapes_opposite_each_other(kinds, spread):
    """Else the lever arms, and with them the gradients about the joints, are wrong."""
    rng = np.random.default_rng(3)
    for _ in range(CASES):
        A, B, T_a, T_b = random_case(rng, kinds, spread)
        d, (normal, on_a, on_b) = measure(A, T_a, B, T_b)
        np.testing.assert_allclose(on_a - on_b, d * normal, atol=5e-6)
        for point, shape, T in ((on_a, A, T_a), (on_b, B, T_b)):
            on = measure((np.zeros((1, 3)), 0.0), np.concatenate([point, IDENTITY[3:]]), shape, T)[0]
            assert on == pytest.approx(0.0, abs=5e-6)


def test_distance_is_symmetric_and_follows_a_common_motion():
    rng = np.random.default_rng(4)
    for _ in range(CASES):
        A, B = (single(random_hull(rng, kind)) for kind in rng.choice(KINDS, 2))
        T_a, T_b = random_pose(rng, 0.2), random_pose(rng, 0.2)
        d = set_distance(A, T_a, B, T_b)
        assert set_distance(B, T_b, A, T_a) == pytest.approx(d, abs=TOLERANCE)


@pytest.mark.parametrize("cutoff", [-0.01, 0.0, 0.02])
def test_beyond_the_cutoff_only_a_bound_is_promised(cutoff):
    rng = np.random.default_rng(5)
    beyond = 0
    work, witness = np.zeros(WORK), np.zeros((3, 3))
    for k in range(CASES):
        A, B = (random_hull(rng, kind) for kind in rng.choice(KINDS, 2))
        T_a, T_b = random_pose(rng, 0.2), random_pose(rng, 0.2)
        exact = measure(A, T_a, B, T_b)[0]
        work[:3] = rng.normal(size=3) if k % 2 else T_a[:3] - T_b[:3]  # any direction may come from the last call
        d = distance_within(
            A[0], rotation_matrix(T_a), T_a[:3].copy(), A[1], B[0], rotation_matrix(T_b), T_b[:3].copy(), B[1],
            cutoff, witness, work,
        )  # fmt: skip
        if exact <= cutoff:
            assert d == pytest.approx(exact, abs=TOLERANCE)
        else:
            assert cutoff < d + TOLERANCE and d <= exact + TOLERANCE
            beyond += d < exact - TOLERANCE
    assert beyond > 0  # the cutoff saves work


def test_cubes_in_special_position():
    """Parallel faces, edge on edge, corner on corner, and centre on centre."""
    cube = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    for offset, expected in [
        ((1.2, 0, 0), 0.2), ((1.3, 1.4, 0), 0.5), ((1.1, 1.2, 1.2), 0.3), ((0.9, 0, 0), -0.1), ((0, 0, 0), -1.0),
        ((0.9, 0.95, 0.99), -0.01), ((1.0, 0, 0), 0.0), ((1.0, 1.0, 1.0), 0.0), ((0.3, 0.3, 0.3), -0.7),
    ]:  # fmt: skip
        T = np.concatenate([offset, IDENTITY[3:]])
        assert measure((cube, 0.0), T, (cube, 0.0), IDENTITY.copy())[0] == pytest.approx(expected, abs=1e-7)


def test_flat_and_thin_shapes():
    """A triangle, a segment and a point have no volume, and still distances."""
    triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    segment = np.array([[0.2, 0.2, -0.1], [0.2, 0.2, 0.3]])
    point = np.array([[0.25, 0.25, 0.5]])
    here = IDENTITY.copy()
    assert measure((triangle, 0.0), here, (point, 0.1), here)[0] == pytest.approx(0.4, abs=1e-9)
    assert measure((segment, 0.01), here, (triangle, 0.02), here)[0] <= -0.03 + 1e-9
    assert measure((segment, 0.0), here, (segment + [0.5, 0, 0.1], 0.0), here)[0] == pytest.approx(0.5, abs=1e-9)
    assert FAR > 1e6
