"""Captions of pictures: when a picture is, and what happens then."""

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from hmap_core.types import Plan
from hmap_core.viz.key_frames import contact_at

SIZE = 0.045  # height of the letters, relative to the picture's
LEAST = 6  # pixels; smaller letters cannot be read
INK, PAPER = (20, 20, 20), (255, 255, 255)


def caption(plan: Plan, sample: int) -> str:
    """The time of a sample, and which robot does what then."""
    time, contact = f"{plan.trajectory.time[sample]:.1f} s", contact_at(plan, sample)
    if contact is None:
        return time
    tool = f" with {contact.manipulator}" if contact.manipulator in plan.scene.bodies else ""
    return f"{time}  {contact.robot}: {contact.kind} {contact.object}{tool}"


def add_caption(pixels: np.ndarray, text: str) -> np.ndarray:
    """A picture (H, W, 3), uint8, with a line of text at its upper left."""
    size = round(SIZE * len(pixels))
    if size < LEAST:
        return pixels
    image = Image.fromarray(pixels)
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(size)
    place = (size // 2, size // 3)
    draw.rectangle(draw.textbbox(place, text, font), fill=PAPER, outline=PAPER, width=2)
    draw.text(place, text, INK, font)
    return np.asarray(image)
