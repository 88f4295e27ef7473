"""From objectives over phases to the arrays that the compiled solver takes."""

from dataclasses import dataclass, field

import numpy as np

from hmap_core.collision.scene_model import CollisionModel, Collisions
from hmap_core.kinematics.chain import Chain
from hmap_core.komo.arrays import Options, Terms
from hmap_core.komo.features.base import MAX_FRAMES
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.solver import follow, path_violations, solve, solve_batch


@dataclass(frozen=True)
class SolverOptions:
    """Settings of the solver. Distances in metres, angles in radians.

    Attributes:
        mu, mu_growth, mu_max: penalty of the augmented Lagrangian: start, factor per outer round, ceiling.
        tolerance: largest violation of any single constraint component that counts as feasible.
        outer, inner, iterations: most multiplier updates, Newton steps between two of them, Newton steps in all.
        max_step: largest change of one joint in one Newton step, rad.
        damping: Levenberg term added to the Hessian's diagonal, at least this much.
        step_tolerance, gain_tolerance: a Newton round ends below this step (rad) or this relative decrease.
        acceleration, velocity: weights of the squared second and first differences of the path.
        substeps: collision samples per interval; 2 looks at the step and half-way to it.
        activity: pairs farther apart than their margin plus this are not looked at exactly, m.
    """

    mu: float = 300.0
    mu_growth: float = 3.0
    mu_max: float = 1e6
    tolerance: float = 1e-4
    outer: int = 20
    inner: int = 10
    iterations: int = 120
    max_step: float = 0.3
    damping: float = 1e-3
    step_tolerance: float = 5e-3
    gain_tolerance: float = 1e-3
    acceleration: float = 1.0
    velocity: float = 0.0
    substeps: int = 2
    activity: float = 0.01

    def pack(self) -> Options:
        """The options as the compiled solver takes them."""
        return Options(*(float(getattr(self, name)) for name in Options._fields))


# m: what a margin is lowered by beyond what the start needs
RELAXATION = 1e-4

# Between the steps a pair may come nearer than its margin by this share of it, and at least by this much, m.
VERIFY_SHARE = 2.0 / 3.0
VERIFY_SLACK = 0.0005

# One configuration instead of a path: stays near its prefix, converges to the numerical floor.
IK_OPTIONS = SolverOptions(
    mu=10.0, mu_growth=5.0, tolerance=2e-5, outer=12, inner=20, iterations=60, max_step=0.5, damping=1e-4,
    step_tolerance=1e-3, acceleration=0.02, substeps=1,
)  # fmt: skip


@dataclass(frozen=True)
class KomoResult:
    """What the solver found.

    Attributes:
        path: (T, n).
        feasible: every component within the tolerance at the steps and the sub-steps.
        worst_equality, worst_inequality: largest violations, m or rad.
        worst: which constraint that is, and at which step.
    """

    path: np.ndarray
    feasible: bool
    cost: float
    worst_equality: float
    worst_inequality: float
    iterations: int
    worst: str = ""


