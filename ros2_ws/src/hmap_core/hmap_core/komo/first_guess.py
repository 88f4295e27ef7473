"""First guesses of paths: the ends of the phases by inverse kinematics, and ways between them."""

import numpy as np

from hmap_core.collision.scene_model import Collisions
from hmap_core.komo.allowances import without_pairs
from hmap_core.komo.arrays import Samples, Terms
from hmap_core.komo.objective import ObjectiveType
from hmap_core.komo.options import IK_OPTIONS
from hmap_core.komo.problem import PathProblem
from hmap_core.komo.solver import penetration, solve_until

BUMPS = np.array([0.2, 0.4, 0.8])  # rad: sizes of the random bumps on first guesses
BRIDGES = 8  # of each size that are tried where the straight way is blocked
IK_STARTS = 12  # random configurations from which the IK of a phase's end is tried at most


def first_guess(
    problem: PathProblem,
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
    path = np.empty((problem.steps, len(start)))
    before, done = start, 0
    for phase in range(len(problem.steps_per_phase)):
        last = problem.last(phase)
        q = _phase_end(problem, phase, before, cols, terms, samples, rng, attempt)
        if q is None:
            if phase + 1 < len(problem.steps_per_phase):
                continue  # nothing is asked here: straight on to the next end
            q = before
        path[done : last + 1] = _bridge(problem, before, q, range(done, last + 1), cols, rng, attempt)
        before, done = q, last + 1
    return path


def _bridge(
    problem: PathProblem, a: np.ndarray, b: np.ndarray, steps: range, cols: Collisions, rng, attempt: int
) -> np.ndarray:
    """A first way (len(steps), n) from a to b: straight at first, then with the bump that is blocked the least."""
    chain = problem.chain
    line = np.linspace(0.0, 1.0, len(steps) + 1)[1:, None]
    straight = a + line * (b - a)
    if attempt == 0:
        return straight
    masks = problem.masks()[steps.start : steps.stop]
    bumps = np.tile(BUMPS, BRIDGES)[:, None] * rng.normal(size=(BRIDGES * len(BUMPS), len(a)))
    bent = (np.clip(straight + np.sin(np.pi * line) * bump, chain.lower, chain.upper) for bump in bumps)
    return min((straight, *bent), key=lambda way: penetration(way, masks, chain, cols))


def _phase_end(
    problem: PathProblem, phase: int, near: np.ndarray, cols: Collisions, terms: Terms, samples: Samples, rng, attempt
) -> np.ndarray | None:
    """A configuration (n,) for the last step of a phase, near another one; None where no equality is asked of it."""
    sample = samples.first[problem.last(phase) + 1] - 1
    rows = slice(terms.by_sample[sample], terms.by_sample[sample + 1])
    asked = (terms.order[rows] == 0) & (terms.type[rows] != ObjectiveType.SOS)
    if not (asked & (terms.type[rows] == ObjectiveType.EQ)).any():
        return None
    own = _one_step(terms, np.flatnonzero(asked) + rows.start)
    samples = Samples(np.array([0, 1]), np.ones(1), samples.mask[sample : sample + 1])
    random = rng.uniform(problem.chain.lower, problem.chain.upper, (IK_STARTS, len(near)))
    # another posture to begin with; what follows stays on its branch of the arm, or carrying could not connect the two
    elsewhere = attempt > 0 and phase == 0
    starts = random if elsewhere else np.concatenate([near[None], random])
    return solve_until(
        starts, starts if elsewhere else np.repeat(near[None], len(starts), axis=0), problem.chain, own, terms.params,
        cols, without_pairs(cols), samples, IK_OPTIONS.packed,
    )[0]  # fmt: skip


def _one_step(terms: Terms, chosen: np.ndarray) -> Terms:
    """Some of the terms, as those of a problem of one step."""
    return Terms(
        *(getattr(terms, name)[chosen] for name in ("kernel", "type")), np.zeros(len(chosen), np.int64),
        *(getattr(terms, name)[chosen] for name in ("dim", "scale", "frames", "offset")), terms.params,
        terms.target[chosen], terms.order[chosen], terms.band[chosen], np.array([0, len(chosen)]), terms.tau,
    )  # fmt: skip
