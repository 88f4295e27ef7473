"""``hmap check FILE``: the judge decides whether a plan is valid."""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from hmap_core.exceptions import Code, InputError
from hmap_core.regular_file import regular

HELP = "say whether a plan file holds a valid plan, and if not, what is wrong with it"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("file", type=Path, metavar="FILE", help="a plan file")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Judge a plan file; exit code 0 if the plan is valid."""
    document = read(arguments.file)
    from hmap_core.validation import check  # slow to import, and not needed to reject a file

    if sys.stderr.isatty():
        print(f"checking {arguments.file} ...", file=sys.stderr)
    report = check(document)
    if arguments.json:
        print(json.dumps(report.to_dict()))
    else:
        _print(report)
    return 0 if report.valid else 1


def read(path: Path) -> dict[str, Any]:
    """Read the JSON object in a file.

    Raises:
        InputError: INVALID_PLAN_FILE; the file cannot be read, or contains no JSON object.
    """
    try:
        document = json.loads(regular(path).read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read as JSON: {why}", Code.INVALID_PLAN_FILE) from error
    if not isinstance(document, dict):
        kind = type(document).__name__
        raise InputError(f"{path}: holds a JSON {kind}; a plan is an object", Code.INVALID_PLAN_FILE)
    return document


def _print(report) -> None:
    print("valid" if report.valid else "not valid")
    for violation in report.violations:
        bodies = ", ".join(violation.bodies)
        measured = f"{violation.amount:.4g}, limit {violation.limit:.4g}"
        print(f"  {violation.time:8.3f} s  {violation.kind}  {bodies}: {measured}")
    error = report.goal_error
    print(f"goal error      {error['position_m'] * 1e3:.2f} mm, {error['rotation_deg']:.2f} deg")
    if report.min_clearance_m is not None:
        print(f"min clearance   {report.min_clearance_m * 1e3:.2f} mm")
    if report.min_held_clearance_m is not None:
        print(f"  of what is held   {report.min_held_clearance_m * 1e3:.2f} mm")
