"""A table: cells by task and method, and comparisons with the reference, corrected over the tasks."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from hmap_core.deadline import DEFAULT_TIME_LIMIT
from hmap_core.evaluation.table.log import Key, key_of
from hmap_core.evaluation.table.statistics import Cell, Comparison, compare, holm
from hmap_core.evaluation.trial import Trial, TrialResult

LABELS = {"lgp_star": "lgp*"}  # names of the table, where they differ from those of the command line


def label(planner: str) -> str:
    """What a method is called in the table."""
    return LABELS.get(planner, planner)


@dataclass(frozen=True)
class Table:
    """Cells and comparisons.

    Attributes:
        tasks, planners: names, in their order; the first planner is the reference.
        cells: by task and planner.
        comparisons: by task and planner, without the reference.
    """

    tasks: tuple[str, ...]
    planners: tuple[str, ...]
    cells: dict[tuple[str, str], Cell]
    comparisons: dict[tuple[str, str], Comparison]

    @property
    def reference(self) -> str:
        """The method that the others are compared with."""
        return self.planners[0]


def build(wanted: Sequence[Trial], results: dict[Key, TrialResult], executed: set[str]) -> Table:
    """Build the table of some trials.

    Args:
        wanted: the trials of the table; those without a result yet are left out.
        results: of the trials.
        executed: tasks that are executed under dynamics.
    """
    tasks = tuple(dict.fromkeys(trial.task for trial in wanted))
    planners = tuple(dict.fromkeys(trial.planner for trial in wanted))
    cells = {}
    for task in tasks:
        for planner in planners:
            own = [t for t in wanted if (t.task, t.planner) == (task, planner)]
            done = [t for t in own if key_of(t) in results]
            cells[task, planner] = Cell(
                own[0].name,
                label(planner),
                tuple(t.seed for t in done),
                tuple(results[key_of(t)] for t in done),
                task in executed,
                own[0].time_limit or DEFAULT_TIME_LIMIT,
            )
    return Table(tasks, planners, cells, _comparisons(tasks, planners, cells))


def _comparisons(
    tasks: Sequence[str], planners: Sequence[str], cells: dict[tuple[str, str], Cell]
) -> dict[tuple[str, str], Comparison]:
    """All methods against the first one; of each, the p-values are corrected over the tasks."""
    found: dict[tuple[str, str], Comparison] = {}
    for planner in planners[1:]:
        own = {task: compare(cells[task, planner], cells[task, planners[0]]) for task in tasks}
        tested = {task: comparison.p for task, comparison in own.items() if comparison.p is not None}
        corrected = dict(zip(tested, holm(list(tested.values())).tolist(), strict=True))
        found |= {(task, planner): replace(own[task], p_holm=corrected.get(task)) for task in tasks}
    return found
