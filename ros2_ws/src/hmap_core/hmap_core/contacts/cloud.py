"""The object's point cloud from a measured (or rendered) depth picture: the paper's getCameraView on hardware."""

import numpy as np
import open3d as o3d

from hmap_core.contacts.camera import Cloud
from hmap_core.exceptions import InputError
from hmap_core.transforms import apply, inverse, multiply, rotation_matrix

# edge of a voxel, m; one point is kept per voxel
VOXEL = 0.004
# a point is an outlier if its mean distance to its neighbours is this many standard deviations above the mean
OUTLIER_NEIGHBOURS = 16
OUTLIER_DEVIATIONS = 2.0
# normals are fitted to the neighbours in this radius, m
NORMAL_RADIUS = 0.012
NORMAL_NEIGHBOURS = 30
# smallest number of points of a cloud
MIN_POINTS = 20


def cloud_from_depth(
    depth: np.ndarray, mask: np.ndarray, intrinsics: np.ndarray, T_world_optical: np.ndarray, T_world_obj: np.ndarray
) -> Cloud:
    """Compute the point cloud with normals of the masked object.

    Args:
        depth: (H, W) m along the optical axis; not finite or not positive: no measurement.
        mask: (H, W) true on the object.
        intrinsics: (3, 3) pinhole matrix.
        T_world_optical: (7,) pose of the optical frame (x right, y down, z forward).
        T_world_obj: (7,) the object's pose at the time of the picture.

    Returns:
        The cloud in the object frame: down-sampled to VOXEL, without outliers, with normals towards the camera. Empty
        if fewer than MIN_POINTS points are visible.

    Raises:
        InputError: the arrays' shapes do not match.
    """
    depth, mask = np.asarray(depth, float), np.asarray(mask, bool)
    if depth.ndim != 2 or depth.shape != mask.shape or np.shape(intrinsics) != (3, 3):
        raise InputError(
            f"depth {depth.shape}, mask {mask.shape} and intrinsics {np.shape(intrinsics)} do not fit; "
            "needed: (H, W), (H, W) and (3, 3)"
        )
    rows, columns = np.nonzero(mask & np.isfinite(depth) & (depth > 0.0))
    points = back_projected(depth, rows, columns, np.asarray(intrinsics, float))
    if len(points) < MIN_POINTS:
        return _empty()
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
    cloud = cloud.voxel_down_sample(VOXEL)
    cloud, _ = cloud.remove_statistical_outlier(OUTLIER_NEIGHBOURS, OUTLIER_DEVIATIONS)
    if len(cloud.points) < MIN_POINTS:
        return _empty()
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(NORMAL_RADIUS, NORMAL_NEIGHBOURS))
    cloud.orient_normals_towards_camera_location(np.zeros(3))
    T_obj_optical = multiply(inverse(T_world_obj), T_world_optical)
    normals = np.asarray(cloud.normals) @ rotation_matrix(T_obj_optical).T
    return Cloud(apply(T_obj_optical, np.asarray(cloud.points)), normals, np.ones(len(normals), bool))


def merge_clouds(clouds: list[Cloud]) -> Cloud:
    """One cloud from the clouds of several cameras of the same object."""
    if not clouds:
        return _empty()
    return Cloud(*(np.concatenate([getattr(c, f) for c in clouds]) for f in ("points", "normals", "seen")))


def back_projected(depth: np.ndarray, rows: np.ndarray, columns: np.ndarray, intrinsics: np.ndarray) -> np.ndarray:
    """Points (N, 3) in the optical frame of the pixels in rows (N,) and columns (N,) of a depth picture (H, W)."""
    z = depth[rows, columns]
    K = intrinsics
    return np.c_[(columns - K[0, 2]) * z / K[0, 0], (rows - K[1, 2]) * z / K[1, 1], z]


def _empty() -> Cloud:
    return Cloud(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, bool))
