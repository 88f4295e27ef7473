"""Values of a plan file, with where they are: every error names the place, the value and what is allowed."""

from collections.abc import Callable
from typing import Any

import numpy as np

from hmap_core.validation import limits
from hmap_core.validation.files import unusable


class Reader:
    """A value of the file together with where it is, for errors that name the place."""

    def __init__(self, value: Any, where: str):
        self.value = value
        self.where = where

    def fail(self, allowed: str) -> None:
        shown = repr(self.value)
        raise unusable(f"{self.where}: {shown[:80]}{'…' if len(shown) > 80 else ''}; {allowed}")

    def get(self, key: str) -> "Reader":
        """The entry of an object, which must be there."""
        if not isinstance(self.value, dict):
            self.fail("an object with keys is needed")
        if key not in self.value:
            raise unusable(f"{self.where}: no key {key!r}; it has {', '.join(map(str, self.value)) or 'none'}")
        return Reader(self.value[key], f"{self.where}.{key}")

    def find(self, key: str) -> "Reader | None":
        """The entry of an object, or None when it is missing or null."""
        if not isinstance(self.value, dict):
            self.fail("an object with keys is needed")
        return None if self.value.get(key) is None else self.get(key)

    def items(self) -> list[tuple[str, "Reader"]]:
        if not isinstance(self.value, dict):
            self.fail("an object with keys is needed")
        return [(str(key), self.get(key)) for key in self.value]

    def elements(self) -> list["Reader"]:
        if not isinstance(self.value, list | tuple):
            self.fail("a list is needed")
        return [Reader(value, f"{self.where}[{i}]") for i, value in enumerate(self.value)]

    def text(self, allowed: tuple[str, ...] | None = None) -> str:
        if not isinstance(self.value, str):
            self.fail("a text is needed")
        if allowed is not None and self.value not in allowed:
            self.fail(f"allowed: {', '.join(allowed) or 'nothing'}")
        return self.value

    def texts(self) -> tuple[str, ...]:
        """A list of texts."""
        return tuple(element.text() for element in self.elements())

    def array(self, shape: tuple[int | None, ...]) -> np.ndarray:
        """Finite numbers of a shape; None in the shape means any length."""
        counts = "x".join("n" if n is None else str(n) for n in shape)
        wanted = f"{counts} numbers are needed" if shape else "a number is needed"
        try:
            array = np.asarray(self.value, float)
        except (TypeError, ValueError, OverflowError):
            self.fail(wanted)
        if array.ndim != len(shape) or any(n not in (None, m) for n, m in zip(shape, array.shape, strict=True)):
            raise unusable(f"{self.where}: shape {array.shape}; {wanted}")
        if not np.all(np.isfinite(array)):
            raise unusable(f"{self.where}: holds NaN or infinity; finite numbers are needed")
        if np.any(np.abs(array) > limits.LARGEST):
            raise unusable(f"{self.where}: holds {np.abs(array).max():g}; numbers up to {limits.LARGEST:g} are allowed")
        return array

    def number(self, allowed: str = "", accept: Callable[[float], bool] = lambda _: True) -> float:
        if isinstance(self.value, bool):
            self.fail("a number is needed")
        value = float(self.array(()))
        if not accept(value):
            self.fail(allowed)
        return value

    def poses(self, shape: tuple[int | None, ...] = ()) -> np.ndarray:
        """Poses (..., 7) with quaternions of norm one, which are then made exact."""
        array = self.array((*shape, 7)).copy()
        norm = np.linalg.norm(array[..., 3:], axis=-1)
        worst = float(norm.flat[np.argmax(np.abs(norm - 1.0))]) if norm.size else 1.0
        if abs(worst - 1.0) > limits.QUATERNION_NORM:
            raise unusable(f"{self.where}: a quaternion of norm {worst:.6g}; 1 within {limits.QUATERNION_NORM:g}")
        array[..., 3:] /= norm[..., None]
        return array
