"""A canvas with depth for pictures of plans: layers, outlines and spheres with occlusion."""

from collections.abc import Sequence

import numpy as np

from hmap_core.simulation.camera import intrinsics
from hmap_core.transforms import apply, inverse
from hmap_core.types import Camera

DEPTH_TOLERANCE = 0.002  # m, difference in depth below which the new layer is visible
LIGHT = np.array([-0.4, -0.6, -0.7]) / np.linalg.norm([-0.4, -0.6, -0.7])  # direction to the light, camera frame
AMBIENT = 0.55  # brightness of the unlit side of a sphere, relative to its colour
HIGHLIGHT = 24.0  # exponent of the specular highlight


class Canvas:
    """A picture with depth.

    Args:
        camera: the camera of the picture.
        color: (H, W, 3) uint8.
        depth: (H, W) m along the optical axis; not finite where there is nothing.

    Attributes:
        camera: as given.
        color: (H, W, 3) in [0, 1].
        depth: (H, W) m along the optical axis; infinite where there is nothing.
    """

    def __init__(self, camera: Camera, color: np.ndarray, depth: np.ndarray):
        self.camera = camera
        self.color = color.astype(float) / 255.0
        self.depth = np.where(np.isfinite(depth), depth, np.inf)

    def ghost(self, color: np.ndarray, depth: np.ndarray, mask: np.ndarray, alpha: float, hidden: float) -> None:
        """Draws a transparent layer.

        Args:
            color: (H, W, 3) in [0, 1].
            depth: (H, W) m.
            mask: (H, W) bool, the pixels of the layer.
            alpha: opacity where the layer is visible.
            hidden: opacity where it is occluded.
        """
        behind = depth > self.depth + DEPTH_TOLERANCE
        weight = np.where(mask, np.where(behind, hidden, alpha), 0.0)[:, :, None]
        self.color = (1.0 - weight) * self.color + weight * color

    def outline(self, mask: np.ndarray, color: Sequence[float], width: int) -> None:
        """Draws the outline of a mask.

        Args:
            mask: (H, W) bool.
            color: RGB in [0, 1].
            width: pixels.
        """
        inner = mask.copy()
        for _ in range(width):
            shrunk = inner.copy()
            shrunk[1:] &= inner[:-1]
            shrunk[:-1] &= inner[1:]
            shrunk[:, 1:] &= inner[:, :-1]
            shrunk[:, :-1] &= inner[:, 1:]
            inner = shrunk
        self.color[mask & ~inner] = color

    def sphere(self, center: np.ndarray, radius: float, color: Sequence[float], hidden: float) -> None:
        """Draws a shaded sphere.

        Args:
            center: (3,) m, world frame.
            radius: m.
            color: RGB in [0, 1].
            hidden: opacity where it is occluded.
        """
        K = intrinsics(self.camera)
        x, y, z = apply(inverse(self.camera.pose), center)
        if z <= radius:
            return
        u, v, r = K[0, 0] * x / z + K[0, 2], K[1, 1] * y / z + K[1, 2], K[0, 0] * radius / z
        rows, columns = (_within(middle, r, size) for middle, size in zip((v, u), self.depth.shape, strict=True))
        V, U = np.mgrid[rows, columns]
        if U.size == 0:
            return
        nx, ny = (U - u) / r, (V - v) / r
        inside = nx**2 + ny**2 <= 1.0
        nz = -np.sqrt(np.clip(1.0 - nx**2 - ny**2, 0.0, None))
        lit = np.clip(nx * LIGHT[0] + ny * LIGHT[1] + nz * LIGHT[2], 0.0, None)
        shaded = (AMBIENT + (1.0 - AMBIENT) * lit)[:, :, None] * np.asarray(color) + (0.6 * lit**HIGHLIGHT)[:, :, None]
        behind = z + radius * nz > self.depth[rows, columns] + DEPTH_TOLERANCE
        weight = np.where(inside, np.where(behind, hidden, 1.0), 0.0)[:, :, None]
        self.color[rows, columns] = (1.0 - weight) * self.color[rows, columns] + weight * shaded.clip(0.0, 1.0)


def _within(middle: float, radius: float, size: int) -> slice:
    """The pixels of 0 to ``size`` - 1 that are within a radius of a place, which may be outside."""
    first, last = np.clip([np.floor(middle - radius), np.ceil(middle + radius) + 1.0], 0, size).astype(int)
    return slice(int(first), int(last))
