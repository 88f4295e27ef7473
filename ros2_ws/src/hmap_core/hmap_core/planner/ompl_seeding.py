"""OMPL with repeatable random numbers, and its boxes.

OMPL draws its random numbers from generators that are seeded, when they are made, from one global sequence.
``RNG.setSeed`` restarts that sequence (it warns that generators already in use keep their state); since every solve
makes its own space, sampler and planner afterwards, seeding here makes each solve repeatable in any process. A lock
keeps two threads from taking each other's numbers, whatever they solve.
"""

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from ompl import base as ob
from ompl import util as ou

_LOCK = threading.Lock()
_MAX_SEED = 2**31 - 1


@contextmanager
def seeded(rng: np.random.Generator) -> Iterator[None]:
    """OMPL for this thread alone, seeded by one number of ``rng``, and silent."""
    seed = int(rng.integers(1, _MAX_SEED))
    with _LOCK:
        level = ou.getLogLevel()
        ou.setLogLevel(ou.LOG_NONE)
        try:
            ou.RNG.setSeed(seed)
            yield
        finally:
            ou.setLogLevel(level)


def box(lower: np.ndarray, upper: np.ndarray) -> ob.RealVectorBounds:
    """Bounds from ``lower`` to ``upper``, (n,) each."""
    bounds = ob.RealVectorBounds(len(lower))
    for k, (low, high) in enumerate(zip(lower, upper, strict=True)):
        bounds.setLow(k, float(low))
        bounds.setHigh(k, float(high))
    return bounds
