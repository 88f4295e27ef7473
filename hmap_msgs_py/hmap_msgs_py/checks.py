"""What is checked of every number that enters or leaves a message."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

UNIT_TOLERANCE = 1e-3  # how far the norm of a quaternion or a direction may be from 1: float32 senders stay well below


class ConversionError(ValueError):
    """A value that cannot be converted; the text names it, its value and what is allowed."""


class PoseError(ConversionError):
    """A pose that is none: not finite, or its quaternion not normalised."""


def finite(name: str, values: Any, shape: tuple[int | None, ...] | None = None) -> np.ndarray:
    """``values`` as float64, all finite and, where given, of this shape (None: any length).

    Raises:
        ConversionError: otherwise.
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
    """``values`` as vectors of norm 1 along the last axis; rounding within ``UNIT_TOLERANCE`` is kept as it is.

    Raises:
        ConversionError: where a norm is further from 1.
    """
    array = finite(name, values, shape)
    norms = np.linalg.norm(array, axis=-1)
    if array.size and np.max(np.abs(norms - 1.0)) > UNIT_TOLERANCE:
        worst = float(np.asarray(norms).flat[int(np.argmax(np.abs(norms - 1.0)))])
        raise ConversionError(f"{name} has norm {worst:.6g}; it must be 1 within {UNIT_TOLERANCE:g}")
    return array


def poses(name: str, values: Any, count: int | None = None) -> np.ndarray:
    """``values`` as poses (N, 7): x, y, z in metres and a unit quaternion x, y, z, w.

    Raises:
        PoseError: otherwise.
    """
    try:
        array = finite(name, values, (count, 7))
        unit(f"quaternion of {name}", array[:, 3:], (count, 4))
    except ConversionError as error:
        raise PoseError(str(error)) from None
    return array


def one_of(name: str, value: str, allowed: Sequence[str]) -> str:
    """``value`` as plain text, when it is one of ``allowed``."""
    text = str(value)
    if text not in allowed:
        raise ConversionError(f"{name} is {text!r}; it must be one of {', '.join(allowed)}")
    return text


def same_length(name: str, values: Sequence, expected: int, of: str) -> None:
    """Raises where ``values`` are not ``expected`` many, the number of ``of``."""
    if len(values) != expected:
        raise ConversionError(f"{name} has {len(values)} values for {expected} {of}")


def field(data: Any, name: str, *default: Any) -> Any:
    """``data[name]`` of a dict, ``data.name`` of anything else."""
    if isinstance(data, Mapping):
        return data.get(name, *default) if default else data[name]
    return getattr(data, name, *default)
