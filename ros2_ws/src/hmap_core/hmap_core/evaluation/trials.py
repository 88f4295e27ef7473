"""Runs many trials in parallel with joblib: in processes on this machine, or on a Dask cluster."""

from collections.abc import Callable, Sequence

from hmap_core.deadline import DEFAULT_TIME_LIMIT
from hmap_core.evaluation.cluster import OnMachines, backend
from hmap_core.evaluation.isolated import COMMAND, run_isolated
from hmap_core.evaluation.trial import PUBLISHED, Trial, TrialResult, is_path
from hmap_core.exceptions import Code, InputError
from hmap_core.planner import plugins

EXECUTION_TIMEOUT = 900.0  # s for loading, judging and executing a trial

OnResult = Callable[[Trial, TrialResult], None]


def run_trials(
    trials: Sequence[Trial],
    jobs: int = -1,
    dask: str | None = None,
    on_result: OnResult | None = None,
    command: Sequence[str] = COMMAND,
    on_machines: OnMachines | None = None,
) -> list[TrialResult]:
    """Runs trials. Each runs in a single-threaded process and depends on its seed only.

    Args:
        trials: the trials.
        jobs: number of parallel trials; -1 for one on each core. A Dask cluster determines it itself.
        dask: address of a Dask scheduler whose workers run the trials; None for this machine.
        on_result: called after each trial, in the order of completion.
        command: the worker process; see :class:`hmap_core.evaluation.isolated.Worker`.
        on_machines: called with the machines of a Dask cluster before its first trial.

    Returns:
        The results, in the order of the trials.

    Raises:
        InputError: Dask is not installed, its scheduler does not respond, or a worker cannot run the trials.
        PlannerError: SERVICE_UNAVAILABLE; the Dask cluster was lost.
    """
    if not trials:
        return []
    from joblib import Parallel, delayed  # slow to import, and needed by benchmarks only

    results: dict[int, TrialResult] = {}
    used = {(plugins.PLANNERS, trial.planner) for trial in trials}
    used |= {(plugins.CONTACT_PROPOSERS, trial.proposer) for trial in trials if trial.proposer}
    with backend(dask, sorted(used), on_machines):
        parallel = Parallel(n_jobs=jobs, batch_size=1, return_as="generator_unordered")
        for k, result in parallel(delayed(_numbered)(k, trial, command) for k, trial in enumerate(trials)):
            results[k] = result
            if on_result:
                on_result(trials[k], result)
    return [results[k] for k in range(len(trials))]


def task_names(tasks: Sequence[str] = (), published: bool = False) -> list[str]:
    """The tasks of a benchmark, as :func:`hmap_core.scenes.load_scene` expects them.

    Args:
        tasks: names without ``published/``, or paths of task files; empty for all solvable tasks of the set.
        published: use the set of tasks with the published geometry.

    Returns:
        The names and paths.

    Raises:
        InputError: UNKNOWN_TASK; a name is not in the set.
    """
    from hmap_core.scenes import list_tasks  # slow to import

    in_set = [task for task in list_tasks() if task.startswith(PUBLISHED) == published]
    prefix = PUBLISHED if published else ""
    chosen = [task if is_path(task) else prefix + task.removeprefix(prefix) for task in tasks]
    chosen = chosen or [task for task in list_tasks(unsolvable=False) if task in in_set]
    for task in chosen:
        if not is_path(task) and task not in in_set:
            known = ", ".join(name.removeprefix(PUBLISHED) for name in in_set)
            kind = "published task" if published else "task"
            raise InputError(
                f"unknown {kind} {task.removeprefix(prefix)!r}. Known: {known}, or the path of a .yaml file",
                Code.UNKNOWN_TASK,
            )
    return chosen


def trial_timeout(trial: Trial) -> float:
    """Wall-clock time in seconds after which a trial is killed: warm-up, planning, replans and execution."""
    return (2 + trial.max_replans) * (trial.time_limit or DEFAULT_TIME_LIMIT) + EXECUTION_TIMEOUT


def _numbered(k: int, trial: Trial, command: Sequence[str]) -> tuple[int, TrialResult]:
    return k, run_isolated(trial, trial_timeout(trial), command)
