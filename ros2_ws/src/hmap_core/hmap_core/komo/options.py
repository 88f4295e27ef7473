"""Settings of the solver."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hmap_core.komo.arrays import Options


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
        detection_distance: pairs nearer than their minimum distance plus this are looked at together with those that
            are violated, so that
            a step does not run into them, m.
        optimality: a feasible path is improved until no multiplier changes by more than this times the penalty;
            infinite: the first that is feasible and nearly at rest is taken.
        coarse, coarse_detection_distance, coarse_tolerance: a path is solved first with about so many collision
            samples, with
            this detection_distance (m), to this tolerance (m, rad); 0 samples: not.
        refinements: how often samples are added where a solved path comes too near between them.
        deadline: monotonic time (s) after which a solve ends without a feasible path.
    """

    mu: float = 3000.0
    mu_growth: float = 3.0
    mu_max: float = 1e6
    tolerance: float = 1e-4
    outer: int = 20
    inner: int = 10
    iterations: int = 120
    max_step: float = 0.3
    damping: float = 1e-3
    step_tolerance: float = 5e-3
    gain_tolerance: float = 5e-2
    acceleration: float = 1.0
    velocity: float = 0.0
    substeps: int = 2
    detection_distance: float = 0.01
    optimality: float = np.inf
    coarse: int = 20
    coarse_detection_distance: float = 0.08
    coarse_tolerance: float = 2e-3
    refinements: int = 4
    deadline: float = np.inf

    @cached_property
    def packed(self) -> Options:
        """The options as the compiled solver takes them."""
        return Options(*(float(getattr(self, name)) for name in Options._fields))


# One configuration instead of a path: stays near its prefix, converges to the numerical floor.
IK_OPTIONS = SolverOptions(
    mu=10.0, mu_growth=5.0, tolerance=2e-5, outer=12, inner=20, iterations=60, max_step=0.5, damping=1e-4,
    step_tolerance=1e-3, gain_tolerance=1e-3, acceleration=0.02, substeps=1, coarse=0,
)  # fmt: skip
