"""How long jobs among many parts go on after their time limit: in a process that has done nothing yet, and again."""

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

from hmap_core.benchmark import many_parts

LIMITS = (0.3, 0.5, 1.0, 2.0, 3.0)  # s
JOBS = ("closed window", "carried", "attached")  # an object path, a whole plan, a transit
ALLOWED = 1.1  # of a time limit
RUNS = 2  # in each process


@dataclass(frozen=True)
class Overrun:
    """What one job took with one limit.

    Attributes:
        job: one of JOBS.
        limit: s.
        trials: the first one of a process, and those after it.
    """

    job: str
    limit: float
    trials: tuple[many_parts.Trial, ...]

    @property
    def kept(self) -> bool:
        """Whether no trial went on for longer than is allowed."""
        return all(trial.wall <= ALLOWED * self.limit for trial in self.trials)


def measured(parts: int, obstacle_parts: int, seed: int) -> Iterator[Overrun]:
    """Measures each job with each limit in a process of its own.

    Args:
        parts, obstacle_parts, seed: as of :func:`hmap_core.benchmark.many_parts.carried`.
    """
    for job in JOBS:
        for limit in LIMITS:
            with ProcessPoolExecutor(1, get_context("spawn")) as process:
                trials = process.submit(_trials, job, parts, obstacle_parts, seed, limit).result()
            yield Overrun(job, limit, trials)


def _trials(job: str, parts: int, obstacle_parts: int, seed: int, limit: float) -> tuple[many_parts.Trial, ...]:
    if job == "closed window":
        problem = many_parts.window(parts, obstacle_parts, seed, lid=True)
        return tuple(many_parts.run(problem, limit) for _ in range(RUNS))
    if job == "carried":
        scene = many_parts.carried(parts, obstacle_parts, seed)
        return tuple(many_parts.run_plan(scene, limit) for _ in range(RUNS))
    situation = many_parts.attached(parts, obstacle_parts, seed)
    return tuple(many_parts.run_transit(*situation, limit) for _ in range(RUNS))
