"""``hmap bag check BAG``: says what is missing or damaged in a bag."""

import argparse
import json
from pathlib import Path

HELP = "say what is missing or damaged in a recorded bag"
YES, NO = 0, 1  # exit codes


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("what", choices=("check",), metavar="check", help="what to do: check")
    parser.add_argument("bag", type=Path, metavar="BAG", help="folder of a bag, or an .mcap file")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--repair", type=Path, metavar="DIR", help="write what can be read into a new bag")


def run(arguments: argparse.Namespace) -> int:
    """Check a bag; exit code 0 if nothing is missing or damaged, else 1.

    Raises:
        InputError: there is no bag; the copy exists already.
    """
    from hmap.bags.check import check_bag, repair  # slow to import
    from hmap.bags.reader import open_bag

    bag = open_bag(arguments.bag)
    report = check_bag(bag)
    copied = repair(bag, arguments.repair) if arguments.repair is not None else None
    if arguments.json:
        print(json.dumps(report.to_dict() | {"copied": copied}))
        return YES if report.sound else NO
    print(f"{report.path}: {sum(report.counts.values())} messages in {report.duration:.1f} s")
    for topic, count in sorted(report.counts.items()):
        print(f"  {topic:<32}{count}")
    for title, entries in (("damaged", report.damaged), ("missing", report.missing), ("gap", report.gaps)):
        for entry in entries:
            print(f"{title}: {entry}")
    if copied is not None:
        print(f"{copied} messages written to {arguments.repair}")
    print("sound" if report.sound else "not sound")
    return YES if report.sound else NO
