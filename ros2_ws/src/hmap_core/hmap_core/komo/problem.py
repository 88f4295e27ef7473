"""What is asked of a path: its phases and steps, objectives, and pairs that keep apart."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from hmap_core.collision.scene_model import CollisionModel, Collisions
from hmap_core.exceptions import InputError
from hmap_core.kinematics.chain import Chain
from hmap_core.komo.features.base import Feature
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.options import SolverOptions
from hmap_core.komo.scratch import MAX_ORDER


@dataclass
class PathProblem:
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
        return phase_masks(tuple(self.steps_per_phase))

    def time_of(self, at: float) -> float:
        """Time in phases of ``at`` steps since the start."""
        ends = np.concatenate([[0], np.cumsum(self.steps_per_phase)])
        phases = [k for k in range(len(ends)) if k == 0 or ends[k] > ends[k - 1]]
        return float(np.interp(at, ends[phases], phases))


@lru_cache(maxsize=256)
def phase_masks(steps_per_phase: tuple[int, ...]) -> np.ndarray:
    """Bit mask (T,) of the phases of each interval."""
    return np.repeat(np.int64(1) << np.arange(len(steps_per_phase)), steps_per_phase)
