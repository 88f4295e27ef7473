"""Picture of a plan: key frames side by side. Waypoints are red, contacts yellow, the goal green."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib.image
import numpy as np

from hmap_core import transforms
from hmap_core.exceptions import InputError
from hmap_core.types import Camera, Plan, Segment
from hmap_core.viz.captions import add_caption, caption
from hmap_core.viz.key_frames import contact_at, key_samples
from hmap_core.viz.layers import Canvas
from hmap_core.viz.stage import Stage, goal_alone
from hmap_core.viz.view import camera_for

WIDTH, HEIGHT = 480, 380  # pixels of a key frame
COLUMNS = 3  # of key frames in a picture with more than four
BORDER = 4  # pixels between key frames
OVERSAMPLING = 2  # rendered pixels for each pixel of the picture, along each axis
WAYPOINT_SIZE, CONTACT_SIZE, PATH_SIZE = 0.016, 0.018, 0.006  # radii, relative to half the height of the picture
PATH_STEP = 0.012  # m between the points of the object's path
RED, YELLOW, GREEN = (0.86, 0.12, 0.12), (1.0, 0.82, 0.05), (0.1, 0.62, 0.25)
GOAL_ALPHA, GOAL_HIDDEN = 0.35, 0.12  # opacity of the goal where visible, and where occluded
SPHERE_HIDDEN = 0.45  # opacity of occluded spheres
OUTLINE = 2  # width in pixels of the picture


def render(plan: Plan, path: str | Path) -> None:
    """Renders the key frames of a plan into a PNG file.

    Args:
        plan: the plan.
        path: the file.

    Raises:
        InputError: the file cannot be written.
    """
    pixels = draw(plan, WIDTH, HEIGHT)
    try:
        matplotlib.image.imsave(str(path), pixels, format="png")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error}") from error


def draw(plan: Plan, width: int, height: int) -> np.ndarray:
    """Renders the key frames of a plan, in rows.

    Args:
        plan: the plan.
        width, height: pixels of each key frame.

    Returns:
        The picture, RGB, uint8.
    """
    samples = key_samples(plan)
    with Painter(plan, camera_for(plan, width, height, samples)) as painter:
        frames = [painter.frame(k) for k in samples]
    return _arranged(frames)


class Painter:
    """Draws a plan as a camera sees it; :meth:`close` frees what it needs.

    Args:
        plan: the plan.
        camera: with the pixels of the pictures.
    """

    def __init__(self, plan: Plan, camera: Camera):
        self._plan, self._size = plan, (camera.height, camera.width)
        self._camera = Camera(
            camera.name, camera.pose, OVERSAMPLING * camera.width, OVERSAMPLING * camera.height, camera.fov_y
        )
        self._stage = Stage(plan)
        with goal_alone(plan) as world:
            image = world.render(self._camera)
        self._goal_depth, self._goal_mask = image.depth, image.mask > 0
        self._path = _thinned(plan.trajectory.objects.get(plan.scene.goal.object, np.zeros((0, 7)))[:, :3])

    def __enter__(self) -> "Painter":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def close(self) -> None:
        """Free the simulated world."""
        self._stage.close()

    def frame(self, sample: int) -> np.ndarray:
        """The picture (height, width, 3) of a sample, RGB, uint8, with a caption."""
        height, width = self._size
        pixels = self._canvas(sample).color.reshape(height, OVERSAMPLING, width, OVERSAMPLING, 3).mean(axis=(1, 3))
        return add_caption((255.0 * pixels).round().astype(np.uint8), caption(self._plan, sample))

    def _canvas(self, sample: int) -> Canvas:
        self._stage.show(sample)
        image = self._stage.world.render(self._camera)
        canvas = Canvas(self._camera, image.color, image.depth)
        canvas.ghost(np.array(GREEN), self._goal_depth, self._goal_mask, GOAL_ALPHA, GOAL_HIDDEN)
        canvas.outline(self._goal_mask, GREEN, OVERSAMPLING * OUTLINE)
        self._spheres(canvas, self._path, PATH_SIZE, RED)
        self._spheres(canvas, self._plan.waypoints[:, :3], WAYPOINT_SIZE, RED)
        contact = contact_at(self._plan, sample)
        if contact is not None:
            self._spheres(canvas, self._contact_point(contact)[None], CONTACT_SIZE, YELLOW)
        return canvas

    def _contact_point(self, contact: Segment) -> np.ndarray:
        """Where (3,) the manipulator touches now."""
        if contact.contact_pose is None:
            return self._stage.hand(contact.robot)[0]
        T_world_object = self._stage.world.body_pose(contact.contact_object)
        return transforms.multiply(T_world_object, contact.contact_pose)[:3]

    def _spheres(self, canvas: Canvas, points: np.ndarray, size: float, color: Sequence[float]) -> None:
        """Draws spheres that are equally large in the picture, wherever they are."""
        tan = np.tan(0.5 * self._camera.fov_y)
        for point in points:
            depth = transforms.apply(transforms.inverse(self._camera.pose), point)[2]
            canvas.sphere(point, size * tan * depth, color, SPHERE_HIDDEN)


def _thinned(path: np.ndarray) -> np.ndarray:
    """Points (m, 3) of a path (n, 3), PATH_STEP apart."""
    kept = list(path[:1])
    for point in path:
        if np.linalg.norm(point - kept[-1]) >= PATH_STEP:
            kept.append(point)
    return np.array(kept).reshape(-1, 3)


def _arranged(frames: Sequence[np.ndarray]) -> np.ndarray:
    """Pictures of one size in rows."""
    columns = COLUMNS if len(frames) > 4 else (len(frames) + 1) // 2 if len(frames) > 3 else len(frames)
    height, width, _ = frames[0].shape
    rows = -(-len(frames) // columns)
    shape = (rows * (height + BORDER) - BORDER, columns * (width + BORDER) - BORDER, 3)
    picture = np.full(shape, 255, np.uint8)
    for i, frame in enumerate(frames):
        top, left = i // columns * (height + BORDER), i % columns * (width + BORDER)
        picture[top : top + height, left : left + width] = frame
    return picture
