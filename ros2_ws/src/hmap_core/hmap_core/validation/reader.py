"""Access to the values of a plan file; every error names the key, the value and what is allowed."""

from collections.abc import Callable
from typing import Any, NoReturn

import numpy as np

from hmap_core.validation import limits
from hmap_core.validation.files import invalid_plan


class Reader:
    """A value of the file with its location.

    Args:
        value: the value.
        where: its location in the file, such as ``plan.robots.arm``.
    """

    def __init__(self, value: Any, where: str):
        self.value = value
        self.where = where

    def fail(self, allowed: str) -> NoReturn:
        """Rejects the value.

        Args:
            allowed: description of valid values.

        Raises:
            InputError: INVALID_PLAN_FILE; always.
        """
        shown = repr(self.value)
        raise invalid_plan(f"{self.where}: {shown[:80]}{'…' if len(shown) > 80 else ''}; {allowed}")

    def get(self, key: str) -> "Reader":
        """The entry ``key`` of an object.

        Raises:
            InputError: INVALID_PLAN_FILE; the value is no object or lacks the key.
        """
        if not isinstance(self.value, dict):
            self.fail("an object with keys is needed")
        if key not in self.value:
            raise invalid_plan(f"{self.where}: no key {key!r}; it has {', '.join(map(str, self.value)) or 'none'}")
        return Reader(self.value[key], f"{self.where}.{key}")

    def find(self, key: str) -> "Reader | None":
        """The entry ``key`` of an object; None if it is missing or null.

        Raises:
            InputError: INVALID_PLAN_FILE; the value is no object.
        """
        if not isinstance(self.value, dict):
            self.fail("an object with keys is needed")
        return None if self.value.get(key) is None else self.get(key)

    def items(self) -> list[tuple[str, "Reader"]]:
        """The entries of an object with their keys.

        Raises:
            InputError: INVALID_PLAN_FILE; the value is no object.
        """
        if not isinstance(self.value, dict):
            self.fail("an object with keys is needed")
        return [(str(key), self.get(key)) for key in self.value]

    def elements(self) -> list["Reader"]:
        """The elements of a list.

        Raises:
            InputError: INVALID_PLAN_FILE; the value is no list.
        """
        if not isinstance(self.value, list | tuple):
            self.fail("a list is needed")
        return [Reader(value, f"{self.where}[{i}]") for i, value in enumerate(self.value)]

    def text(self, allowed: tuple[str, ...] | None = None) -> str:
        """The value as a string.

        Args:
            allowed: the valid strings; None: any.

        Raises:
            InputError: INVALID_PLAN_FILE; the value is no string, or not an allowed one.
        """
        if not isinstance(self.value, str):
            self.fail("a text is needed")
        if allowed is not None and self.value not in allowed:
            self.fail(f"allowed: {', '.join(allowed) or 'nothing'}")
        return self.value

    def texts(self) -> tuple[str, ...]:
        """The value as a list of strings.

        Raises:
            InputError: INVALID_PLAN_FILE; the value is no such list.
        """
        return tuple(element.text() for element in self.elements())

    def array(self, shape: tuple[int | None, ...]) -> np.ndarray:
        """The value as an array of finite numbers.

        Args:
            shape: the required shape; None stands for any length.

        Returns:
            The array, float.

        Raises:
            InputError: INVALID_PLAN_FILE; the value has another shape, or a number is not finite or too large.
        """
        counts = "x".join("n" if n is None else str(n) for n in shape)
        wanted = f"{counts} numbers are needed" if shape else "a number is needed"
        try:
            array = np.asarray(self.value, float)
        except (TypeError, ValueError, OverflowError):
            self.fail(wanted)
        if array.ndim != len(shape) or any(n not in (None, m) for n, m in zip(shape, array.shape, strict=True)):
            raise invalid_plan(f"{self.where}: shape {array.shape}; {wanted}")
        if not np.all(np.isfinite(array)):
            raise invalid_plan(f"{self.where}: holds NaN or infinity; finite numbers are needed")
        if np.any(np.abs(array) > limits.MAX_NUMBER):
            raise invalid_plan(
                f"{self.where}: holds {np.abs(array).max():g}; numbers up to {limits.MAX_NUMBER:g} are allowed"
            )
        return array

    def number(self, allowed: str = "", accept: Callable[[float], bool] = lambda _: True) -> float:
        """The value as a finite number.

        Args:
            allowed: description of valid numbers.
            accept: whether a number is valid.

        Raises:
            InputError: INVALID_PLAN_FILE; the value is no number, or not a valid one.
        """
        if isinstance(self.value, bool):
            self.fail("a number is needed")
        value = float(self.array(()))
        if not accept(value):
            self.fail(allowed)
        return value

    def poses(self, shape: tuple[int | None, ...] = ()) -> np.ndarray:
        """The value as poses with unit quaternions, which are normalised.

        Args:
            shape: shape of the array of poses; None stands for any length.

        Returns:
            (..., 7).

        Raises:
            InputError: INVALID_PLAN_FILE; wrong shape, a number that is not finite, or a quaternion whose norm is not
                1.
        """
        array = self.array((*shape, 7)).copy()
        norm = np.linalg.norm(array[..., 3:], axis=-1)
        worst = float(norm.flat[np.argmax(np.abs(norm - 1.0))]) if norm.size else 1.0
        if abs(worst - 1.0) > limits.QUATERNION_NORM:
            raise invalid_plan(f"{self.where}: a quaternion of norm {worst:.6g}; 1 within {limits.QUATERNION_NORM:g}")
        array[..., 3:] /= norm[..., None]
        return array
