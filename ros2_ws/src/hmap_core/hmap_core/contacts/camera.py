"""The surface points of an object that cameras see: the paper's getCameraView, computed from the known scene."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numba import njit

from hmap_core.contacts.solids import covered, interval, solids
from hmap_core.contacts.surface import sample_surface
from hmap_core.deadline import check_time
from hmap_core.exceptions import InputError
from hmap_core.transforms import IDENTITY, apply, inverse, rotation_matrix
from hmap_core.types import Body, Camera

# smallest cosine between line of sight and normal for a useful depth measurement
MIN_COSINE = 0.1
# a point with material at this height above it is inside the body, or another shape of it touches there, m
COVER = 1e-4
# material nearer than this to the point along the line of sight is the surface itself, m
SKIN = 1e-5
DEFAULT_POINTS = 400
# if a smaller share of the points is visible, the same number is sampled again, up to MAX_ROUNDS times
ENOUGH = 0.125
MAX_ROUNDS = 4


@dataclass(frozen=True)
class Cloud:
    """Surface points of one object in its own frame.

    Attributes:
        points: (N, 3) m.
        normals: (N, 3) outward unit normals.
        seen: (N,) whether a camera sees the point.
    """

    points: np.ndarray
    normals: np.ndarray
    seen: np.ndarray

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, keep) -> "Cloud":
        return Cloud(self.points[keep], self.normals[keep], self.seen[keep])


@njit(cache=True, error_model="numpy", nogil=True)
def _uncovered(points, normals, kind, R, p, size, planes, start):
    out = np.empty(points.shape[0], np.bool_)
    for i in range(points.shape[0]):
        out[i] = not covered(points[i] + COVER * normals[i], kind, R, p, size, planes, start)
    return out


@njit(cache=True, error_model="numpy", nogil=True)
def _seen(points, normals, eyes, axes, tan_x, tan_y, kind, R, p, size, planes, start):
    """Whether any camera sees each point; world frame; eyes (C, 3), axes (C, 3, 3) rows x right, y down, z forward."""
    out = np.zeros(points.shape[0], np.bool_)
    t = np.empty(2)
    for i in range(points.shape[0]):
        for c in range(eyes.shape[0]):
            to_eye = eyes[c] - points[i]
            far = np.sqrt(to_eye @ to_eye)
            if normals[i] @ to_eye < MIN_COSINE * far:
                continue
            depth = -(axes[c, 2] @ to_eye)
            if (
                depth <= 0.0
                or abs(axes[c, 0] @ to_eye) > tan_x[c] * depth
                or abs(axes[c, 1] @ to_eye) > tan_y[c] * depth
            ):
                continue
            to_eye = to_eye / far
            free = True
            for s in range(kind.shape[0]):
                interval(s, points[i], to_eye, kind, R, p, size, planes, start, t)
                if t[0] <= t[1] and t[1] > SKIN and t[0] < far:
                    free = False
                    break
            if free:
                out[i] = True
                break
    return out


def visible_points(
    body: Body,
    T_world_obj: np.ndarray,
    obstacles: Iterable[tuple[Body, np.ndarray]],
    cameras: Iterable[Camera],
    rng: np.random.Generator,
    n: int = DEFAULT_POINTS,
    include_unseen: bool = False,
) -> Cloud:
    """Sample points on the object's surface that a camera sees: facing it, in its picture, and not occluded.

    Args:
        body: the object; its own ``pose`` is not used.
        T_world_obj: (7,) its pose.
        obstacles: bodies that can occlude it, as (body, T_world_body).
        cameras: the cameras.
        rng: the only source of randomness.
        n: number of points sampled on the whole surface. Fewer are returned; if only few are visible, sampling is
            denser.
        include_unseen: also return invisible points, with ``seen`` false, as a second choice. Points inside another
            shape of the same body, or touching it, are never returned.

    Returns:
        A Cloud in the object frame.

    Raises:
        InputError: ``n`` is less than 1.
    """
    if n < 1:
        raise InputError(f"{n} surface points were asked for; at least 1 is needed")
    own = solids([(shape, IDENTITY) for shape in body.shapes])
    posed = [(shape, T_world_obj) for shape in body.shapes]
    scene = solids(posed + [(shape, T) for other, T in obstacles for shape in other.shapes])
    check_time()
    cameras = list(cameras)
    parts: list[Cloud] = []
    for k in range(MAX_ROUNDS if cameras else 1):
        check_time()
        points, normals = sample_surface(body.shapes, n, rng)
        if len(own) > 1:
            keep = _uncovered(points, normals, *own.arrays)
            points, normals = points[keep], normals[keep]
        check_time()
        seen = _seen_by(points, normals, T_world_obj, scene, cameras)
        cloud = Cloud(points, normals, seen)
        parts.append(cloud if include_unseen and k == 0 else cloud[seen])
        if sum(int(part.seen.sum()) for part in parts) >= ENOUGH * n:
            break
    return Cloud(*(np.concatenate([getattr(p, field) for p in parts]) for field in ("points", "normals", "seen")))


def _seen_by(points, normals, T_world_obj, scene, cameras) -> np.ndarray:
    if not cameras:
        return np.zeros(len(points), bool)
    eyes = np.array([camera.pose[:3] for camera in cameras])
    axes = np.array([np.ascontiguousarray(rotation_matrix(camera.pose).T) for camera in cameras])
    tan_y = np.array([np.tan(camera.fov_y / 2) for camera in cameras])
    tan_x = tan_y * np.array([camera.width / camera.height for camera in cameras])
    world_normals = normals @ rotation_matrix(T_world_obj).T
    return _seen(apply(T_world_obj, points), world_normals, eyes, axes, tan_x, tan_y, *scene.arrays)


def project(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Pixel coordinates and depth (N, 3) of world points (N, 3) in a camera's picture."""
    local = apply(inverse(camera.pose), points)
    focal = camera.height / 2 / np.tan(camera.fov_y / 2)
    center = np.array([camera.width, camera.height]) / 2
    return np.c_[focal * local[:, :2] / local[:, 2:] + center, local[:, 2]]
