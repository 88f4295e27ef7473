"""Runs that were recorded in several bags: a recorder that died and was started anew goes on in another one."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from hmap_core.evaluation.executed import Measured
from hmap_core.evaluation.recorded import CUT, RecordedRun, outcome

SLACK = 0.5  # s of real time by which statuses of both bags may overlap


def joined(runs: Sequence[RecordedRun]) -> list[RecordedRun]:
    """The runs, with those that go on in a later bag in one.

    Args:
        runs: in the order of bags and of goals.
    """
    found: list[RecordedRun] = []
    for run in runs:
        before = next((k for k, other in enumerate(found) if _goes_on(other, run)), None)
        if before is None:
            found.append(run)
        else:
            found[before] = _join(found[before], run)
    return found


def _goes_on(first: RecordedRun, second: RecordedRun) -> bool:
    """Whether a run is the rest of another one, by the names of the recorder's bags and the goal's time."""
    stem, _, number = second.bag.rpartition("-")
    same = stem == first.bag and number.isdigit() and (first.task, first.seed) == (second.task, second.seed)
    ended, begin = first.statuses[-1], second.statuses[0]
    return (
        same
        and outcome(first)[0] == CUT
        and begin.elapsed >= ended.elapsed - SLACK
        and begin.time >= ended.time - SLACK
    )


def _join(first: RecordedRun, second: RecordedRun) -> RecordedRun:
    """One run of both parts; it is called by the first bag, so that it can go on in a third one as well."""
    ended = first.statuses[-1]
    statuses = (*first.statuses, *[status for status in second.statuses if status.elapsed > ended.elapsed])
    known = {time for time, _ in first.plans}
    gap = max(0.0, second.statuses[0].elapsed - ended.elapsed)
    told = f"the recorder died; the run goes on in {second.bag}, about {gap:.1f} s later"
    return replace(
        first,
        statuses=statuses,
        plans=(*first.plans, *[entry for entry in second.plans if entry[0] not in known]),
        measured=_both(first.measured, second.measured),
        joints=_both(first.joints, second.joints),
        faults=tuple(dict.fromkeys((*first.faults, *second.faults))),
        missing=tuple(dict.fromkeys((*first.missing, told, *second.missing))),
    )


def _both(first: Measured | None, second: Measured | None) -> Measured | None:
    """What was measured in both parts, of the robots and bodies that both have."""
    if first is None or second is None:
        return second if first is None else first
    rows = second.time > first.time[-1] if len(first.time) else np.ones(len(second.time), bool)

    def after(one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {name: np.concatenate([table, other[name][rows]]) for name, table in one.items() if name in other}

    return Measured(
        np.concatenate([first.time, second.time[rows]]),
        after(first.joints, second.joints),
        after(first.gripper, second.gripper),
        after(first.poses, second.poses),
    )
