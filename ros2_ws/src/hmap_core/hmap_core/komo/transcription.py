"""From objectives over phases to the arrays that the compiled solver takes, and back to what it found."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from hmap_core.collision.scene_model import CollisionModel, Collisions
from hmap_core.exceptions import InputError
from hmap_core.kinematics.chain import Chain
from hmap_core.komo.arrays import Samples, Terms
from hmap_core.komo.features.base import MAX_DIM, MAX_FRAMES, Feature
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.options import IK_OPTIONS, SolverOptions
from hmap_core.komo.solver import (
    BAND,
    MAX_ORDER,
    between_violations,
    feature_values,
    follow,
    linearise,
    path_violations,
    penetration,
    solve,
    solve_batch,
    solve_until,
    standing_margins,
)

__all__ = [
    "IK_OPTIONS", "KomoProblem", "KomoResult", "Linearisation", "SolverOptions", "Status", "clearance", "follow_ik",
    "relaxed", "solve_ik", "solve_ik_batch", "verification", "without_pairs",
]  # fmt: skip

RELAXATION = 1e-4  # m: what a margin is lowered by beyond what the start needs
# Between the steps a pair may come nearer than its margin by this share of it, and at least by this much, m.
VERIFY_SHARE = 2.0 / 3.0
VERIFY_SLACK = 0.0005
VERIFY_STEP = 0.0005  # m of motion after which the verification looks again at the latest
SAMPLE_GAP = 0.02  # share of an interval within which two collision samples count as one
BETWEEN = np.array([0.0, 0.25, 0.5, 0.75])  # shares of an interval at which constraints of both its ends are verified
# Between its steps a constraint of both ends of an interval may be left by this: m, and rad or share of a unit vector.
# Where it is left by more it is asked there too, to within the band.
BETWEEN_TOLERANCE = (5e-4, 4e-3)
BETWEEN_BAND = (3e-4, 2e-3)
BUMPS = np.array([0.2, 0.4, 0.8])  # rad: sizes of the random bumps on first guesses
BRIDGES = 8  # of each size that are tried where the straight way is blocked
IK_STARTS = 12  # random configurations from which the IK of a phase's end is tried at most


class Status(StrEnum):
    """How a solve ended."""

    FEASIBLE = "feasible"
    INFEASIBLE = "infeasible"  # some constraint stays violated at the steps or the samples
    BETWEEN_STEPS = "between steps"  # feasible there, but not between them
    NO_END = "no end"  # the end of some phase has no configuration
    TIME_LIMIT = "time limit"


@dataclass(frozen=True)
class KomoResult:
    """What the solver found.

    Attributes:
        path: (T, n).
        feasible: every component within the tolerance at the steps and the samples, and verified between them.
        cost: of the sos objectives and the smoothness.
        worst_equality, worst_inequality: largest violations, m or rad.
        iterations: Newton steps, over all attempts.
        worst: the constraint that is violated the most, with its frames and its time in phases; empty if feasible.
        status: how it ended.
        attempts: first guesses tried.
        duration: s.
    """

    path: np.ndarray
    feasible: bool
    cost: float
    worst_equality: float
    worst_inequality: float
    iterations: int
    worst: str = ""
    status: Status = Status.FEASIBLE
    attempts: int = 1
    duration: float = 0.0


@dataclass(frozen=True)
class Linearisation:
    """Objectives at a path: values (M,) less targets, unscaled; jacobian (M, T n); rows: objective, step, component."""

    values: np.ndarray
    jacobian: np.ndarray
    rows: list[tuple[int, int, int]]


@dataclass
class KomoProblem:
    """A path problem over consecutive phases.

    Attributes:
        chain: joints (the variables).
        steps_per_phase: number of steps of each phase; phase k ends with its last step.
        collisions: the pairs that keep apart, by phase.
        tau: seconds per step, the unit of time of velocities and accelerations.
    """

    chain: Chain
    steps_per_phase: tuple[int, ...]
    collisions: CollisionModel
    options: SolverOptions = field(default_factory=SolverOptions)
    objectives: list[Objective] = field(default_factory=list)
    tau: float = 1.0
    _arrays: Collisions | None = field(default=None, repr=False)

    @property
    def steps(self) -> int:
        """T, over all phases."""
        return sum(self.steps_per_phase)

    def last(self, phase: int) -> int:
        """Last step of a phase."""
        return sum(self.steps_per_phase[: phase + 1]) - 1

    def span(self, phase: int) -> range:
        """Steps of a phase."""
        end = self.last(phase) + 1
        return range(end - self.steps_per_phase[phase], end)

    def steps_at(self, times: Sequence[float]) -> range:
        """Steps of ``times`` in phases, as in KOMO: (t,) is one step, (t0, t1) all after t0 up to t1, () all.

        Raises:
            InputError: a time outside of the phases.
        """
        phases = len(self.steps_per_phase)
        if len(times) > 2 or any(not 0.0 <= t <= phases for t in times) or list(times) != sorted(times):
            raise InputError(f"times {tuple(times)}: allowed are up to two ascending times from 0 to {phases} (phases)")
        ends = np.concatenate([[0], np.cumsum(self.steps_per_phase)])
        at = [int(round(np.interp(t, np.arange(phases + 1), ends))) for t in times]
        if not at:
            return range(self.steps)
        if len(at) == 1:
            return range(max(at[0] - 1, 0), max(at[0], 1))
        return range(max(at[0] - 1, 0), at[1]) if at[0] == at[1] else range(at[0], at[1])

    def add(self, objective: Objective) -> None:
        """One more objective; ``solve`` looks at all that were added.

        Raises:
            InputError: an order, target, scale or step that does not fit.
        """
        name, dim = objective.feature.name, objective.feature.dim
        if not 0 <= objective.order <= MAX_ORDER:
            raise InputError(f"objective '{name}': order {objective.order}; allowed: 0 to {MAX_ORDER}")
        if objective.target is not None and np.shape(objective.target) != (dim,):
            raise InputError(
                f"objective '{name}': target has shape {np.shape(objective.target)}; it has to be ({dim},)"
            )
        if not objective.scale > 0.0:
            raise InputError(f"objective '{name}': scale {objective.scale}; it has to be positive")
        steps = np.asarray(objective.steps)
        if steps.size and not (0 <= steps.min() and steps.max() < self.steps):
            raise InputError(
                f"objective '{name}': steps {steps.min()} to {steps.max()}; allowed: 0 to {self.steps - 1}"
            )
        self.objectives.append(objective)

    def add_objective(
        self,
        feature: Feature,
        type: ObjectiveType,
        times: Sequence[float] = (),
        scale: float = 1.0,
        target: Sequence[float] | np.ndarray | None = None,
        order: int = 0,
    ) -> None:
        """:meth:`add` with ``times`` in phases, as in KOMO; see :meth:`steps_at`."""
        self.add(Objective(feature, type, self.steps_at(times), scale, None, target, order))

    def arrays(self) -> Collisions:
        """The collision pairs as the compiled code takes them."""
        if self._arrays is None:
            self._arrays = self.collisions.arrays()
        return self._arrays

    def phase_of_step(self) -> np.ndarray:
        """Index of the phase of each step, (T,); a mode switch is the last step of the phase before it."""
        return np.repeat(np.arange(len(self.steps_per_phase)), self.steps_per_phase).astype(np.int64)

    def masks(self) -> np.ndarray:
        """Bit mask (T,) of the phases of each interval."""
        return np.int64(1) << self.phase_of_step()

    def coarse_samples(self, full: Samples, stride: int) -> Samples:
        """Pairs are looked at only at every ``stride``-th step of each phase, counted from its end."""
        to_end = np.concatenate([np.arange(steps)[::-1] for steps in self.steps_per_phase])
        step = np.repeat(np.arange(self.steps), np.diff(full.first))
        kept = (full.alpha == 1.0) & (to_end[step] % stride == 0)
        return full._replace(mask=np.where(kept, full.mask, 0))

    def samples(self, extra: Sequence[tuple[int, float]] = ()) -> Samples:
        """Where collisions are looked at: ``substeps`` places per interval, and ``extra`` ones (step, alpha)."""
        S, T = self.options.substeps, self.steps
        step = np.repeat(np.arange(T), S)
        alpha = (np.zeros((T, 1)) + np.arange(1, S + 1) / S).ravel()
        if extra:
            step = np.concatenate([step, [t for t, _ in extra]]).astype(np.int64)
            alpha = np.concatenate([alpha, [a for _, a in extra]])
            order = np.lexsort((alpha, step))
            step, alpha = step[order], alpha[order]
        masks = self.masks()
        ends = masks.copy()
        ends[:-1] |= masks[1:]  # a step at a mode switch is in both phases
        mask = np.where(alpha == 1.0, ends[step], masks[step])
        return Samples(step.searchsorted(np.arange(T + 1)), alpha, mask)

    def terms(self, samples: Samples | None = None, between: Sequence[tuple[int, int, float]] = ()) -> Terms:
        """Objectives unrolled over their steps, ordered by sample.

        Args:
            samples: what they are attached to; :meth:`samples` when not given.
            between: (objective, step, alpha) that are asked between the steps too, where there is a sample.
        """
        samples = samples or self.samples()
        counts = [len(o.steps) for o in self.objectives]
        step = np.fromiter((t for o in self.objectives for t in o.steps), np.int64, sum(counts))
        params, entries, size, rows = [], [], 0, 0
        for o, count in zip(self.objectives, counts, strict=True):
            feature, numbers, width = o.feature, o.feature.params, 0
            if o.params is not None:
                numbers = np.atleast_2d(np.asarray(o.params, float))
                width = numbers.shape[1]
            frames = (*feature.frames, *[0] * (MAX_FRAMES - len(feature.frames)))
            entries.append((feature.kernel, int(o.type), feature.dim, o.order, *frames, size, width, rows))
            params.append(numbers.ravel())
            size, rows = size + numbers.size, rows + count
        table = np.array(entries, np.int64).reshape(len(entries), 7 + MAX_FRAMES)
        index = np.repeat(np.arange(len(entries)), counts)
        begin, width, first = table[:, -3:].T.take(index, axis=1)
        offset = begin + width * (np.arange(len(index)) - first)
        at = samples.first[step + 1] - 1
        if between:
            own, steps, alphas = (np.array(column) for column in zip(*between, strict=True))
            places = [_sample_at(samples, t, a) for t, a in zip(steps, alphas, strict=True)]
            index, step = np.concatenate([index, own]), np.concatenate([step, steps])
            at = np.concatenate([at, places])
            offset = np.concatenate([offset, table[own, -3]])
        order = at.argsort(kind="stable")
        index, at = index[order], at[order]
        kernel, kind, dim, difference = table[:, :4].T.take(index, axis=1)
        band = np.zeros((len(index), MAX_DIM))
        for m in np.flatnonzero((order >= len(index) - len(between)) & (kind == ObjectiveType.EQ)) if between else ():
            kind[m], band[m, : dim[m]] = BAND, _by_unit(self.objectives[index[m]], BETWEEN_BAND)
        target = np.zeros((len(entries), MAX_DIM))
        for k, o in enumerate(self.objectives):
            if o.target is not None:
                target[k, : o.feature.dim] = o.target
        scale = np.array([o.scale for o in self.objectives], float)[index]
        by_sample = at.searchsorted(np.arange(len(samples.alpha) + 1))
        return Terms(
            kernel, kind, step[order], dim, scale, table[:, 4:-3].take(index, axis=0), offset[order],
            np.concatenate([*params, np.zeros(1)]), target[index], difference, band, by_sample, float(self.tau),
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
        """
        began = time.monotonic()
        rng = rng or np.random.default_rng(0)
        start = np.ascontiguousarray(start, float)
        cols = relaxed(self.chain, self.arrays(), start, 1)
        samples = self.samples()
        terms = self.terms(samples)
        best: KomoResult | None = None
        iterations = attempts = 0
        for attempt in range(1 + restarts):
            if best is not None and time.monotonic() - began > time_limit:
                best = replace(best, status=Status.TIME_LIMIT)
                break
            attempts += 1
            guess = initial if attempt == 0 else None
            if guess is None:
                guess = self.first_guess(start, cols, terms, samples, rng, attempt)
            result = self._attempt(start, guess, cols, terms, samples, began + time_limit)
            iterations += result.iterations
            if best is None or result.feasible or _excess(result) < _excess(best):
                best = result
            if best.feasible:
                break
        duration = time.monotonic() - began
        return replace(best, iterations=iterations, attempts=attempts, duration=duration)

    def _attempt(self, start, initial, cols: Collisions, terms: Terms, samples: Samples, deadline: float) -> KomoResult:
        """One first guess, with more samples where the path fails between them."""
        X = np.ascontiguousarray(initial, float).copy()
        prefix = np.ascontiguousarray([start, start], float)
        options = self.options.pack()
        extra: list[tuple[int, float]] = []
        between: list[tuple[int, int, float]] = []
        iterations = 0
        stride = self.steps // self.options.coarse if self.options.coarse else 1
        if stride > 1:
            first = replace(
                self.options, activity=self.options.coarse_activity, tolerance=self.options.coarse_tolerance
            )
            coarse = self.coarse_samples(samples, stride)
            iterations = solve(X, prefix, self.chain, terms, cols, coarse, first.pack())[3]
        for refinement in range(self.options.refinements + 1):
            cost, eq, ineq, steps = solve(X, prefix, self.chain, terms, cols, samples, options)
            iterations += steps
            if not (max(eq, ineq) <= self.options.tolerance and np.isfinite(X).all()):
                worst = self._worst(X, start, cols)
                return KomoResult(X, False, cost, eq, ineq, iterations, worst, Status.INFEASIBLE)
            found = self._between(np.concatenate([start[None], X]), cols)
            if not found:
                return KomoResult(X, True, cost, eq, ineq, iterations)
            if refinement == self.options.refinements or time.monotonic() > deadline:
                break
            for failure in found:
                place = self._new_place(extra, failure.step, failure.alpha)
                if place not in extra:
                    extra.append(place)
                if failure.objective is not None:
                    between.append((failure.objective, *place))
            samples = self.samples(extra)
            terms = self.terms(samples, between)
        worst = max(found, key=lambda failure: failure.amount)
        return KomoResult(X, False, cost, eq, worst.amount, iterations, worst.text, Status.BETWEEN_STEPS)

    def _between(self, path: np.ndarray, cols: Collisions) -> list["_Failure"]:
        """What a path (T + 1, n) with its start violates between its steps; the worst of each interval."""
        violation, pair, alpha = between_violations(path, self.masks(), self.chain, verification(cols), VERIFY_STEP)
        found = [
            _Failure(
                int(t), float(alpha[t]), float(violation[t]), None, self._too_near(pair[t], violation[t], t + alpha[t])
            )
            for t in np.flatnonzero(pair >= 0)
        ]
        for index, objective in enumerate(self.objectives):
            found += self._left_between(index, objective, path)
        return found

    def _left_between(self, index: int, objective: Objective, path: np.ndarray) -> list["_Failure"]:
        """Where a constraint that holds at both ends of an interval is left between them."""
        constant = objective.params is None and objective.order == 0
        if not constant or objective.type == ObjectiveType.SOS or len(objective.steps) < 2:
            return []
        steps = np.asarray(objective.steps)
        before = path[steps][:, None]
        points = before + BETWEEN[:, None] * (path[steps + 1][:, None] - before)
        value = feature_values(
            points.reshape(-1, path.shape[1]), self.chain, objective.feature.kernel, objective.feature.dim,
            _frames(objective), objective.feature.params,
        )  # fmt: skip
        if objective.target is not None:
            value -= objective.target
        value = value.reshape(len(steps), len(BETWEEN), -1)
        off = (np.abs(value) if objective.type == ObjectiveType.EQ else value) / _by_unit(objective, BETWEEN_TOLERANCE)
        found = []
        for k in np.flatnonzero((off[:, 0] <= 1.0).all(1) & (off > 1.0).any((1, 2))):
            place, component = np.unravel_index(int(off[k].argmax()), off[k].shape)
            step, alpha = int(steps[k]), float(BETWEEN[place])
            amount = abs(float(value[k, place, component]))
            found.append(
                _Failure(step, alpha, amount, index, self._named(objective, int(component), amount, step + alpha))
            )
        return found

    def _new_place(self, known, step: int, alpha: float) -> tuple[int, float]:
        """Where a violated interval is to be looked at: at the worst place, or, if that is known, beside it."""
        regular = np.arange(self.options.substeps + 1) / self.options.substeps
        places = np.sort(np.concatenate([regular, [a for t, a in known if t == step]]))
        if np.abs(places - alpha).min() > SAMPLE_GAP:
            return step, alpha
        gap = int(np.argmax(np.diff(places)))
        return step, float(places[gap : gap + 2].mean())

    def first_guess(
        self,
        start: np.ndarray,
        cols: Collisions,
        terms: Terms,
        samples: Samples,
        rng: np.random.Generator,
        attempt: int = 0,
    ) -> np.ndarray:
        """Straight lines (T, n) between configurations that satisfy the equalities of the ends of the phases.

        From the second attempt on with other configurations where there are, and a random bump on each line.
        """
        T, n = self.steps, len(start)
        path = np.empty((T, n))
        before, done = start, 0
        for phase in range(len(self.steps_per_phase)):
            last = self.last(phase)
            q = self._phase_end(phase, before, cols, terms, samples, rng, attempt)
            if q is None:
                if phase + 1 < len(self.steps_per_phase):
                    continue  # nothing is asked here: straight on to the next end
                q = before
            path[done : last + 1] = self._bridge(before, q, range(done, last + 1), cols, rng, attempt)
            before, done = q, last + 1
        return path

    def _bridge(self, a: np.ndarray, b: np.ndarray, steps: range, cols: Collisions, rng, attempt: int) -> np.ndarray:
        """A first way (len(steps), n) from a to b: straight at first, then with the bump that is blocked the least."""
        line = np.linspace(0.0, 1.0, len(steps) + 1)[1:, None]
        straight = a + line * (b - a)
        if attempt == 0:
            return straight
        masks = self.masks()[steps.start : steps.stop]
        bumps = np.tile(BUMPS, BRIDGES)[:, None] * rng.normal(size=(BRIDGES * len(BUMPS), len(a)))
        ways = [
            straight,
            *(np.clip(straight + np.sin(np.pi * line) * bump, self.chain.lower, self.chain.upper) for bump in bumps),
        ]
        return min(ways, key=lambda way: penetration(way, masks, self.chain, cols))

    def _phase_end(
        self, phase: int, near: np.ndarray, cols, terms: Terms, samples: Samples, rng, attempt: int
    ) -> np.ndarray | None:
        """A configuration (n,) for the last step of a phase, near another one; None where nothing is asked of it."""
        sample = samples.first[self.last(phase) + 1] - 1
        rows = slice(terms.by_sample[sample], terms.by_sample[sample + 1])
        asked = (terms.order[rows] == 0) & (terms.type[rows] != ObjectiveType.SOS)
        if not (asked & (terms.type[rows] == ObjectiveType.EQ)).any():
            return None
        chosen = np.flatnonzero(asked) + rows.start
        own = Terms(
            *(getattr(terms, name)[chosen] for name in ("kernel", "type")), np.zeros(len(chosen), np.int64),
            *(getattr(terms, name)[chosen] for name in ("dim", "scale", "frames", "offset")), terms.params,
            terms.target[chosen], terms.order[chosen], terms.band[chosen], np.array([0, len(chosen)]), terms.tau,
        )  # fmt: skip
        samples = Samples(np.array([0, 1]), np.ones(1), samples.mask[sample : sample + 1])
        random = rng.uniform(self.chain.lower, self.chain.upper, (IK_STARTS, len(near)))
        starts = random if attempt else np.concatenate([near[None], random])
        return solve_until(
            starts, near, self.chain, own, terms.params, cols, without_pairs(cols), samples, IK_OPTIONS.pack()
        )[0]

    def linearise(self, path: np.ndarray, start: np.ndarray) -> Linearisation:
        """Values and Jacobian of all objectives at a path (T, n), for tests and for other solvers."""
        samples = self.samples()
        terms, n = self.terms(samples), len(start)
        X = np.ascontiguousarray(path, float)
        prefix = np.ascontiguousarray([start, start], float)
        found, J = linearise(X, prefix, self.chain, terms, without_pairs(self.arrays()), samples)
        index = np.repeat(np.arange(len(self.objectives)), [len(o.steps) for o in self.objectives])
        steps = np.concatenate([np.zeros(0, np.int64), *(np.asarray(o.steps, np.int64) for o in self.objectives)])
        index = index[np.argsort(steps, kind="stable")]
        rows = [(int(index[m]), int(terms.step[m]), d) for m in range(len(index)) for d in range(terms.dim[m])]
        values = np.array([found[m, d] for m in range(len(index)) for d in range(terms.dim[m])])
        jacobian = np.zeros((len(rows), X.size))
        at = 0
        for m in range(len(index)):
            for d in range(terms.dim[m]):
                for k in range(min(terms.order[m], terms.step[m]) + 1):
                    column = n * (terms.step[m] - k)
                    jacobian[at, column : column + n] = J[m, d, n * k : n * (k + 1)]
                at += 1
        return Linearisation(values, jacobian, rows)

    def _worst(self, X: np.ndarray, start: np.ndarray, cols: Collisions) -> str:
        """The constraint that is violated the most at the steps or the samples."""
        if not np.isfinite(X).all():
            return "the path is no number"
        found: list[tuple[float, str]] = []
        linear = self.linearise(X, start)
        for value, (index, step, component) in zip(linear.values, linear.rows, strict=True):
            objective = self.objectives[index]
            if objective.type == ObjectiveType.SOS:
                continue
            off = abs(value) if objective.type == ObjectiveType.EQ else value
            found.append((off, self._named(objective, component, off, step + 1.0)))
        excess = np.maximum(self.chain.lower - X, X - self.chain.upper)
        step, joint = np.unravel_index(int(excess.argmax()), excess.shape)
        found.append((excess[step, joint], f"joint {joint + 1} exceeds its limit by {excess[step, joint]:.2g} at time "
                      f"{self._time(step + 1.0):.2f}"))  # fmt: skip
        path = np.concatenate([start[None], X])
        violation, pair, alpha = between_violations(path, self.masks(), self.chain, cols, VERIFY_STEP)
        step = int(violation.argmax())
        if pair[step] >= 0:
            found.append((violation[step], self._too_near(pair[step], violation[step], step + alpha[step])))
        return max(found, key=lambda entry: entry[0])[1]

    def _named(self, objective: Objective, component: int, off: float, at: float) -> str:
        """``at``: steps since the start."""
        used = [str(f) for f in objective.feature.frames if 0 <= f <= len(self.chain.lower)]
        frames = f" of frames {', '.join(used)}" if used else ""
        kind = objective.type.name.lower()
        return f"{kind} {objective.feature.name}[{component}]{frames} off by {off:.2g} at time {self._time(at):.2f}"

    def _too_near(self, pair: int, violation: float, at: float) -> str:
        a, b = self.collisions.pair_name(int(pair))
        return f"{a} and {b} closer than allowed by {violation * 1e3:.2g} mm at time {self._time(at):.2f}"

    def _time(self, at: float) -> float:
        """Time in phases of a number of steps since the start."""
        ends = np.concatenate([[0], np.cumsum(self.steps_per_phase)])
        phases = [k for k in range(len(ends)) if k == 0 or ends[k] > ends[k - 1]]
        return float(np.interp(at, ends[phases], phases))


