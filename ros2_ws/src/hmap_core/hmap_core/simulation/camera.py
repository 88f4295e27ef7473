"""Pictures of the simulated world: colour, depth and instance mask, from PyBullet's software renderer."""

from dataclasses import dataclass

import numpy as np
import pybullet

from hmap_core import transforms
from hmap_core.simulation.client import BulletClient
from hmap_core.types import Camera

NEAR = 0.05  # m; nothing closer is seen
FAR = 10.0  # m; nothing farther is seen
BACKGROUND = 0  # in the instance mask

# from the optical frame (x right, y down, z forward) to OpenGL's (x right, y up, z backward)
_T_OPTICAL_GL = transforms.pose(quaternion=(1.0, 0.0, 0.0, 0.0))


@dataclass(frozen=True)
class CameraImage:
    """What a camera sees at one instant.

    Attributes:
        color: (H, W, 3) uint8, RGB.
        depth: (H, W) float32, distance along the optical axis in metres; NaN where nothing is within range.
        mask: (H, W) int32, instance number; 0 is the background.
        names: instance number -> name of the body or robot.
    """

    color: np.ndarray
    depth: np.ndarray
    mask: np.ndarray
    names: dict[int, str]


def intrinsics(camera: Camera) -> np.ndarray:
    """Pinhole matrix (3, 3) with square pixels; the centre of the first pixel is at (0, 0)."""
    focal = 0.5 * camera.height / np.tan(0.5 * camera.fov_y)
    return np.array([[focal, 0.0, 0.5 * (camera.width - 1)], [0.0, focal, 0.5 * (camera.height - 1)], [0.0, 0.0, 1.0]])


def render(client: BulletClient, camera: Camera, instances: dict[int, tuple[int, str]]) -> CameraImage:
    """Take a picture.

    Args:
        instances: PyBullet's body id -> (instance number, name).
    """
    T_gl_world = transforms.inverse(transforms.multiply(camera.pose, _T_OPTICAL_GL))
    projection = _projection(client, camera)
    _, _, rgba, buffer, segments = client.getCameraImage(
        camera.width,
        camera.height,
        transforms.to_matrix(T_gl_world).T.ravel().tolist(),  # column by column
        projection,
        renderer=pybullet.ER_TINY_RENDERER,
    )
    shape = (camera.height, camera.width)
    color = np.reshape(np.asarray(rgba, np.uint8), (*shape, 4))[:, :, :3].copy()
    buffer = np.reshape(np.asarray(buffer, float), shape)
    segments = np.reshape(np.asarray(segments, np.int32), shape)
    depth = np.where(segments < 0, np.nan, FAR * NEAR / (FAR - (FAR - NEAR) * buffer)).astype(np.float32)
    mask = np.full(shape, BACKGROUND, np.int32)
    for identifier, (number, _) in instances.items():
        mask[segments == identifier] = number
    return CameraImage(color, depth, mask, dict(instances.values()))


def _projection(client: BulletClient, camera: Camera) -> list[float]:
    """OpenGL projection, column by column, that puts pixel centres where :func:`intrinsics` has them.

    The renderer samples at pixel corners; half a pixel of shift makes up for it.
    """
    aspect = camera.width / camera.height
    projection = list(client.computeProjectionMatrixFOV(float(np.rad2deg(camera.fov_y)), aspect, NEAR, FAR))
    projection[8] += 1.0 / camera.width
    projection[9] += 1.0 / camera.height
    return projection
