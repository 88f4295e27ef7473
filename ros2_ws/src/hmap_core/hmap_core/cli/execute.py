"""``hmap execute FILE``: execute a plan with simulated robots under dynamics, without ROS."""

import argparse
import json
from pathlib import Path

from hmap_core.cli.check import read
from hmap_core.cli.progress import ProgressLine

HELP = "execute a plan file with simulated robots under dynamics, and say whether the task was solved"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, metavar="FILE", help="a plan file")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    document = read(arguments.file)
    with ProgressLine() as line:
        line.show("starting", "loading the simulation")
        from hmap_core import plan_file  # slow to import, and not needed to refuse a file
        from hmap_core.execution.execute import execute

        plan = plan_file.from_dict(document, str(arguments.file))
        report = execute(plan, lambda now, end, what: line.show("executing", f"{now:.1f} of {end:.1f} s, {what}"))
    error = {"position_m": report.goal_error.position_m, "rotation_deg": report.goal_error.rotation_deg}
    if arguments.json:
        print(json.dumps({"solved": report.solved, "goal_error": error, "reason": report.reason}))
    else:
        print("solved" if report.solved else f"not solved: {report.reason}")
        print(f"goal error      {error['position_m'] * 1e3:.2f} mm, {error['rotation_deg']:.2f} deg")
    return 0 if report.solved else 1