@dataclass(frozen=True)
class _Failure:
    """Something violated between two steps: in the interval before ``step``, at ``alpha`` of it."""

    step: int
    alpha: float
    amount: float
    objective: int | None
    text: str


def _by_unit(objective: Objective, values: tuple[float, float]) -> np.ndarray:
    """(dim,) the first value for lengths, the second for angles and directions."""
    return np.where(np.arange(objective.feature.dim) < objective.feature.lengths, *values)


def _frames(objective: Objective) -> np.ndarray:
    frames = np.zeros(MAX_FRAMES, np.int64)
    frames[: len(objective.feature.frames)] = objective.feature.frames
    return frames


def _sample_at(samples: Samples, step: int, alpha: float) -> int:
    own = slice(samples.first[step], samples.first[step + 1])
    return own.start + int(np.abs(samples.alpha[own] - alpha).argmin())


def _excess(result: KomoResult) -> float:
    return max(result.worst_equality, result.worst_inequality)


def clearance(chain: Chain, cols: Collisions, path: np.ndarray, phase: np.ndarray, floor: float = -1e3):
    """Worst margin violation of each configuration of a path (M, n) in its phase (M,).

    Returns:
        (violation (M,), pair (M,)): margin minus distance in metres, positive where too close; pair -1 when nothing
        exceeds ``floor``.
    """
    return path_violations(np.ascontiguousarray(path, float), 1 << np.asarray(phase, np.int64), chain, cols, floor)


