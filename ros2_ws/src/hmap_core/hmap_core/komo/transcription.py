"""From objectives over phases to the arrays that the compiled solver takes, and back to what it found."""

import time
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from functools import lru_cache
from typing import Self

import numpy as np

from hmap_core.collision.scene_model import PER_PAIR, CollisionModel, Collisions
from hmap_core.deadline import check_time
from hmap_core.deadline import deadline as deadline_of_job
from hmap_core.komo.allowances import relaxed
from hmap_core.komo.arrays import Options, Samples, Terms
from hmap_core.komo.between import BETWEEN_BAND, by_unit, new_place, violated_between
from hmap_core.komo.features.base import MAX_DIM, MAX_FRAMES
from hmap_core.komo.first_guess import first_guess
from hmap_core.komo.linearisation import Linearisation, linearise
from hmap_core.komo.problem import PathProblem, phase_masks
from hmap_core.komo.result import KomoResult, Status
from hmap_core.komo.solver import solve
from hmap_core.komo.unroll import FRAMES, unroll
from hmap_core.komo.violations import worst_violation

MOST = 0.5  # share of the pairs that count in a problem, below which the others are left out of it


class KomoProblem(PathProblem):
    """A path problem that can be solved; see :class:`PathProblem` for what it consists of."""

    _packed: tuple | None = None

    def packed(self) -> tuple[Terms, Samples, Options]:
        """Terms, samples and options as the compiled code takes them; packed once for the objectives so far."""
        if self._packed is None or self._packed[0] != len(self.objectives):
            samples = self.samples()
            self._packed = len(self.objectives), (self.terms(samples), samples, self.options.packed)
        return self._packed[1]

    def among(self, collisions: CollisionModel) -> Self:
        """The same problem with other things that keep apart; it must not get more objectives."""
        other = copy(self)
        other.collisions, other._arrays = collisions, None
        return other

    def keeping(self, cols: Collisions) -> Self:
        """The same problem with other minimum distances of its pairs; it must not get more objectives."""
        other = copy(self)
        other._arrays = cols
        return other

    def coarse_samples(self, full: Samples, stride: int) -> Samples:
        """Pairs are looked at only at every ``stride``-th step of each phase, counted from its end."""
        to_end = np.concatenate([np.arange(steps)[::-1] for steps in self.steps_per_phase])
        step = np.repeat(np.arange(self.steps), np.diff(full.first))
        kept = (full.alpha == 1.0) & (to_end[step] % stride == 0)
        return full._replace(mask=np.where(kept, full.mask, 0))

    def samples(self, extra: Sequence[tuple[int, float]] = ()) -> Samples:
        """Where collisions are looked at: ``substeps`` places per interval, and ``extra`` ones (step, alpha)."""
        return _samples(tuple(self.steps_per_phase), self.options.substeps, tuple(extra))

    def terms(self, samples: Samples | None = None, between: Sequence[tuple[int, int, float]] = ()) -> Terms:
        """Objectives unrolled over their steps, ordered by sample.

        Args:
            samples: what they are attached to; :meth:`samples` when not given.
            between: (objective, step, alpha) that are asked between the steps too, where there is a sample.
        """
        samples = samples or self.samples()
        entries, params, size = [], [], 0
        steps: list[int] = []
        for o in self.objectives:
            feature, numbers, width = o.feature, o.feature.params, 0
            if o.params is not None:
                numbers = np.atleast_2d(np.asarray(o.params, float))
                width = numbers.shape[1]
            frames = (*feature.frames, *[0] * (MAX_FRAMES - len(feature.frames)))
            entries.append((feature.kernel, o.type, feature.dim, o.order, size, width, len(o.steps), *frames))
            params.append(numbers.ravel())
            steps += o.steps
            size += numbers.size
        target, band = np.zeros((2, len(entries), MAX_DIM))
        for k, o in enumerate(self.objectives):
            if o.target is not None:
                target[k, : o.feature.dim] = o.target
        for k in {k for k, _, _ in between}:
            feature = self.objectives[k].feature
            band[k, : feature.dim] = by_unit(self.objectives[k], BETWEEN_BAND)
        places = [(t, _sample_at(samples, t, alpha)) for _, t, alpha in between]
        return unroll(
            np.array(entries, np.int64).reshape(len(entries), FRAMES + MAX_FRAMES), np.array(steps, np.int64),
            np.array([k for k, _, _ in between], np.int64), np.array(places, np.int64).reshape(-1, 2), samples,
            np.array([o.scale for o in self.objectives], float), target, band,
            np.concatenate([*params, np.zeros(1)]), float(self.tau),
        )  # fmt: skip

    def solve(
        self,
        start: np.ndarray,
        initial: np.ndarray | None = None,
        restarts: int = 0,
        rng: np.random.Generator | None = None,
        time_limit: float = np.inf,
    ) -> KomoResult:
        """Solves, verifies between the steps, and looks closer where the path needs it.

        Args:
            start: (n,) configuration before the path, at rest.
            initial: (T, n) first guess, as of an earlier plan; without one the ends of the phases are found by IK.
            restarts: more first guesses, far from the first: other ends, random bumps between them.
            rng: of the restarts and the IK; ``default_rng(0)`` when not given.
            time_limit: s; no further round is begun after it.

        Raises:
            ValueError: ``restarts`` is negative.
        """
        began = time.monotonic()
        rng = rng or np.random.default_rng(0)
        start = np.ascontiguousarray(start, float)
        cols = relaxed(self.chain, self.arrays(), start, 1)
        check_time()
        samples = self.samples()
        terms = self.terms(samples)
        best: KomoResult | None = None
        iterations = attempts = 0
        for attempt in range(1 + restarts):
            if best is not None and time.monotonic() - began > time_limit:
                best = replace(best, status=Status.TIME_LIMIT)
                break
            check_time()
            attempts += 1
            guess = initial if attempt == 0 else None
            if guess is None:
                guess = first_guess(self, start, cols, terms, samples, rng, attempt)
            result = self._try_guess(start, guess, cols, terms, samples, began + time_limit)
            iterations += result.iterations
            if best is None or result.feasible or result.excess < best.excess:
                best = result
            if best.feasible:
                break
        if best is None:
            raise ValueError(f"restarts is {restarts}; it has to be 0 or more")
        duration = time.monotonic() - began
        return replace(best, iterations=iterations, attempts=attempts, duration=duration)

    def _try_guess(
        self, start, initial, cols: Collisions, terms: Terms, samples: Samples, deadline: float
    ) -> KomoResult:
        """One first guess, with more samples where the path fails between them."""
        X = np.ascontiguousarray(initial, float).copy()
        prefix = np.ascontiguousarray([start, start], float)
        options = self.options.packed._replace(deadline=deadline_of_job())
        extra: list[tuple[int, float]] = []
        between: list[tuple[int, int, float]] = []
        counting = _counting(cols, self.masks())
        check_time()
        iterations = self._solve_coarsely(X, prefix, counting, terms, samples)
        check_time()
        for refinement in range(self.options.refinements + 1):
            cost, eq, ineq, steps = solve(X, prefix, self.chain, terms, counting, samples, options)
            iterations += steps
            check_time()
            if not (max(eq, ineq) <= self.options.tolerance and np.isfinite(X).all()):
                worst = self._worst(X, start, cols)
                return KomoResult(X, False, cost, eq, ineq, iterations, worst, Status.INFEASIBLE)
            found = violated_between(self, np.concatenate([start[None], X]), cols, terms)
            if not found:
                return KomoResult(X, True, cost, eq, ineq, iterations)
            late = time.monotonic() > deadline
            if refinement == self.options.refinements or late:
                break
            for violation in found:
                place = new_place(self.options.substeps, extra, violation.step, violation.alpha)
                if place not in extra:
                    extra.append(place)
                if violation.objective is not None:
                    between.append((violation.objective, *place))
            samples = self.samples(extra)
            terms = self.terms(samples, between)
        largest = max(found, key=lambda violation: violation.amount)
        status = Status.TIME_LIMIT if late else Status.BETWEEN_STEPS
        return KomoResult(X, False, cost, eq, largest.amount, iterations, largest.text, status)

    def _solve_coarsely(self, X: np.ndarray, prefix: np.ndarray, cols: Collisions, terms: Terms, samples: Samples):
        """Moves a first guess X (T, n) in place with few collision samples; returns the Newton steps that it took."""
        options = self.options
        stride = self.steps // options.coarse if options.coarse else 1
        if stride <= 1:
            return 0
        first = replace(
            options,
            detection_distance=options.coarse_detection_distance,
            tolerance=options.coarse_tolerance,
            deadline=deadline_of_job(),
        )
        return solve(X, prefix, self.chain, terms, cols, self.coarse_samples(samples, stride), first.packed)[3]

    def linearise(self, path: np.ndarray, start: np.ndarray) -> Linearisation:
        """Values and Jacobian of all objectives at a path (T, n), for tests and for other solvers."""
        samples = self.samples()
        return linearise(self, self.terms(samples), samples, path, start)

    def _worst(self, X: np.ndarray, start: np.ndarray, cols: Collisions) -> str:
        """The constraint that is violated the most at the steps or the samples."""
        if not np.isfinite(X).all():
            return "the path is no number"
        return worst_violation(self, self.linearise(X, start), np.concatenate([start[None], X]), cols)


