"""Verification of paths between their steps: a spline is executed, which has to be free and within limits."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hmap_core.collision.scene_model import CollisionModel, Collisions
from hmap_core.kinematics.chain import Chain
from hmap_core.komo.sweep import between_violations
from hmap_core.komo.violations import VERIFY_STEP
from hmap_core.planner.segments.violation import Part, Violation
from hmap_core.trajectory.spline import CubicSpline
from hmap_core.trajectory.timing import spline

LIMIT_SAMPLES = 10  # per step of a path, at which the joint limits are verified
VERIFY_DEVIATION = 0.0001  # m of a path from the chords that are verified in its place


@dataclass(frozen=True)
class Masks:
    """Bit masks of the phases that count along a part of a path.

    Attributes:
        phases: from its beginning.
        then: after the chord length ``turn``, which is at a step of the path.
    """

    phases: int
    turn: float = np.inf
    then: int = 0


def worst_between_steps(chain: Chain, cols: Collisions, curve: CubicSpline, masks: Masks) -> tuple[float, int]:
    """Worst violation (m) of a minimum distance along the spline of a path, and its pair (-1: none).

    The spline is replaced by chords, from which no point of it is farther than VERIFY_DEVIATION.
    """
    knots = curve.x
    speed = cols.speed.max(initial=1.0)  # what is attached or carried moves farther than the links
    bend = speed * np.abs(curve(knots, 2)) @ chain.reach  # m, of the squared chord length; linear between knots
    lengths = np.diff(knots)
    counts = np.ceil(lengths * np.sqrt(np.maximum(bend[1:], bend[:-1]) / (8.0 * VERIFY_DEVIATION)))
    first = np.concatenate([[0], np.cumsum(np.maximum(counts, 1.0))])  # number of the chord that begins at each knot
    ends = np.interp(np.arange(first[-1] + 1), first, knots)
    phases = np.where(ends[:-1] < masks.turn, masks.phases, masks.then).astype(np.int64)
    path = np.ascontiguousarray(curve(ends))
    violation, pair, _ = between_violations(path, phases, chain, cols, VERIFY_STEP)
    worst = int(violation.argmax())
    return float(violation[worst]), int(pair[worst])


def is_free(chain: Chain, cols: Collisions, path: np.ndarray, phases: int = 1) -> bool:
    """Whether the spline of a path (M, n) keeps the minimum distances of the phases of a bit mask."""
    return worst_between_steps(chain, cols, spline(path), Masks(phases))[1] < 0


def limit_violation(part: Part, curve: CubicSpline, limits: np.ndarray) -> Violation | None:
    """The joint limit (2, n) that the spline of a path exceeds the most."""
    samples = curve(np.linspace(0.0, curve.x[-1], LIMIT_SAMPLES * len(curve.x)))
    excess = np.maximum(limits[0] - samples, samples - limits[1]).max(axis=0)
    return Violation(part, float(excess.max()), joint=int(excess.argmax())) if excess.max() > 0.0 else None


def find_violations(
    chain: Chain,
    collisions: CollisionModel,
    cols: Collisions,
    limits: np.ndarray,
    parts: Mapping[Part, tuple[CubicSpline, Masks]],
) -> tuple[Violation, ...]:
    """What the splines of the parts of a path violate.

    Args:
        collisions: names the pairs of ``cols``, whose minimum distances count.
        limits: (2, n) of the joints.
        parts: spline and masks of each.

    Returns:
        A joint limit alone, where one is exceeded; else the worst pair of each part that has one.
    """
    for part, (curve, _) in parts.items():
        exceeded = limit_violation(part, curve, limits)
        if exceeded is not None:
            return (exceeded,)
    worst = {part: worst_between_steps(chain, cols, curve, masks) for part, (curve, masks) in parts.items()}
    return tuple(
        Violation(part, amount, collisions.pair_name(pair)) for part, (amount, pair) in worst.items() if pair >= 0
    )