def verification(cols: Collisions) -> Collisions:
    """The same pairs with what an executed path may use up of their margins."""
    return cols._replace(margin=cols.margin - np.maximum(VERIFY_SLACK, VERIFY_SHARE * cols.margin))


def without_pairs(cols: Collisions) -> Collisions:
    """The same shapes with no pair to keep apart."""
    none = np.zeros(0, np.int64)
    return cols._replace(a=none, b=none, margin=np.zeros(0), phases=none, closing=np.zeros(0))


def relaxed(chain: Chain, cols: Collisions, q: np.ndarray, phases: int) -> Collisions:
    """The same pairs, with margins lowered where the configuration q (n,) is already nearer than they ask.

    A path that starts there can then be feasible; it may leave, and never come nearer than it stands.
    """
    q = np.ascontiguousarray(q, float)
    return cols._replace(margin=standing_margins(q, np.int64(phases), chain, cols, RELAXATION))


def _one_step(problem: KomoProblem, params: np.ndarray):
    """What the compiled code takes of one-step problems with these parameters (K, N)."""
    padded = np.ascontiguousarray(np.concatenate([params, np.zeros((len(params), 1))], axis=1))
    return problem.terms(), padded, problem.arrays(), problem.samples(), problem.options.pack()


def follow_ik(problem: KomoProblem, params: np.ndarray, start: np.ndarray, max_jump: float) -> np.ndarray:
    """Solves one-step problems one after the other, each from the last; returns the solutions (m, n) before the first
    that fails or that needs a joint to jump by more than ``max_jump``."""
    terms, padded, cols, samples, options = _one_step(problem, params)
    start = np.ascontiguousarray(start, float)
    Q, count = follow(start, problem.chain, terms, padded, cols, samples, options, max_jump)
    return Q[:count]


