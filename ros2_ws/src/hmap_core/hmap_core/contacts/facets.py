"""Facets: the parts of an attached body that can touch an object, as planar patches and the edges of round shapes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from hmap_core.collision.convex import hull_vertices
from hmap_core.contacts.candidates import CONTACT_GAP, FEATURE, tangents
from hmap_core.transforms import apply, rotation_matrix
from hmap_core.types import AttachedBody, Shape, ShapeKind

# number of directions around a cylinder or capsule in which it can touch
ROUND = 12
# facets of a mesh whose normals differ by less are merged; cosine
SAME_NORMAL = 0.999
# rotations of a facet about the touched surface's normal, rad; the body is upright as it stood at the first one
ROLLS = np.deg2rad([0.0, 90.0, 180.0, 270.0])
# share of the touches in which the middle of a facet is at the point; in the others a random point of it is
MIDDLE = 0.5
# points of a surface that are tried with each facet
PER_FACET = 40


@dataclass(frozen=True)
class Facet:
    """A patch of a convex shape that is foremost in one direction.

    Attributes:
        vertices: (V, 3) its corners on the surface, m.
        normal: (3,) outward unit normal.
    """

    vertices: np.ndarray
    normal: np.ndarray


def _directions(shape: Shape, points: np.ndarray) -> np.ndarray:
    """Directions (K, 3) in the frame of ``points``, for a shape with these hull vertices."""
    axes = rotation_matrix(shape.pose).T
    if shape.kind == ShapeKind.BOX:
        return np.concatenate([axes, -axes])
    if shape.kind == ShapeKind.SPHERE:
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / np.sqrt(3.0)
        return np.concatenate([np.eye(3), -np.eye(3), corners])
    if shape.kind == ShapeKind.MESH:
        found: list[np.ndarray] = []
        for normal in ConvexHull(points).equations[:, :3]:
            if not found or (np.array(found) @ normal).max() < SAME_NORMAL:
                found.append(normal)
        return np.array(found)
    angle = 2.0 * np.pi * np.arange(ROUND) / ROUND
    around = np.cos(angle)[:, None] * axes[0] + np.sin(angle)[:, None] * axes[1]
    return np.concatenate([around, [axes[2], -axes[2]]])


def facets(shapes: Sequence[Shape]) -> list[Facet]:
    """The facets of all shapes in their body's frame, including those inside another shape."""
    found = []
    for shape in shapes:
        points, radius = hull_vertices(shape)
        for normal in _directions(shape, points):
            ahead = points @ normal
            found.append(Facet(points[ahead >= ahead.max() - FEATURE] + radius * normal, normal))
    return found


def attached_facets(held: AttachedBody) -> list[Facet]:
    """The facets of an attached body in the end-effector frame."""
    R = rotation_matrix(held.T_ee_body)
    return [Facet(apply(held.T_ee_body, f.vertices), R @ f.normal) for f in facets(held.shapes)]


def facet_poses(
    facet: Facet,
    up: np.ndarray,
    points: np.ndarray,
    normals: np.ndarray,
    toward: np.ndarray,
    rng: np.random.Generator,
    middle: float = MIDDLE,
    count: int = PER_FACET,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Poses of the end-effector frame at which a facet is CONTACT_GAP above points of a surface, with all ROLLS.

    Args:
        facet: in the end-effector frame.
        up: (3,) vertical direction of the facet's body, end-effector frame.
        points: (N, 3) of the surface, m; at most ``count`` are used.
        normals: (N, 3) outward unit normals of the surface.
        toward: (3,) vertical direction in the surface's frame.
        rng: draws the points, and the facet's point that touches them.
        middle: share of the touches in which the facet's middle touches.
        count: largest number of points.

    Returns:
        R (M, 3, 3), origin (M, 3), upright (M,): cosine between both vertical directions, and the index (M,) of the
        point.
    """
    K = len(ROLLS)
    chosen = rng.permutation(len(points))[:count]
    points, normals = points[chosen], normals[chosen]
    own, _ = tangents(facet.normal[None], up)
    frame = np.stack([own[0], np.cross(facet.normal, own[0]), facet.normal], axis=1)
    first, second = (np.repeat(t, K, axis=0) for t in tangents(-normals, toward))
    inward = np.repeat(-normals, K, axis=0)
    rolls = np.tile(ROLLS, len(points))
    x = np.cos(rolls)[:, None] * first + np.sin(rolls)[:, None] * second
    R = np.stack([x, np.cross(inward, x), inward], axis=2) @ frame.T
    weights = rng.dirichlet(np.ones(len(facet.vertices)), len(points))
    weights[rng.random(len(points)) < middle] = 1.0 / len(facet.vertices)
    anchor = np.repeat(weights @ facet.vertices, K, axis=0)
    origin = np.repeat(points + CONTACT_GAP * normals, K, axis=0) - np.einsum("nij,nj->ni", R, anchor)
    return R, origin, toward @ R @ up, np.repeat(chosen, K)
