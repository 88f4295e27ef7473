"""``hmap execute WHAT``: execute a plan with simulated robots under dynamics, without ROS."""

import argparse
import json
from pathlib import Path

from hmap_core.cli.check import read
from hmap_core.cli.main import natural, positive, seed_argument
from hmap_core.cli.plan import DEFAULT_TIME_LIMIT
from hmap_core.cli.progress import ProgressLine
from hmap_core.evaluation.trial import DEFAULT_REPLANS, is_path

HELP = "execute a plan file, or plan and execute a task, under dynamics, and say whether the task was solved"
PLAN_SUFFIX = ".json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``hmap execute``."""
    what = f"a plan file ({PLAN_SUFFIX}), a name of `hmap tasks`, or a task file (.yaml)"
    parser.add_argument("what", metavar="WHAT", help=what)
    replans = f"plan anew, so often at most, where the world is not as planned (a task: {DEFAULT_REPLANS}, a file: 0)"
    parser.add_argument("--replans", type=natural, metavar="N", help=replans)
    seed_argument(parser)
    limit = f"for each planning ({DEFAULT_TIME_LIMIT:g})"
    parser.add_argument("--time-limit", type=positive, default=DEFAULT_TIME_LIMIT, metavar="SECONDS", help=limit)
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Run ``hmap execute``; its exit code."""
    given = not is_path(arguments.what) and (arguments.what.endswith(PLAN_SUFFIX) or Path(arguments.what).is_file())
    document = read(Path(arguments.what)) if given else None
    with ProgressLine() as line:
        line.show("starting", "loading the simulation")
        from hmap_core.evaluation.replanning import replanner  # slow to import, and not needed to refuse a file
        from hmap_core.simulation.execute import execute_closed_loop

        plan = _planned(arguments, line) if document is None else _loaded(document, arguments.what)
        replans = arguments.replans if arguments.replans is not None else 0 if given else DEFAULT_REPLANS
        report = execute_closed_loop(
            plan,
            replanner(arguments.seed, arguments.time_limit),
            replans,
            on_progress=lambda now, end, what: line.show("executing", f"{now:.1f} of {end:.1f} s, {what}"),
        )
    _print(report, arguments.json)
    return 0 if report.solved else 1


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
    error = {"position_m": report.goal_error.position_m, "rotation_deg": report.goal_error.rotation_deg}
    if as_json:
        replans = report.to_dict()["replans"]
        print(json.dumps({"solved": report.solved, "goal_error": error, "reason": report.reason, "replans": replans}))
        return
    print("solved" if report.solved else f"not solved: {report.reason}")
    print(f"goal error      {error['position_m'] * 1e3:.2f} mm, {error['rotation_deg']:.2f} deg")
    for replan in report.replans:
        print(f"planned anew    at {replan.time:.1f} s: {replan.reason}")
        print(f"                {replan.failure or f'in {replan.planning_s:.2f} s'}")
