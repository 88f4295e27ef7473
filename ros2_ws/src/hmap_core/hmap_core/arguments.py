"""Arguments of the Python interface: what a caller gives is checked where it comes in, and named with its value."""

import math
from typing import Any

import numpy as np

from hmap_core.exceptions import Code, InputError

UNIT = 1e-3  # what the norm of a quaternion may be off 1
SHOWN = 100  # characters of a value in an error


def checked_seed(seed: Any) -> int:
    """A seed of random numbers.

    Raises:
        InputError: it is no integer, or negative.
    """
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise InputError(f"seed = {_shown(seed)}: must be an integer, 0 or larger")
    return int(seed)


def checked_time_limit(limit: Any) -> float:
    """A time limit in seconds; infinite: none.

    Raises:
        InputError: it is no number.
    """
    if isinstance(limit, bool) or not isinstance(limit, int | float | np.number) or math.isnan(limit):
        raise InputError(f"time_limit = {_shown(limit)}: must be a number of seconds")
    return float(limit)


def checked_numbers(value: Any, count: int, what: str, needed: str, code: Code = Code.INVALID_INPUT) -> np.ndarray:
    """Finite numbers (count,).

    Args:
        value: what the caller gave.
        count: how many are needed.
        what: what it is, for the error.
        needed: what is needed, for the error.
        code: of the error.

    Raises:
        InputError: they are no numbers, too few or too many, or not finite.
    """
    try:
        found = np.asarray(value, float)
        good = found.shape == (count,) and bool(np.isfinite(found).all())
    except (TypeError, ValueError):
        good = False
    if not good:
        shown = value.tolist() if isinstance(value, np.ndarray) else value
        raise InputError(f"{what} is {_shown(shown)}; needed: {needed}", code)
    return found


def checked_pose(value: Any, what: str, off: float = UNIT) -> np.ndarray:
    """A pose (7,): position and unit quaternion xyzw, whose norm may be off 1 by ``off``.

    Raises:
        InputError: INVALID_POSE; it is none.
    """
    needed = "x, y, z and a unit quaternion xyzw"
    pose = checked_numbers(value, 7, what, needed, Code.INVALID_POSE)
    if abs(float(np.linalg.norm(pose[3:])) - 1.0) > off:
        raise InputError(f"{what} is {pose.tolist()}; needed: {needed}", Code.INVALID_POSE)
    return pose


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= SHOWN else f"{text[:SHOWN]}..."
