"""Solved-by-time curves: for each task, the share of a method's trials that were solved within a time."""

from pathlib import Path

import numpy as np

from hmap_core.evaluation.table.table import Table, label

COLUMNS = 4  # of plots
SHORTEST = 0.01  # s, where the time axis begins


def draw(table: Table, file: Path) -> None:
    """Draw the curves; a failure is censored at the time limit, so the curve of its method stays below 1."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    columns = min(COLUMNS, len(table.tasks))
    rows = -(-len(table.tasks) // columns)
    figure, axes = pyplot.subplots(
        rows, columns, figsize=(3.2 * columns, 2.4 * rows + 0.5), squeeze=False, sharey=True, layout="constrained"
    )
    for plot, task in zip(axes.flat, table.tasks, strict=False):
        for k, planner in enumerate(table.planners):
            cell = table.cells[task, planner]
            if cell.stated and len(cell.results):
                times = np.sort(cell.times[cell.solved_in_time])
                share = np.arange(len(times) + 1) / len(cell.results)
                ends = np.concatenate([[SHORTEST], times, [max(cell.time_limit, *times, 0.0)]])
                plot.step(ends, [*share, share[-1]], where="post", color=f"C{k}", label=label(planner))
        limit = table.cells[task, table.reference].time_limit
        plot.axvline(limit, color="gray", lw=0.6, ls=":")
        plot.set(title=table.cells[task, table.reference].task, xscale="log", ylim=(-0.02, 1.02), xlabel="time, s")
    for plot in list(axes.flat)[len(table.tasks) :]:
        plot.set_visible(False)
    for row in axes:
        row[0].set_ylabel("share solved (valid)")
    handles, names = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=max(1, len(names)), frameon=False)
    figure.savefig(file, dpi=150)
    pyplot.close(figure)
