"""Runs that were recorded: what is measured of each, and tables of many."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import PurePath
from typing import Any

import numpy as np

from hmap_core.evaluation import executed
from hmap_core.evaluation.executed import Measured
from hmap_core.evaluation.intervals import mean_interval, wilson
from hmap_core.evaluation.summary import aligned
from hmap_core.types import Plan

SOLVED, PLANNED, FAILED, CUT = "solved", "planned", "failed", "cut off"  # outcomes
ENDED_WELL = (SOLVED, PLANNED)
LATE = 2.0  # s after which the first status of a run that was recorded from its begin has come


@dataclass(frozen=True)
class Status:
    """What the planner said.

    Attributes:
        time: s of its clock.
        phase: of planning or execution.
        elapsed: s of real time since the goal was accepted.
        text: for people.
    """

    time: float
    phase: str
    elapsed: float
    text: str = ""


@dataclass(frozen=True)
class RecordedRun:
    """One goal in a bag.

    Attributes:
        bag: its path.
        number: of the goal in the bag, from 1.
        task, seed: of the scene.
        statuses: from its begin to its end.
        plans: s of the clock at which each plan was published, and the plan.
        measured: joints and poses meanwhile; None where neither was recorded.
        joints: joints of ``joint_states`` meanwhile, which come more often; None where they were not recorded.
        faults: what nodes told to be wrong meanwhile.
        missing: what was not recorded, and what cannot be said without it.
    """

    bag: str
    number: int
    task: str
    seed: int | None
    statuses: tuple[Status, ...]
    plans: tuple[tuple[float, Plan], ...] = ()
    measured: Measured | None = None
    joints: Measured | None = None
    faults: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()


@dataclass
class RunMetrics:
    """The numbers of one run; None: not known. ``docs/evaluation.md`` describes them."""

    bag: str
    goal: int
    task: str
    seed: int | None
    outcome: str
    code: str = ""
    reason: str = ""
    planning_s: float | None = None
    planning_cpu_s: float | None = None
    execution_s: float | None = None
    moving_s: float | None = None
    phases: dict[str, float] = field(default_factory=dict)
    joint_path_rad: float | None = None
    tip_path_m: float | None = None
    jerk_rad_s3: float | None = None
    clearance_m: float | None = None
    contact_switches: int | None = None
    plans: int = 0
    replans: int = 0
    replan_latency_s: list[float] = field(default_factory=list)
    drift_joints_rad: float | None = None
    drift_object_m: float | None = None
    goal_error_m: float | None = None
    goal_error_deg: float | None = None
    faults: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)

    def to_dict(self) -> dict[str, Any]:
        """The numbers as plain JSON types."""
        return asdict(self)


COMPARED = {
    "solved": "share",
    "planning_s": "s",
    "execution_s": "s",
    "moving_s": "s",
    "joint_path_rad": "rad",
    "tip_path_m": "m",
    "jerk_rad_s3": "rad/s^3",
    "clearance_m": "m",
    "contact_switches": "",
    "replans": "",
    "replan_latency_s": "s",
    "drift_joints_rad": "rad",
    "drift_object_m": "m",
    "goal_error_m": "m",
}
# of a run that did not come to its end, these say nothing of how long or far one is
OF_WHOLE_RUNS = ("execution_s", "moving_s", "joint_path_rad", "tip_path_m", "contact_switches")


def value(metrics: RunMetrics, name: str) -> float | None:
    """A number of a run by its name in COMPARED, for means and comparisons.

    Lists count by their mean, and whether it is solved as 0 or 1. Times and lengths of runs that did not come to their
    end do not count (None).
    """
    well = metrics.outcome in ENDED_WELL
    if name == "solved":
        return float(well)
    if name in OF_WHOLE_RUNS and not well:
        return None
    found = getattr(metrics, name)
    if isinstance(found, list):
        return float(np.mean(found)) if found else None
    return None if found is None else float(found)


def measure(run: RecordedRun, judge: bool = True) -> RunMetrics:
    """The numbers of a run.

    Args:
        run: as recorded.
        judge: whether the clearance is measured, which takes some seconds.
    """
    metrics = RunMetrics(run.bag, run.number, run.task, run.seed, *outcome(run))
    metrics.faults, metrics.missing = list(run.faults), list(run.missing)
    metrics.phases = _phases(run.statuses)
    metrics.plans, metrics.replans = len(run.plans), sum(s.phase == "replanning" for s in _entered(run.statuses))
    metrics.replan_latency_s = _latencies(run.statuses)
    began = next((s for s in run.statuses if s.phase == "execution"), None)
    planned = [s for s in run.statuses if s.phase in ("execution", "done", "failed")][:1]
    if planned:
        metrics.planning_s = planned[0].elapsed
    if run.plans:
        stats = run.plans[0][1].stats
        metrics.planning_s = _number(stats.get("planning_time_s"), metrics.planning_s)
        metrics.planning_cpu_s = _number(stats.get("planning_cpu_s"), None)
    if began is not None:
        metrics.execution_s = run.statuses[-1].time - began.time
        if run.measured is not None:
            _measure_motion(run, began.time, metrics, judge)
    _forget_what_began_before(run, metrics)
    return metrics


def _forget_what_began_before(run: RecordedRun, metrics: RunMetrics) -> None:
    """A bag that begins in the middle of a run does not tell its times and lengths."""
    first = run.statuses[0]
    if first.elapsed <= LATE:
        return
    for name in (*OF_WHOLE_RUNS, *([] if run.plans else ["planning_s"])):
        setattr(metrics, name, None)
    text = f"the first {first.elapsed:.1f} s: the bag begins in the phase '{first.phase}' (no times and lengths)"
    metrics.missing.append(text)


def _measure_motion(run: RecordedRun, began: float, metrics: RunMetrics, judge: bool) -> None:
    """The numbers that need measured joints."""
    if run.measured is None:
        return
    end = run.statuses[-1].time + 0.5
    whole = run.measured.between(began, end)
    dense = whole if run.joints is None else run.joints.between(began, end)
    dense = dense if len(dense.time) > len(whole.time) else whole
    if len(dense.time) < executed.SHORTEST:
        metrics.missing.append("measured joints while the plan was executed: too few for path, jerk, drift, clearance")
        return
    metrics.moving_s = float(np.diff(dense.time)[dense.moving()].sum())
    metrics.joint_path_rad = executed.joint_length(dense)
    metrics.jerk_rad_s3 = executed.jerk(dense)
    if not run.plans:
        return
    metrics.tip_path_m = executed.tip_length(run.plans[0][1], dense)
    if len(whole.time) < executed.SHORTEST:
        metrics.missing.append("world states while the plan was executed: too few for contacts, drift, clearance")
        return
    error = executed.goal_error(run.plans[-1][1], whole) if metrics.outcome != CUT else None
    metrics.goal_error_m, metrics.goal_error_deg = error if error is not None else (None, None)
    ends = [time for time, _ in run.plans[1:]] + [math.inf]
    late = run.statuses[0].elapsed > LATE
    clear, objects, joints, contacts = [], [], [], 0
    for (time, plan), end in zip(run.plans, ends, strict=True):
        part = whole.between(time, end)
        if len(part.time) < executed.SHORTEST:
            continue
        at = executed.progress(plan, part, anywhere=late)
        off = executed.drift(plan, part, at)
        joints.append(off.joints)
        objects += [off.object] if off.object is not None else []
        contacts += executed.contacts_begun(plan, at)
        if judge:
            distance = executed.clearance(plan, part, at)
            clear += [distance] if distance is not None and math.isfinite(distance) else []
    metrics.contact_switches = contacts
    metrics.drift_joints_rad, metrics.drift_object_m = max(joints, default=None), max(objects, default=None)
    metrics.clearance_m = min(clear, default=None)


def outcome(run: RecordedRun) -> tuple[str, str, str]:
    """How a run ended: outcome, code, reason."""
    last = run.statuses[-1]
    if last.phase == "done":
        return (SOLVED if any(s.phase == "execution" for s in run.statuses) else PLANNED), "", ""
    if last.phase != "failed":
        return CUT, "", f"the bag ends in the phase '{last.phase}'"
    code = last.text.partition("]")[0].partition("/")[2] if last.text.startswith("[") else ""
    return FAILED, code, last.text


def _entered(statuses: Sequence[Status]) -> list[Status]:
    """The statuses with which a phase begins."""
    return [
        s for before, s in zip((None, *statuses), statuses, strict=False) if before is None or before.phase != s.phase
    ]


def _phases(statuses: Sequence[Status]) -> dict[str, float]:
    """Seconds of real time in each phase."""
    spent: dict[str, float] = {}
    for now, after in zip(statuses, statuses[1:], strict=False):
        spent[now.phase] = spent.get(now.phase, 0.0) + max(0.0, after.elapsed - now.elapsed)
    return {phase: round(seconds, 3) for phase, seconds in spent.items()}


def _latencies(statuses: Sequence[Status]) -> list[float]:
    """Seconds of real time from each request of a new plan until its execution begins."""
    found, asked = [], None
    for status in statuses:
        if status.phase == "replanning" and asked is None:
            asked = status.elapsed
        elif status.phase == "execution" and asked is not None:
            found.append(round(status.elapsed - asked, 3))
            asked = None
    return found


def _number(found: Any, default: float | None) -> float | None:
    return float(found) if isinstance(found, int | float) and math.isfinite(found) else default


HEAD = (
    *("", "run", "task", "seed", "outcome", "plan s", "exec s", "path rad", "jerk rad/s^3", "clear mm", "contacts"),
    *("replans", "drift mm", "goal mm"),
)


def names_of(all_metrics: Sequence[RunMetrics]) -> list[str]:
    """What each run is called among others: its path from the folder that all share, and its goal if it is not the
    first of the bag. The last folder, such as ``bag``, is left out where the rest tells them apart."""
    parts = [PurePath(m.bag).parts for m in all_metrics]
    short = [p[:-1] for p in parts]
    parts = short if len(set(short)) == len(set(parts)) and all(short) else parts
    shared = 0
    while all(len(p) > shared + 1 and p[shared] == parts[0][shared] for p in parts):
        shared += 1
    goals = ["" if m.goal == 1 else f" #{m.goal}" for m in all_metrics]
    return [str(PurePath(*p[shared:])) + goal for p, goal in zip(parts, goals, strict=True)]


def rows(all_metrics: Sequence[RunMetrics]) -> list[tuple[str, ...]]:
    """The cells of a table: HEAD, and a row for each run, which begins with its number."""
    found: list[tuple[str, ...]] = [HEAD]
    for k, (name, m) in enumerate(zip(names_of(all_metrics), all_metrics, strict=True), 1):
        ended = m.outcome if not m.code else f"{m.outcome} {m.code}"
        cells = [m.planning_s, m.execution_s, m.joint_path_rad, m.jerk_rad_s3, _mm(m.clearance_m)]
        end = [m.contact_switches, m.replans, _mm(m.drift_object_m), _mm(m.goal_error_m)]
        seed = "-" if m.seed is None else str(m.seed)
        found.append((str(k), name, m.task or "-", seed, ended, *map(_cell, cells), *map(_cell, end)))
    return found


def table(all_metrics: Sequence[RunMetrics]) -> list[str]:
    """One line for each run."""
    found = rows(all_metrics)
    widths = [max(len(row[k]) for row in found) + 2 for k in range(len(HEAD))]
    return aligned([(f"{row[0]:>3}  {row[1]}", *row[2:]) for row in found], (0, *widths[2:]))


def remarks(all_metrics: Sequence[RunMetrics]) -> list[str]:
    """Why runs failed, faults, and what is missing, each once with the numbers of its runs in the table."""
    found: dict[str, list[int]] = {}
    for k, m in enumerate(all_metrics, 1):
        cut = [f"cut off: {m.reason}"] if m.outcome == CUT and m.reason else []
        for text in (*cut, *[f"fault: {t}" for t in m.faults], *[f"missing: {t}" for t in m.missing]):
            found.setdefault(text, []).append(k)
    lines = []
    for text, numbers in found.items():
        which = "all runs" if 1 < len(all_metrics) == len(numbers) else f"run {', '.join(map(str, numbers))}"
        lines.append(f"{which}: {text}")
    return lines


def intervals(all_metrics: Sequence[RunMetrics]) -> list[str]:
    """Means with 95 % intervals; times and lengths are those of the runs that ended well."""
    solved = sum(m.outcome in ENDED_WELL for m in all_metrics)
    low, high = wilson(solved, len(all_metrics))
    lines = [f"{'solved':<20}{solved} of {len(all_metrics)}  (95 % interval {low:.0%} to {high:.0%}, Wilson)"]
    for name, unit in COMPARED.items():
        values = [v for m in all_metrics if (v := value(m, name)) is not None]
        if name == "solved" or not values:
            continue
        low, high = mean_interval(values)
        between = f"  ({low:.4g} to {high:.4g})" if len(values) > 1 else "  (one run: no interval)"
        whole = ", those that ended well" if name in OF_WHOLE_RUNS and len(values) < len(all_metrics) else ""
        lines.append(f"{name:<20}{np.mean(values):.4g} {unit}{between}  n={len(values)}{whole}")
    return lines


def _mm(metres: float | None) -> float | None:
    return None if metres is None else 1e3 * metres


def _cell(number: float | None) -> str:
    if number is None:
        return "-"
    return str(number) if isinstance(number, int) else f"{number:.2f}"
