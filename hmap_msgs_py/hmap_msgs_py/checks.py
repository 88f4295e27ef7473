"""Checks of the numbers in messages."""

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence, Sized
from dataclasses import dataclass
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


def sound_pose(values: Sequence[float]) -> bool:
    """Whether seven numbers are a pose; a plan has hundreds of them, and :func:`poses` takes ten times as long."""
    x, y, z, qx, qy, qz, qw = values
    norm = math.sqrt(qx * qx + qy * qy + qz * qz + qw * qw)
    return abs(norm - 1.0) <= UNIT_TOLERANCE and math.isfinite(x) and math.isfinite(y) and math.isfinite(z)


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


@dataclass(frozen=True)
class JointReadings:
    """What a joint state says of the wanted joints.

    Attributes:
        values: joint -> position (rad or m) and velocity (rad/s or m/s; 0 where it is not known).
        refused: why the position of a wanted joint cannot be used.
        ignored: what is wrong with velocities, which are taken to be 0.
    """

    values: dict[str, tuple[float, float]]
    refused: tuple[str, ...] = ()
    ignored: tuple[str, ...] = ()


def joint_readings(
    names: Sequence[str], positions: Sequence[float], velocities: Sequence[float], wanted: Collection[str]
) -> JointReadings:
    """Read a joint state field by field; only what is needed has to be right.

    Joints that are not wanted, such as those of other robots, are ignored, whatever their values.

    Args:
        names: of the joints in the message.
        positions: one for each name.
        velocities: one for each name, or none.
        wanted: names of the joints that are needed.
    """
    count = len(names)
    concerned = [name for name in names if name in wanted]
    if not concerned and (count or not len(positions)):
        return JointReadings({})
    if len(positions) != count:
        text = f"the joint state has {count} names and {len(positions)} positions; every name needs one position"
        return JointReadings({}, (text,))
    refused, ignored = [], []
    if len(velocities) not in (0, count):
        ignored.append(
            f"the joint state has {count} names and {len(velocities)} velocities; one for each name is allowed, or none"
        )
        velocities = ()
    twice = [name for name, times in Counter(concerned).items() if times > 1]
    refused += [f"the joint state has the name {name!r} {concerned.count(name)} times" for name in twice]
    values = {}
    for i, name in enumerate(names):
        if name not in wanted or name in twice:
            continue
        position, velocity = float(positions[i]), float(velocities[i]) if len(velocities) else 0.0
        if not math.isfinite(position):
            refused.append(f"the position of joint {name!r} is {position}; it must be finite")
            continue
        if not math.isfinite(velocity):
            ignored.append(f"the velocity of joint {name!r} is {velocity}; it must be finite")
            velocity = 0.0
        values[name] = position, velocity
    return JointReadings(values, tuple(refused), tuple(ignored))


def frame(name: str, frame_id: str, allowed: Iterable[str]) -> None:
    """Check for an allowed frame. A leading slash, which old drivers write, counts as none.

    Raises:
        ConversionError: another frame is named.
    """
    known = sorted(allowed)
    if frame_id.removeprefix("/") not in known:
        raise ConversionError(f"{name} is in frame {frame_id!r}; allowed: {', '.join(repr(text) for text in known)}")


def field(data: Any, name: str, *default: Any) -> Any:
    """``data[name]`` of a dict, ``data.name`` of any other object."""
    if isinstance(data, Mapping):
        return data.get(name, *default) if default else data[name]
    return getattr(data, name, *default)
