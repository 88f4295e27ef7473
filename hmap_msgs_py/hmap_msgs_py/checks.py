"""Checks of the numbers in messages."""

from collections.abc import Mapping, Sequence, Sized
from typing import Any

import numpy as np

UNIT_TOLERANCE = 1e-3  # deviation of a norm from 1; senders with float32 stay well below


class ConversionError(ValueError):
    """A value that cannot be converted; the text names it, its value and what is allowed."""


class PoseError(ConversionError):
    """A malformed pose: it is not finite, or its quaternion is not normalised."""


def finite(name: str, values: Any, shape: tuple[int | None, ...] | None = None) -> np.ndarray:
    """Check for finite numbers.

    Args:
        name: of the values, for the error.
        values: numbers.
        shape: the expected shape; an entry None allows any length.

    Returns:
        The values as float64.

    Raises:
        ConversionError: the values are no numbers, not finite, or have another shape.
    """
    try:
        array = np.asarray(values, np.float64)
    except (TypeError, ValueError) as error:
        raise ConversionError(f"{name} must hold numbers: {error}") from None
    if shape is not None:
        if array.ndim != len(shape) or any(e not in (None, n) for n, e in zip(array.shape, shape, strict=True)):
            expected = " x ".join("any" if n is None else str(n) for n in shape)
            given = " x ".join(map(str, array.shape)) or "scalar"
            raise ConversionError(f"{name} has size {given}; it must be {expected or 'scalar'}")
    bad = ~np.isfinite(array)
    if bad.any():
        index = tuple(map(int, np.argwhere(bad)[0]))
        raise ConversionError(f"{name} holds {array[index]} at index {index}; it must be finite")
    return array


def unit(name: str, values: Any, shape: tuple[int | None, ...]) -> np.ndarray:
    """Check for vectors of norm 1 along the last axis. Deviations within ``UNIT_TOLERANCE`` are not corrected.

    Raises:
        ConversionError: a norm is not 1, or as :func:`finite`.
    """
    array = finite(name, values, shape)
    norms = np.linalg.norm(array, axis=-1)
    if array.size and np.max(np.abs(norms - 1.0)) > UNIT_TOLERANCE:
        worst = float(np.asarray(norms).flat[int(np.argmax(np.abs(norms - 1.0)))])
        raise ConversionError(f"{name} has norm {worst:.6g}; it must be 1 within {UNIT_TOLERANCE:g}")
    return array


def poses(name: str, values: Any, count: int | None = None) -> np.ndarray:
    """Check for poses (N, 7): x, y, z in metres and a unit quaternion x, y, z, w.

    Raises:
        PoseError: a pose is malformed.
    """
    try:
        array = finite(name, values, (count, 7))
        unit(f"quaternion of {name}", array[:, 3:], (count, 4))
    except ConversionError as error:
        raise PoseError(str(error)) from None
    return array


def one_of(name: str, value: str, allowed: Sequence[str]) -> str:
    """Check for one of the allowed texts; returns it as plain text.

    Raises:
        ConversionError: the value is not allowed.
    """
    text = str(value)
    if text not in allowed:
        raise ConversionError(f"{name} is {text!r}; it must be one of {', '.join(allowed)}")
    return text


def same_length(name: str, values: Sized, expected: int, of: str) -> None:
    """Check for ``expected`` values, the number of ``of``.

    Raises:
        ConversionError: the number differs.
    """
    if len(values) != expected:
        raise ConversionError(f"{name} has {len(values)} values for {expected} {of}")


def field(data: Any, name: str, *default: Any) -> Any:
    """``data[name]`` of a dict, ``data.name`` of any other object."""
    if isinstance(data, Mapping):
        return data.get(name, *default) if default else data[name]
    return getattr(data, name, *default)
