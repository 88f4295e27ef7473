"""Conversions of images (sensor_msgs/Image): colour, depth in metres or millimetres, and instance masks."""

import numpy as np
from builtin_interfaces.msg import Time
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from hmap_msgs_py.checks import ConversionError
from hmap_msgs_py.clouds import byte_array

ENCODINGS = {  # name -> (type, channels)
    "rgb8": ("u1", 3),
    "bgr8": ("u1", 3),
    "rgba8": ("u1", 4),
    "mono8": ("u1", 1),
    "8UC1": ("u1", 1),
    "mono16": ("u2", 1),
    "16UC1": ("u2", 1),  # depth in mm, 0: none
    "32SC1": ("i4", 1),
    "32FC1": ("f4", 1),  # depth in m, NaN: none
}
MILLIMETRES_PER_METRE = 1000.0


def image_to_message(pixels: np.ndarray, encoding: str, frame_id: str = "", stamp: Time | None = None) -> Image:
    """Convert pixels (H, W) or (H, W, C) of the type that ``encoding`` names.

    Raises:
        ConversionError: the encoding is unknown, or type or shape of the pixels do not fit it.
    """
    kind, channels = _encoding(encoding)
    expected = "(H, W)" if channels == 1 else f"(H, W, {channels})"
    if pixels.shape[2:] != (() if channels == 1 else (channels,)) or pixels.dtype != np.dtype(kind):
        raise ConversionError(
            f"{encoding} takes {np.dtype(kind)} pixels {expected}; given are {pixels.dtype} {pixels.shape}"
        )
    height, width = pixels.shape[:2]
    return Image(
        header=Header(stamp=stamp or Time(), frame_id=frame_id),
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=width * channels * pixels.dtype.itemsize,
        data=byte_array(pixels),
    )


def image_from_message(message: Image) -> np.ndarray:
    """Convert to pixels (H, W) or (H, W, C); they are read-only if no copy is needed.

    Raises:
        ConversionError: the encoding is unknown, or the size of the data is wrong.
    """
    kind, channels = _encoding(message.encoding)
    dtype = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    used = message.width * channels * dtype.itemsize
    if message.step < used or len(message.data) != message.step * message.height:
        raise ConversionError(
            f"the image has {len(message.data)} bytes, rows of {message.step}; it must have {message.height} rows of at"
            f" least {used}"
        )
    rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
    pixels = np.ascontiguousarray(rows[:, :used]).view(dtype)
    shape = (message.height, message.width) + ((channels,) if channels > 1 else ())
    return pixels.reshape(shape)


def depth_from_message(message: Image) -> np.ndarray:
    """Convert 32FC1 in metres or 16UC1 in millimetres to depth (H, W) in metres, float32, NaN without a measurement.

    Raises:
        ConversionError: the encoding is no depth encoding, or the size of the data is wrong.
    """
    pixels = image_from_message(message)
    if message.encoding in ("16UC1", "mono16"):
        return np.where(pixels == 0, np.float32(np.nan), pixels.astype(np.float32) / np.float32(MILLIMETRES_PER_METRE))
    if message.encoding == "32FC1":
        return pixels
    raise ConversionError(f"the depth image has encoding {message.encoding!r}; it must be 32FC1 or 16UC1")


def _encoding(name: str) -> tuple[str, int]:
    if name not in ENCODINGS:
        raise ConversionError(f"unknown image encoding {name!r}; known: {', '.join(ENCODINGS)}")
    return ENCODINGS[name]
