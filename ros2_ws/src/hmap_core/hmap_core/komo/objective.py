"""Objectives: a feature, what is asked of it, and when."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from hmap_core.komo.features.base import Feature


class ObjectiveType(IntEnum):
    """As in RAI: sum of squares, equality (h = 0), inequality (g <= 0)."""

    SOS = 0
    EQ = 1
    INEQ = 2


@dataclass(frozen=True)
class Objective:
    """A feature at some steps.

    Attributes:
        feature: the map.
        type: sum of squares, equality or inequality.
        steps: the steps (0 .. T - 1) at which it holds.
        scale: weight; a sum of squares adds scale / 2 * |feature - target|^2 at each step.
        params: one row of feature parameters per step where they differ by step, else the feature's own.
        target: (dim,) what is subtracted from the feature, or from its difference; zero when not given.
        order: 0 for the feature itself, 1 for its velocity, 2 for its acceleration: differences over the last steps,
            divided by the time of a step to that power.
    """

    feature: Feature
    type: ObjectiveType
    steps: Sequence[int]
    scale: float = 1.0
    params: Sequence[np.ndarray] | np.ndarray | None = None
    target: Sequence[float] | np.ndarray | None = None
    order: int = 0
