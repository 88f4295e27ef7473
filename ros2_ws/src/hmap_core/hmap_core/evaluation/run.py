"""Runs one trial in this process: plans, judges, executes."""

import contextlib
import gc
import json
import time
from dataclasses import asdict, replace
from typing import Any

from hmap_core import planner
from hmap_core.deadline import DEFAULT_TIME_LIMIT
from hmap_core.evaluation.replanning import replanner
from hmap_core.evaluation.trial import DEFAULT_PLANNER, NOT_VALID, Trial, TrialResult
from hmap_core.exceptions import Code, HmapError
from hmap_core.plan_file import to_dict
from hmap_core.scenes import load_scene
from hmap_core.simulation.execute import execute_closed_loop
from hmap_core.simulation.perturbation import Perturbation
from hmap_core.types import Plan, TaskMode
from hmap_core.validation import check
from hmap_core.validation.report import Report

WARM_UP_SEED = 10**6  # added to a trial's seed, so that the warm-up plan differs from all trials
WARM_UP_LIMIT = 5.0  # s for the warm-up of a method that may restart until its time is up
MAX_VIOLATIONS_SHOWN = 3


def warm_up(trial: Trial) -> None:
    """Plans a task with another seed, so that imports and compilation do not count in the measured time.

    Args:
        trial: whose task is planned, or that for its warm-up if it has one.
    """
    seed, limit, options = WARM_UP_SEED + trial.seed, trial.time_limit, _options(trial)
    if trial.planner != DEFAULT_PLANNER:
        limit = min(limit or WARM_UP_LIMIT, WARM_UP_LIMIT)
    with contextlib.suppress(Exception):  # failures of the warm-up do not matter
        planner.plan(load_scene(trial.warm_up or trial.task, seed), seed=seed, time_limit=limit, **options)
    gc.collect()
    gc.freeze()  # a full collection of the libraries' objects takes as long as half a plan


def _options(trial: Trial) -> dict[str, Any]:
    """The method and its proposer as options of :func:`hmap_core.planner.plan`; none for the defaults."""
    method = {} if trial.planner == DEFAULT_PLANNER else {"planner": trial.planner}
    return method | ({"proposer": trial.proposer} if trial.proposer else {})


def run_trial(trial: Trial) -> TrialResult:
    """Runs a trial.

    Returns:
        The result; any exception becomes its ``reason``.
    """
    try:
        return _run(trial)
    except HmapError as error:
        return TrialResult(trial.seed, reason=str(error), code=error.code.name)
    except Exception as error:  # an internal error must not end the other trials
        reason = f"[internal/INTERNAL] {type(error).__name__}: {error}"
        return TrialResult(trial.seed, reason=reason, code=Code.INTERNAL.name)


def _run(trial: Trial) -> TrialResult:
    scene = load_scene(trial.task, trial.seed)
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        plan = planner.plan(scene, seed=trial.seed, time_limit=trial.time_limit, **_options(trial))
    except HmapError as error:
        method_s = time.perf_counter() - wall
        spent: dict[str, Any] = {"planning_s": method_s, "method_s": method_s, "cpu_s": time.process_time() - cpu}
        return TrialResult(trial.seed, reason=str(error), code=error.code.name, **spent)
    planned = _planned(trial, plan, time.perf_counter() - wall, time.process_time() - cpu)
    try:
        report = check(json.loads(json.dumps(to_dict(plan))))  # as read from a file
    except HmapError as error:  # the plan of another method can be anything
        return replace(planned, reason=f"not valid: {error.reason}", code=NOT_VALID)
    planned = replace(planned, valid=report.valid, goal_error=report.goal_error)
    if not report.valid:
        return replace(planned, reason=_violations(report), code=NOT_VALID)
    if scene.mode is TaskMode.KINEMATIC:
        return replace(planned, solved=True)
    return _executed(trial, plan, planned)


def _planned(trial: Trial, plan: Plan, method_s: float, cpu_s: float) -> TrialResult:
    counts: dict[str, Any] = {key: plan.stats.get(key) for key in ("waypoints", "contact_tries", "mode_switches")}
    return TrialResult(
        trial.seed, planning_s=plan.stats.get("planning_time_s", method_s), cpu_s=cpu_s, segments=len(plan.segments),
        duration_s=float(plan.trajectory.time[-1]), claimed=True, method_s=method_s, **counts,
    )  # fmt: skip


def _violations(report: Report) -> str:
    shown = [f"{v.kind} of {', '.join(v.bodies)} at {v.time:.2f} s" for v in report.violations[:MAX_VIOLATIONS_SHOWN]]
    more = len(report.violations) - len(shown)
    return "not valid: " + "; ".join(shown + ([f"{more} more"] if more else []))


def _executed(trial: Trial, plan: Plan, planned: TrialResult) -> TrialResult:
    replan = replanner(trial.seed, trial.time_limit or DEFAULT_TIME_LIMIT)
    actual = Perturbation.parse(trial.perturbation).apply(plan.scene, trial.sample) if trial.perturbation else None
    report = execute_closed_loop(plan, replan, trial.max_replans, engine=trial.engine, actual=actual)
    return replace(
        planned,
        executed=True,
        solved=report.solved,
        reason=report.reason,
        code="" if report.solved else report.code.name,
        replans=len(report.replans),
        replan_reasons=tuple(replan.reason for replan in report.replans),
        goal_error=asdict(report.goal_error),
    )
