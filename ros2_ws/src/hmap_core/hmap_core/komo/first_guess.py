"""First guesses of paths: the ends of the phases by inverse kinematics, and ways between them."""

import numpy as np

from hmap_core.collision.scene_model import Collisions
from hmap_core.komo.arrays import Samples, Terms
from hmap_core.komo.ik_kernels import solve_ends
from hmap_core.komo.options import IK_OPTIONS
from hmap_core.komo.path_collisions import penetration
from hmap_core.komo.problem import PathProblem

BUMPS = np.array([0.2, 0.4, 0.8])  # rad: sizes of the random bumps on first guesses
BRIDGES = 8  # of each size that are tried where the straight way is blocked
IK_STARTS = 12  # random configurations from which the IK of a phase's end is tried at most; for two arms fourfold


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
    chain, phases = problem.chain, len(problem.steps_per_phase)
    last = np.array(problem.steps_per_phase, np.int64).cumsum() - 1
    # a start has to be good for every arm at once
    starts = IK_STARTS * np.count_nonzero(chain.parent == 0) ** 2
    random = chain.lower + (chain.upper - chain.lower) * rng.random((phases, starts, len(start)))
    ends, asked = solve_ends(start, last, random, attempt > 0, chain, terms, cols, samples, IK_OPTIONS.packed)
    path = np.empty((problem.steps, len(start)))
    before, done = start, 0
    for phase, step in enumerate(last.tolist()):
        if not asked[phase] and phase + 1 < phases:
            continue  # nothing is asked here: straight on to the next end
        q = ends[phase] if asked[phase] else before
        path[done : step + 1] = _bridge(problem, before, q, range(done, step + 1), cols, rng, attempt)
        before, done = q, step + 1
    return path


def _bridge(
    problem: PathProblem, a: np.ndarray, b: np.ndarray, steps: range, cols: Collisions, rng, attempt: int
) -> np.ndarray:
    """A first way (len(steps), n) from a to b: straight at first, then with the bump that is blocked the least."""
    chain = problem.chain
    line = np.arange(1.0, len(steps) + 1.0)[:, None] / len(steps)
    straight = a + line * (b - a)
    if attempt == 0:
        return straight
    masks = problem.masks()[steps.start : steps.stop]
    bumps = np.tile(BUMPS, BRIDGES)[:, None] * rng.normal(size=(BRIDGES * len(BUMPS), len(a)))
    bent = (np.clip(straight + np.sin(np.pi * line) * bump, chain.lower, chain.upper) for bump in bumps)
    return min((straight, *bent), key=lambda way: penetration(way, masks, chain, cols))
