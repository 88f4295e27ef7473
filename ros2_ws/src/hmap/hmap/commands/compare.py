"""``hmap compare A B``: says where two sets of recorded runs differ."""

import argparse
import json
from pathlib import Path

from hmap_core.exceptions import InputError

HELP = "say where two sets of recorded runs differ, by how much, and when there are too few runs to tell"
YES, NO = 0, 1  # exit codes


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    text = "a bag, a folder of bags or runs, or a file of `hmap evaluate --json`"
    parser.add_argument("a", type=Path, metavar="A", help=text)
    parser.add_argument("b", type=Path, metavar="B", help=text)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--no-clearance", action="store_true", help="leave out the judge, who takes seconds a run")


def run(arguments: argparse.Namespace) -> int:
    """Compare two sets of runs; exit code 0 if there were enough runs to tell, else 1.

    Raises:
        InputError: a set cannot be read, or has no run.
    """
    from hmap_core.evaluation import comparison

    sets = [_runs(path, not arguments.no_clearance) for path in (arguments.a, arguments.b)]
    differences = comparison.compare(*sets)
    enough = any(d.verdict != comparison.TOO_FEW for d in differences)
    differing = [d.name for d in differences if d.verdict == comparison.DIFFERS]
    if arguments.json:
        print(json.dumps({"enough": enough, "differing": differing, "numbers": [d.to_dict() for d in differences]}))
        return YES if enough else NO
    print(f"A: {arguments.a}, {len(sets[0])} runs; B: {arguments.b}, {len(sets[1])} runs")
    print("\n".join(comparison.table(differences)))
    if not enough:
        print(f"too few runs to conclude anything: at least {comparison.FEWEST} of each set are needed")
    elif differing:
        print(f"they differ in {', '.join(differing)} (p < {comparison.ALPHA:g} each)")
    else:
        print(f"no difference found (p < {comparison.ALPHA:g} for none)")
    if text := comparison.remark(*sets):
        print(text)
    return YES if enough else NO


def _runs(path: Path, judge: bool):
    from hmap.commands.evaluate import measured
    from hmap_core.evaluation.recorded import RunMetrics

    if path.is_file() and path.suffix == ".json":
        try:
            found = [RunMetrics(**entry) for entry in json.loads(path.read_text())["runs"]]
        except (ValueError, KeyError, TypeError, OSError) as error:
            raise InputError(f"{path}: is no file of `hmap evaluate --json`: {error}") from error
    else:
        found, problems = measured([path], judge)
        if not found:
            raise InputError("; ".join(problems) or f"{path}: there is no run")
    if not found:
        raise InputError(f"{path}: there is no run")
    return found
