"""Animation of a plan: an animated GIF as the best camera sees it."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

from hmap_core.exceptions import InputError
from hmap_core.trajectory.samples import index_at
from hmap_core.types import Plan
from hmap_core.viz.picture import GREEN, RED, YELLOW, Painter
from hmap_core.viz.view import camera_for

WIDTH, HEIGHT = 480, 380  # pixels
PERIOD = 0.1  # s for which each frame is shown
MOST = 120  # frames; longer plans are shown faster
PAUSE = 1.5  # s for which the last frame is shown
COLORS = 160
SAMPLED = 8  # frames from which the colours are chosen


def animate(plan: Plan, path: str | Path, on_frame: Callable[[int, int], None] = lambda done, of: None) -> None:
    """Renders a plan into an animated GIF.

    Args:
        plan: the plan.
        path: the file.
        on_frame: called after each frame with the number of frames that are done, and of all.

    Raises:
        InputError: the file cannot be written.
    """
    times = _times(float(plan.trajectory.time[-1]))
    pictures = []
    with Painter(plan, camera_for(plan, WIDTH, HEIGHT)) as painter:
        for t in times:
            pictures.append(painter.frame(index_at(plan.trajectory.time, t)))
            on_frame(len(pictures), len(times))
    palette = _palette(pictures)
    frames = [Image.fromarray(p).quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures]
    durations = [round(1e3 * PERIOD)] * (len(frames) - 1) + [round(1e3 * PAUSE)]
    try:
        frames[0].save(path, format="GIF", save_all=True, append_images=frames[1:], duration=durations, loop=0)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error}") from error


def _times(duration: float) -> np.ndarray:
    """The times of the frames, s: in real time, or faster where there would be too many."""
    count = min(max(2, round(duration / PERIOD) + 1), MOST)
    return np.linspace(0.0, duration, count)


def _palette(pictures: list[np.ndarray]) -> Image.Image:
    """An image with the colours of an animation: one palette for all, so that what stands still is stored once."""
    marks = [np.full_like(pictures[0], np.round(255.0 * np.array(color))) for color in (RED, YELLOW, GREEN)]
    sampled = pictures[:: max(1, len(pictures) // SAMPLED)]
    return Image.fromarray(np.concatenate([*marks, *sampled])).quantize(COLORS)
