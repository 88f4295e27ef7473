"""``hmap evaluate BAG...``: measures recorded runs."""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from hmap_core.exceptions import InputError

HELP = "measure recorded runs: success, times, path length, jerk, clearance, contacts, replans, drift, faults"
YES, NO = 0, 1  # exit codes


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("bags", type=Path, nargs="+", metavar="BAG", help="folders of bags, or folders of runs")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--plots", type=Path, metavar="DIR", help="draw pictures of the numbers into a folder")
    parser.add_argument("--html", type=Path, metavar="FILE", help="write a report that needs no other file")
    parser.add_argument("--no-clearance", action="store_true", help="leave out the judge, who takes seconds a run")


def run(arguments: argparse.Namespace) -> int:
    """Measure the runs; exit code 0 if at least one could be read.

    Raises:
        InputError: there is no bag at a path, or a file cannot be written.
    """
    from hmap_core.evaluation import recorded, report_page  # slow to import, as is all of ROS below

    metrics, problems = measured(arguments.bags, not arguments.no_clearance)
    if arguments.plots is not None:
        report_page.save_plots(metrics, arguments.plots)
    if arguments.html is not None:
        report_page.save(metrics, problems, arguments.html)
    if arguments.json:
        print(json.dumps({"runs": [m.to_dict() for m in metrics], "problems": problems}))
        return YES if metrics else NO
    for line in recorded.table(metrics) if metrics else ():
        print(line)
    for line in (*recorded.remarks(metrics), *problems):
        print(f"  {line}")
    if len(metrics) > 1:
        print()
        print("\n".join(recorded.intervals(metrics)))
    return YES if metrics else NO


def measured(paths: Sequence[Path], judge: bool = True):
    """The numbers of all runs in bags, or in folders of bags, and what could not be read.

    Raises:
        InputError: there is no bag at a path.
    """
    from hmap.bags.parts import joined
    from hmap.bags.reader import open_bag
    from hmap.bags.runs import runs_in
    from hmap_core.evaluation.recorded import measure

    found, problems = [], []
    folders = [folder for path in paths for folder in bags_at(path)]
    for number, folder in enumerate(folders, 1):
        if sys.stderr.isatty():
            print(f"\r{number} of {len(folders)}: {folder}", end="\033[K", file=sys.stderr, flush=True)
        try:
            found += runs_in(open_bag(folder))
        except InputError as error:
            problems.append(error.reason)
    if sys.stderr.isatty():
        print("\r\033[K", end="", file=sys.stderr)
    return [measure(recorded_run, judge) for recorded_run in joined(found)], problems


def bags_at(path: Path) -> list[Path]:
    """The bag at a path, or the bags in the folders below it, such as those of ``hmap up``.

    Raises:
        InputError: there is none.
    """
    if path.is_file() or any(path.glob("*.mcap")) or any(path.glob("*.db3")):
        return [path]
    found = sorted({file.parent for suffix in ("mcap", "db3") for file in path.rglob(f"*.{suffix}")})
    if not found:
        raise InputError(f"{path}: there is no bag, and no folder below it has one")
    return found
