"""Verification of paths between their steps: a spline is executed, which keeps the joint limits and has to be free."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hmap_core.collision.scene_model import CollisionModel, Collisions
from hmap_core.deadline import check_time
from hmap_core.kinematics.chain import Chain
from hmap_core.komo.pair_blocks import PairChecks
from hmap_core.komo.violations import VERIFY_STEP
from hmap_core.planner.segments.violation import Part, Violation
from hmap_core.trajectory.spline import CubicSpline
from hmap_core.trajectory.timing import spline

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


def executed_spline(chain: Chain, path: np.ndarray) -> CubicSpline:
    """The curve along which a path (M, n) of the joints of a chain is executed; it keeps their limits.

    Raises:
        MotionError: a point of the path is beyond the limits.
    """
    return spline(path, np.array([chain.lower, chain.upper]))


def worst_between_steps(
    chain: Chain, cols: Collisions, curve: CubicSpline, masks: Masks, resolution: float = VERIFY_STEP
) -> tuple[float, int]:
    """Worst violation (m) of a minimum distance along the spline of a path, and its pair (-1: none).

    The spline is replaced by chords, from which no point of it is farther than VERIFY_DEVIATION or the resolution.

    Args:
        resolution: m that a pair may come nearer between two looks without being noticed.
    """
    check_time()
    deviation = min(VERIFY_DEVIATION, resolution)
    knots = curve.x
    speed = cols.speed.max(initial=1.0)  # what is attached or carried moves farther than the links
    bend = speed * np.abs(curve(knots, 2)) @ chain.reach  # m, of the squared chord length; linear between knots
    lengths = np.diff(knots)
    counts = np.ceil(lengths * np.sqrt(np.maximum(bend[1:], bend[:-1]) / (8.0 * deviation)))
    first = np.concatenate([[0], np.cumsum(np.maximum(counts, 1.0))])  # number of the chord that begins at each knot
    ends = np.interp(np.arange(first[-1] + 1), first, knots)
    phases = np.where(ends[:-1] < masks.turn, masks.phases, masks.then).astype(np.int64)
    path = np.ascontiguousarray(curve(ends))
    violation, pair, _ = PairChecks(chain, cols).between(path, phases, resolution)
    worst = int(violation.argmax())
    return float(violation[worst]), int(pair[worst])


def is_free(chain: Chain, cols: Collisions, path: np.ndarray, phases: int = 1, resolution: float = VERIFY_STEP) -> bool:
    """Whether the spline of a path (M, n) keeps the minimum distances of the phases of a bit mask.

    Args:
        resolution: as of :func:`worst_between_steps`.

    Raises:
        MotionError: a point of the path is beyond the joint limits.
    """
    return worst_between_steps(chain, cols, executed_spline(chain, path), Masks(phases), resolution)[1] < 0


def find_violations(
    chain: Chain,
    collisions: CollisionModel,
    cols: Collisions,
    parts: Mapping[Part, tuple[CubicSpline, Masks]],
) -> tuple[Violation, ...]:
    """What the splines of the parts of a path violate.

    Args:
        collisions: names the pairs of ``cols``, whose minimum distances count.
        parts: spline and masks of each.

    Returns:
        The worst pair of each part that has one.
    """
    worst = {part: worst_between_steps(chain, cols, curve, masks) for part, (curve, masks) in parts.items()}
    return tuple(
        Violation(part, amount, collisions.pair_name(pair)) for part, (amount, pair) in worst.items() if pair >= 0
    )
