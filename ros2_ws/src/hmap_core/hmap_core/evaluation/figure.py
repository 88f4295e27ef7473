"""Figure of the results of a benchmark."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from hmap_core.evaluation.summary import TaskSummary
from hmap_core.evaluation.trial import TrialResult

JITTER = 0.12  # vertical spread of the points of a task, relative to the distance between two tasks


def draw(results: Mapping[str, Sequence[TrialResult]], file: Path) -> None:
    """Draws the planning times of valid plans and the rates of valid and solved trials, for each task.

    Args:
        results: task -> results of its trials.
        file: the figure; the suffix selects the format.
    """
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    tasks = {name: TaskSummary(tuple(trials)) for name, trials in results.items()}
    figure, (times, rates) = pyplot.subplots(
        1, 2, figsize=(10.0, 1.4 + 0.5 * len(tasks)), sharey=True, width_ratios=(3, 2), layout="constrained"
    )
    for k, task in enumerate(tasks.values()):
        found = task.planning_times
        times.scatter(found, k + JITTER * np.linspace(-1.0, 1.0, len(found)), s=8, color="tab:blue", alpha=0.5, lw=0)
        if found:
            times.plot([np.median(found)] * 2, [k - 0.3, k + 0.3], color="black")
        n = max(1, len(task.trials))
        rates.barh(k - 0.18, 100.0 * task.valid / n, 0.34, color="tab:blue", label=None if k else "valid")
        rates.barh(k + 0.18, 100.0 * task.solved / n, 0.34, color="tab:green", label=None if k else "solved")
        rates.text(101.0, k, f"{task.solved} of {len(task.trials)}", va="center", fontsize=8)
    times.set(xscale="log", xlabel="planning time, s (bar: median)", **_decades(tasks))
    times.xaxis.set_major_formatter("{x:g}")
    times.set_yticks(range(len(tasks)), list(tasks))
    times.invert_yaxis()
    times.grid(axis="x", alpha=0.3)
    rates.set(xlim=(0.0, 128.0), xlabel="trials, %")
    rates.legend(loc="upper left", bbox_to_anchor=(0.0, -0.12 - 0.2 / len(tasks)), ncols=2, frameon=False, fontsize=8)
    figure.savefig(file, dpi=150)
    pyplot.close(figure)


def _decades(tasks: dict[str, TaskSummary]) -> dict[str, tuple[float, float]]:
    """Axis limits for the times: the powers of ten that enclose all of them."""
    found = [time for task in tasks.values() for time in task.planning_times]
    if not found:
        return {}
    low, high = np.floor(np.log10(min(found))), np.ceil(np.log10(max(found)))
    return {"xlim": (10.0**low, 10.0 ** max(high, low + 1.0))}