@dataclass
class KomoProblem:
    """A path problem over consecutive phases.

    Attributes:
        chain: joints (the variables).
        steps_per_phase: number of steps of each phase; phase k ends with its last step.
        collisions: the pairs that keep apart, by phase.
    """

    chain: Chain
    steps_per_phase: tuple[int, ...]
    collisions: CollisionModel
    options: SolverOptions = field(default_factory=SolverOptions)
    objectives: list[Objective] = field(default_factory=list)
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

    def add(self, objective: Objective) -> None:
        """One more objective; ``solve`` looks at all that were added."""
        self.objectives.append(objective)

    def arrays(self) -> Collisions:
        """The collision pairs as the compiled code takes them."""
        if self._arrays is None:
            self._arrays = self.collisions.arrays()
        return self._arrays

    def phase_of_step(self) -> np.ndarray:
        """Index of the phase of each step, (T,); a mode switch is the last step of the phase before it."""
        return np.repeat(np.arange(len(self.steps_per_phase)), self.steps_per_phase).astype(np.int64)

    def terms(self) -> Terms:
        """Objectives unrolled over their steps, ordered by step."""
        rows = sorted(
            ((step, index, k) for index, o in enumerate(self.objectives) for k, step in enumerate(o.steps)),
            key=lambda row: row[:2],
        )
        frames = np.zeros((len(rows), MAX_FRAMES), np.int64)
        params, offset, size = [], [], 0
        for r, (_, index, k) in enumerate(rows):
            objective = self.objectives[index]
            frames[r, : len(objective.feature.frames)] = objective.feature.frames
            value = objective.feature.params if objective.params is None else np.asarray(objective.params[k], float)
            params.append(value)
            offset.append(size)
            size += len(value)
        chosen = [self.objectives[index] for _, index, _ in rows]
        step = np.array([row[0] for row in rows], np.int64)
        return Terms(
            np.array([o.feature.kernel for o in chosen], np.int64),
            np.array([o.type for o in chosen], np.int64),
            step,
            np.array([o.feature.dim for o in chosen], np.int64),
            np.array([o.scale for o in chosen], float),
            frames,
            np.array(offset, np.int64),
            np.concatenate([*params, np.zeros(1)]),
            np.searchsorted(step, np.arange(self.steps + 1)).astype(np.int64),
        )

    def solve(self, start: np.ndarray, initial: np.ndarray) -> KomoResult:
        """Solves from an initial path.

        Args:
            start: (n,) configuration before the path, at rest.
            initial: (T, n) first guess.
        """
        X = np.ascontiguousarray(initial, float).copy()
        prefix = np.ascontiguousarray([start, start], float)
        phase = self.phase_of_step()
        cols = relaxed(self.chain, self.arrays(), start, 1)
        cost, eq, ineq, iterations = solve(X, prefix, phase, self.chain, self.terms(), cols, self.options.pack())
        feasible = bool(max(eq, ineq) <= self.options.tolerance and np.isfinite(X).all())
        worst = "" if feasible else self._worst(X, start, phase, cols, eq, ineq)
        return KomoResult(X, feasible, cost, eq, ineq, iterations, worst)

    def _worst(self, X, start, phase, cols: Collisions, eq: float, ineq: float) -> str:
        if eq > ineq:
            names = sorted({o.feature.name for o in self.objectives if o.type == ObjectiveType.EQ})
            return f"equality {', '.join(names)} off by {eq:.2g}"
        found = clearance(self.chain, cols, X, phase)
        pair = int(found[1][found[0].argmax()])
        if pair < 0:
            return f"joint limit or inequality exceeded by {ineq:.2g}"
        a, b = self.collisions.pair_name(pair)
        return f"{a} and {b} closer than allowed by {found[0].max() * 1e3:.2g} mm at step {int(found[0].argmax())}"


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
    return cols._replace(a=none, b=none, margin=np.zeros(0), phases=none)


def relaxed(chain: Chain, cols: Collisions, q: np.ndarray, phases: int) -> Collisions:
    """The same pairs, with margins lowered where the configuration q (n,) is already nearer than they ask.

    A path that starts there can then be feasible; it may leave, and never come nearer than it stands.
    """
    margin = cols.margin.copy()
    cols = cols._replace(margin=margin)
    path, mask = np.ascontiguousarray(q, float)[None], np.array([phases], np.int64)
    for _ in range(len(margin)):
        violation, pair = path_violations(path, mask, chain, cols, 0.0)
        if pair[0] < 0:
            break
        margin[pair[0]] -= violation[0] + RELAXATION
    return cols


def follow_ik(problem: KomoProblem, params: np.ndarray, start: np.ndarray, max_jump: float) -> np.ndarray:
    """Solves one-step problems one after the other, each from the last; returns the solutions (m, n) before the first
    that fails or that needs a joint to jump by more than ``max_jump``."""
    padded = np.ascontiguousarray(np.concatenate([params, np.zeros((len(params), 1))], axis=1))
    Q, count = follow(
        np.ascontiguousarray(start, float), problem.phase_of_step(), problem.chain, problem.terms(), padded,
        problem.arrays(), problem.options.pack(), max_jump,
    )  # fmt: skip
    return Q[:count]


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
    padded = np.ascontiguousarray(np.concatenate([params, np.zeros((len(params), 1))], axis=1))
    cols = problem.arrays()
    violation = solve_batch(
        X, prefix, problem.phase_of_step(), problem.chain, problem.terms(), padded, cols, without_pairs(cols),
        problem.options.pack(),
    )  # fmt: skip
    feasible = (violation.max(1) <= problem.options.tolerance) & np.isfinite(X).all((1, 2))
    return X[:, 0], feasible
