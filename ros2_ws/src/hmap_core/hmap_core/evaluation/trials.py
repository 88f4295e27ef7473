"""Many trials at once: in processes of this machine, or on a Dask cluster; by joblib either way."""

import contextlib
from collections.abc import Callable, Iterator, Sequence

from hmap_core.evaluation.isolated import COMMAND, run_isolated
from hmap_core.evaluation.trial import PUBLISHED, Trial, TrialResult, is_file
from hmap_core.exceptions import Code, InputError

EXECUTION_TIME = 900.0  # s for loading, judging and executing, before a trial is taken to hang
CONNECTION_TIME = 20.0  # s for a Dask scheduler to answer

OnResult = Callable[[Trial, TrialResult], None]


def run_trials(
    trials: Sequence[Trial],
    jobs: int = -1,
    dask: str | None = None,
    on_result: OnResult | None = None,
    command: Sequence[str] = COMMAND,
) -> list[TrialResult]:
    """Do all trials; each has a process of its own, one thread, and depends on its seed only.

    Args:
        jobs: how many at once; -1: one on each core. A Dask cluster decides by itself.
        dask: address of a Dask scheduler whose workers do them; None: this machine.
        on_result: called after each, in the order in which they end.
        command: the worker process; see :class:`hmap_core.evaluation.isolated.Worker`.

    Returns:
        the results, in the order of the trials.

    Raises:
        InputError: Dask is not installed, or does not answer.
    """
    from joblib import Parallel, delayed  # takes a moment, and only benchmarks need it

    results: list[TrialResult | None] = [None] * len(trials)
    with _backend(dask):
        parallel = Parallel(n_jobs=jobs, batch_size=1, return_as="generator_unordered")
        for k, result in parallel(delayed(_numbered)(k, trial, command) for k, trial in enumerate(trials)):
            results[k] = result
            if on_result:
                on_result(trials[k], result)
    return results


def task_names(tasks: Sequence[str] = (), published: bool = False) -> list[str]:
    """The tasks to try, as :func:`hmap_core.scenes.load_scene` takes them.

    Args:
        tasks: names without ``published/``, or paths of task files; none: all of the set that have a plan.
        published: the set with the published geometry.

    Raises:
        InputError: UNKNOWN_TASK.
    """
    from hmap_core.scenes import list_tasks  # slow to import

    in_set = [task for task in list_tasks() if task.startswith(PUBLISHED) == published]
    prefix = PUBLISHED if published else ""
    chosen = [task if is_file(task) else prefix + task.removeprefix(prefix) for task in tasks]
    chosen = chosen or [task for task in list_tasks(unsolvable=False) if task in in_set]
    for task in chosen:
        if not is_file(task) and task not in in_set:
            known = ", ".join(name.removeprefix(PUBLISHED) for name in in_set)
            kind = "published task" if published else "task"
            raise InputError(
                f"unknown {kind} {task.removeprefix(prefix)!r}. Known: {known}, or the path of a .yaml file",
                Code.UNKNOWN_TASK,
            )
    return chosen


def hang_time(trial: Trial) -> float:
    """Seconds after which a trial is ended: planning to warm up, planning, new plans, and everything else."""
    return (2 + trial.max_replans) * trial.time_limit + EXECUTION_TIME


def _numbered(k: int, trial: Trial, command: Sequence[str]) -> tuple[int, TrialResult]:
    return k, run_isolated(trial, hang_time(trial), command)


@contextlib.contextmanager
def _backend(address: str | None) -> Iterator[None]:
    """Makes joblib use a Dask cluster, where one is named."""
    if address is None:
        yield
        return
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError("--dask needs Dask, which is not here: pip install 'dask[distributed]'") from error
    from joblib import parallel_config

    try:
        client = Client(address, timeout=CONNECTION_TIME)
    except (OSError, ValueError) as error:
        raise InputError(f"no Dask scheduler answers at '{address}': {error}") from error
    with client, parallel_config(backend="dask", client=client):
        yield
