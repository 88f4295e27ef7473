"""``hmap execute WHAT``: execute a plan with simulated robots under dynamics, without ROS."""

import argparse
import json
from pathlib import Path

from hmap_core.cli.check import read
from hmap_core.cli.main import count, natural, positive, seed_argument
from hmap_core.cli.plan import LIMITS
from hmap_core.cli.progress import ProgressLine
from hmap_core.deadline import DEFAULT_TIME_LIMIT
from hmap_core.evaluation.trial import DEFAULT_REPLANS, PYBULLET, is_path
from hmap_core.exceptions import InputError

HELP = "execute a plan file, or plan and execute a task, under dynamics, and say whether the task was solved"
PLAN_SUFFIX = ".json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``hmap execute``."""
    what = f"a plan file ({PLAN_SUFFIX}), a name of `hmap tasks`, or a task file (.yaml)"
    parser.add_argument("what", metavar="WHAT", help=what)
    replans = f"plan anew, so often at most, where the world is not as planned (a task: {DEFAULT_REPLANS}, a file: 0)"
    parser.add_argument("--replans", type=natural, metavar="N", help=replans)
    seed_argument(parser)
    limit = f"for each planning ({LIMITS} for the first)"
    parser.add_argument("--time-limit", type=positive, metavar="SECONDS", help=limit)
    engine_argument(parser)
    text = "a world that is off by up to this, and not known to the planner: friction=0.3,mass=0.5,pose=0.002:1"
    parser.add_argument("--perturb", metavar="WHAT", help=text)
    parser.add_argument("--samples", type=count, metavar="N", help="execute so many such worlds, with --perturb (1)")
    text = "follow the plan to its end, whatever happens: as --replans 0"
    parser.add_argument("--open-loop", action="store_true", help=text)
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def engine_argument(parser: argparse.ArgumentParser) -> None:
    """Add the option that chooses the physics engine."""
    text = f"the physics engine, pybullet or mujoco ({PYBULLET}); mujoco is an optional extra"
    parser.add_argument("--engine", default=PYBULLET, metavar="NAME", help=text)


def run(arguments: argparse.Namespace) -> int:
    """Run ``hmap execute``; its exit code."""
    _check_options(arguments)
    given = not is_path(arguments.what) and (arguments.what.endswith(PLAN_SUFFIX) or Path(arguments.what).is_file())
    document = read(Path(arguments.what)) if given else None
    with ProgressLine() as line:
        line.show("starting", "loading the simulation")
        from hmap_core.simulation.engines import check_engine  # slow to import, and not needed to refuse a file
        from hmap_core.simulation.perturbation import Perturbation

        check_engine(arguments.engine)
        perturbation = None if arguments.perturb is None else Perturbation.parse(arguments.perturb)
        plan = _planned(arguments, line) if document is None else _loaded(document, arguments.what)
        replans = _replans(arguments, given)
        if perturbation is None:
            report = _executed(plan, arguments, replans, None, line)
        else:
            scenes = [perturbation.apply(plan.scene, sample) for sample in range(arguments.samples or 1)]
            reports = [_executed(plan, arguments, replans, scene, line) for scene in scenes]
    if perturbation is None:
        _print(report, arguments.json)
        return 0 if report.solved else 1
    _print_samples(reports, arguments.json)
    return 0 if all(report.solved for report in reports) else 1


def _check_options(arguments: argparse.Namespace) -> None:
    """Raises InputError where options contradict each other."""
    if arguments.samples is not None and arguments.perturb is None:
        raise InputError("--samples needs --perturb: without it, all executions are the same")
    if arguments.open_loop and arguments.replans:
        raise InputError(f"--open-loop allows no new plans, and --replans {arguments.replans} asks for some; give one")


def _replans(arguments: argparse.Namespace, given: bool) -> int:
    """How many new plans are allowed. A plan file is followed to its end, unless the world is perturbed."""
    if arguments.open_loop:
        return 0
    if arguments.replans is not None:
        return arguments.replans
    return 0 if given and arguments.perturb is None else DEFAULT_REPLANS


def _executed(plan, arguments: argparse.Namespace, replans: int, actual, line: ProgressLine):
    """The report on an execution, in a world that is as planned or as ``actual``."""
    from hmap_core.evaluation.replanning import replanner  # slow to import
    from hmap_core.simulation.execute import execute_closed_loop

    return execute_closed_loop(
        plan,
        replanner(arguments.seed, arguments.time_limit or DEFAULT_TIME_LIMIT),
        replans,
        on_progress=lambda now, end, what: line.show("executing", f"{now:.1f} of {end:.1f} s, {what}"),
        engine=arguments.engine,
        actual=actual,
    )


def _loaded(document: dict, source: str):
    from hmap_core import plan_file

    return plan_file.from_dict(document, source)


def _planned(arguments: argparse.Namespace, line: ProgressLine):
    from hmap_core import planner
    from hmap_core.scenes import load_scene

    return planner.plan(
        load_scene(arguments.what, arguments.seed),
        seed=arguments.seed,
        time_limit=arguments.time_limit,
        progress=lambda p: line.planning(p.phase, p.waypoint, p.waypoints, p.attempt, p.text),
    )


def _print(report, as_json: bool) -> None:
    if as_json:
        print(json.dumps(_to_dict(report)))
        return
    print("solved" if report.solved else f"not solved: {report.reason}")
    error = report.goal_error
    print(f"goal error      {error.position_m * 1e3:.2f} mm, {error.rotation_deg:.2f} deg")
    for replan in report.replans:
        print(f"planned anew    at {replan.time:.1f} s: {replan.reason}")
        print(f"                {replan.failure or f'in {replan.planning_s:.2f} s'}")


def _print_samples(reports, as_json: bool) -> None:
    """The results of several executions, and how often they are solved."""
    from hmap_core.benchmark.generality.report import wilson  # slow to import

    solved = sum(report.solved for report in reports)
    low, high = wilson(solved, len(reports))
    if as_json:
        samples = [_to_dict(report) for report in reports]
        interval = {"solved": solved == len(reports), "solved_samples": solved, "interval_95": [low, high]}
        print(json.dumps(interval | {"samples": samples}))
        return
    for k, report in enumerate(reports):
        replans = f", {len(report.replans)} new plans" if report.replans else ""
        print(f"sample {k}: {'solved' if report.solved else f'not solved: {report.reason}'}{replans}")
    print(f"solved {solved} of {len(reports)} ({100 * low:.0f} to {100 * high:.0f} % at 95 %)")


def _to_dict(report) -> dict:
    """The report as plain JSON types."""
    error = {"position_m": report.goal_error.position_m, "rotation_deg": report.goal_error.rotation_deg}
    replans = report.to_dict()["replans"]
    return {"solved": report.solved, "goal_error": error, "reason": report.reason, "replans": replans}