def _counting(cols: Collisions, masks: np.ndarray) -> Collisions:
    """The pairs that count in a phase of the problem, where most do not; ``masks`` (T,) are those of the steps."""
    counts = cols.phases & np.bitwise_or.reduce(masks) != 0
    if counts.sum() > MOST * len(counts):
        return cols
    return cols._replace(**{name: getattr(cols, name)[counts] for name in PER_PAIR})


@lru_cache(maxsize=256)
def _samples(steps_per_phase: tuple[int, ...], substeps: int, extra: tuple[tuple[int, float], ...]) -> Samples:
    T = sum(steps_per_phase)
    step = np.repeat(np.arange(T), substeps)
    alpha = (np.zeros((T, 1)) + np.arange(1, substeps + 1) / substeps).ravel()
    if extra:
        step = np.concatenate([step, [t for t, _ in extra]]).astype(np.int64)
        alpha = np.concatenate([alpha, [a for _, a in extra]])
        order = np.lexsort((alpha, step))
        step, alpha = step[order], alpha[order]
    masks = phase_masks(steps_per_phase)
    ends = masks.copy()
    ends[:-1] |= masks[1:]  # a step at a mode switch is in both phases
    mask = np.where(alpha == 1.0, ends[step], masks[step])
    return Samples(step.searchsorted(np.arange(T + 1)), alpha, mask)


def _sample_at(samples: Samples, step: int, alpha: float) -> int:
    own = slice(samples.first[step], samples.first[step + 1])
    return own.start + int(np.abs(samples.alpha[own] - alpha).argmin())
