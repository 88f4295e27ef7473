"""Parameters of scene files: numbers that are fixed, computed, or drawn from a distribution.

They are the only means of randomisation. Each parameter has its own random generator, seeded by the seed and the
parameter's name, so a new parameter does not change the values of the others.
"""

import keyword
import math
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from hmap_core.scenes.document import Document, Location
from hmap_core.scenes.expressions import ExpressionError, evaluate, names

DISTRIBUTIONS = "a number, an expression, {uniform: [low, high]} or {choice: [a, b, ...]}"


def draw(document: Document, seed: int, scope: str = "", given: Mapping[str, float] | None = None) -> dict[str, float]:
    """Draws the values of a file's ``parameters``.

    Args:
        document: the file.
        seed: seed of all draws.
        scope: separates the draws of a file that is used several times in a scene (the name of the body it defines).
        given: values that override those of the file.

    Returns:
        Parameter name -> value.

    Raises:
        InputError: INVALID_SCENE; a parameter is invalid, refers to an unknown one, or to itself.
    """
    declared = document.data.get("parameters")
    declared = {} if declared is None else declared
    if not isinstance(declared, dict):
        raise document.error(("parameters",), "must be a mapping of names to values")
    return _Draw(document, declared, seed, scope, given or {}).all()


class _Draw:
    def __init__(self, document: Document, declared: dict, seed: int, scope: str, given: Mapping[str, float]):
        self._document = document
        self._declared = declared
        self._seed = seed
        self._scope = scope
        self._values = dict(given)
        self._pending: list[str] = []

    def all(self) -> dict[str, float]:
        for name in self._declared:
            if not name.isidentifier() or keyword.iskeyword(name):
                raise self._document.error(("parameters", name), "a name is letters, digits and _, not a digit first")
            self._value(name)
        return {name: self._values[name] for name in self._declared}

    def _value(self, name: str) -> float:
        if name not in self._values:
            if name in self._pending:
                cycle = " -> ".join([*self._pending[self._pending.index(name) :], name])
                raise self._document.error(("parameters", name), f"refers to itself: {cycle}")
            self._pending.append(name)
            self._values[name] = self._draw(name, self._declared[name])
            self._pending.pop()
        return self._values[name]

    def _draw(self, name: str, value: Any) -> float:
        here = ("parameters", name)
        if not isinstance(value, dict):
            return self._number(value, here)
        if len(value) != 1 or next(iter(value)) not in ("uniform", "choice"):
            raise self._document.error(here, f"must be {DISTRIBUTIONS}")
        kind, arguments = next(iter(value.items()))
        if not isinstance(arguments, list) or not arguments:
            raise self._document.error((*here, kind), "must be a list of numbers")
        numbers = [self._number(argument, (*here, kind, i)) for i, argument in enumerate(arguments)]
        key = zlib.crc32(f"{self._scope}.{name}".encode())
        generator = np.random.default_rng([self._seed, key])
        if kind == "choice":
            return numbers[generator.integers(len(numbers))]
        if len(numbers) != 2 or numbers[0] > numbers[1]:
            raise self._document.error((*here, kind), "must be [low, high] with low not above high")
        low, high = numbers
        return float(generator.uniform(low, high))

    def _number(self, value: Any, here: Location) -> float:
        if isinstance(value, str):
            return self._expression(value, here)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self._document.error(here, f"must be {DISTRIBUTIONS}")
        return self._finite(value, here)

    def _expression(self, value: str, here: Location) -> float:
        try:
            for name in names(value):
                if name in self._declared:
                    self._value(name)
            known = {name: self._values.get(name, math.nan) for name in self._declared}
            return self._finite(evaluate(value, known), here)
        except ExpressionError as error:
            raise self._document.error(here, str(error)) from error

    def _finite(self, value: float, here: Location) -> float:
        try:
            value = float(value)
        except OverflowError:
            value = math.inf
        if not math.isfinite(value):
            raise self._document.error(here, "must be a finite number")
        return value
