"""Arrays in JSON documents: validated when read, rounded when written."""

from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import PlainValidator, WithJsonSchema
from pydantic_core import PydanticCustomError

DECIMALS = 9  # metres, radians and seconds are written to 1e-9, so that differences of 1e-7 survive
QUATERNION_TOLERANCE = 1e-3  # largest deviation of a quaternion's norm from 1
QUATERNION_EXACT = 1e-8  # deviation due to rounding, below which a quaternion is not normalised

# the dimensions of an array; None stands for any length
Dimensions = tuple[int | None, ...]


def to_lists(array: ArrayLike) -> list:
    """Converts an array to nested lists of rounded floats."""
    return np.round(np.asarray(array, float), DECIMALS).tolist()


def _read(value: Any, dimensions: Dimensions) -> np.ndarray:
    expected = " x ".join("n" if n is None else str(n) for n in dimensions)
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError):
        array = None
    if array is not None and array.size == 0 and dimensions[0] is None:
        array = array.reshape([n or 0 for n in dimensions])
    if array is None or array.ndim != len(dimensions):
        raise PydanticCustomError("array", "must be {expected} numbers", {"expected": expected})
    if any(n is not None and n != m for n, m in zip(dimensions, array.shape, strict=True)):
        shape = " x ".join(map(str, array.shape))
        context = {"expected": expected, "shape": shape}
        raise PydanticCustomError("array", "must be {expected} numbers; it is {shape}", context)
    if not np.isfinite(array).all():
        index = [int(i) for i in np.argwhere(~np.isfinite(array))[0]]
        raise PydanticCustomError("not_finite", "must be finite numbers; at {index} it is not", {"index": index})
    return array


def _poses(value: Any, dimensions: Dimensions) -> np.ndarray:
    array = _read(value, dimensions)
    with np.errstate(over="ignore"):  # an infinite norm is rejected below
        norm = np.linalg.norm(array[..., 3:], axis=-1, keepdims=True)
    if array.size and np.abs(norm - 1.0).max() > QUATERNION_TOLERANCE:
        worst = float(norm.flat[np.abs(norm - 1.0).argmax()])
        raise PydanticCustomError(
            "invalid_pose",
            "holds a quaternion of norm {norm}; it must be 1 within {tolerance}",
            {"norm": f"{worst:.6g}", "tolerance": QUATERNION_TOLERANCE},
        )
    array[..., 3:] /= np.where(np.abs(norm - 1.0) > QUATERNION_EXACT, norm, 1.0)
    return array


def _schema(dimensions: Dimensions) -> dict:
    schema: dict = {"type": "number"}
    for n in reversed(dimensions):
        schema = {"type": "array", "items": schema} | ({} if n is None else {"minItems": n, "maxItems": n})
    return schema


def array_of(*dimensions: int | None) -> Any:
    """Type of a pydantic field for an array of finite numbers.

    Args:
        dimensions: the shape; None stands for any length.
    """
    return Annotated[np.ndarray, PlainValidator(lambda v: _read(v, dimensions)), WithJsonSchema(_schema(dimensions))]


def poses_of(*dimensions: int | None) -> Any:
    """Type of a pydantic field for an array of poses: xyz and a unit quaternion xyzw.

    Args:
        dimensions: the shape of the array of poses, without the last dimension 7; None stands for any length.
    """
    full = (*dimensions, 7)
    return Annotated[np.ndarray, PlainValidator(lambda v: _poses(v, full)), WithJsonSchema(_schema(full))]


Vector = array_of(None)
Vector3 = array_of(3)
Vector4 = array_of(4)
Points = array_of(None, 3)
Limits = array_of(2, None)
JointSamples = array_of(None, None)
PoseVector = poses_of()
PoseVectors = poses_of(None)