def solve_ik(problem: KomoProblem, params: np.ndarray, starts: np.ndarray, near: np.ndarray) -> np.ndarray | None:
    """Solves a one-step problem from one start after the other until one is feasible.

    Args:
        problem: a problem of one phase and one step.
        params: (N,) all objective parameters, in order.
        starts: (K, n); near: (n,) the configuration to stay near.

    Returns:
        A configuration (n,), or None.
    """
    terms, padded, cols, samples, options = _one_step(problem, params[None])
    starts, near = np.ascontiguousarray(starts, float), np.ascontiguousarray(near, float)
    q, violation = solve_until(
        starts, near, problem.chain, terms, padded[0], cols, without_pairs(cols), samples, options
    )  # fmt: skip
    return q if violation <= problem.options.tolerance and np.isfinite(q).all() else None


def solve_ik_batch(problem: KomoProblem, params: np.ndarray, initial: np.ndarray, near: np.ndarray):
    """Solves many one-step problems of one structure.

    Args:
        problem: a problem of one phase and one step.
        params: (K, N) all objective parameters of each instance, in order.
        initial, near: (K, n) where each starts, and the configuration it should stay near.

    Returns:
        (q (K, n), feasible (K,)).
    """
    X = np.ascontiguousarray(initial, float)[:, None, :].copy()
    prefix = np.ascontiguousarray(np.repeat(np.asarray(near, float)[:, None, :], 2, axis=1))
    terms, padded, cols, samples, options = _one_step(problem, params)
    violation = solve_batch(
        X, prefix, problem.chain, terms, padded, cols, without_pairs(cols), samples, options
    )  # fmt: skip
    feasible = (violation.max(1) <= problem.options.tolerance) & np.isfinite(X).all((1, 2))
    return X[:, 0], feasible
