"""``hmap bench cmgmp``: the baseline CMGMP on the five demonstrations of its authors, with point fingers."""

import argparse
import json
from pathlib import Path

from hmap_core.cli.main import count, natural, positive
from hmap_core.cli.plan import check_writable

HELP = "measure the baseline CMGMP on the demonstrations of its authors"
SEEDS = 10
TIME_LIMIT = 30.0  # s of CPU time


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the measurement."""
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="only these demonstrations (all)")
    parser.add_argument("--seeds", type=count, default=SEEDS, metavar="N", help=f"how many for each ({SEEDS})")
    parser.add_argument("--first-seed", type=natural, default=0, metavar="S", help="the first of them (0)")
    limit = f"of CPU time for each search ({TIME_LIMIT:g})"
    parser.add_argument("--time-limit", type=positive, default=TIME_LIMIT, metavar="SECONDS", help=limit)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results to this file, too")


def run(arguments: argparse.Namespace) -> int:
    """Run the searches and print a row for each demonstration; exit code 0."""
    if arguments.json:
        check_writable(arguments.json)
    import numpy as np  # slow to import, and not needed to refuse a path

    from hmap_core.baselines.cmgmp.demonstrations import demonstrations, solve

    document = {}
    print(f"{'demonstration':<20}{'solved':>10}{'median s':>10}{'longest s':>11}{'nodes':>8}")
    for name, demonstration in demonstrations(arguments.only).items():
        seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
        found = [solve(demonstration, seed, arguments.time_limit) for seed in seeds]
        times = [seconds for solved, seconds, _ in found if solved]
        shown = (f"{np.median(times):.2f}", f"{max(times):.2f}") if times else ("-", "-")
        nodes = int(np.median([nodes for *_, nodes in found]))
        print(f"{name:<20}{len(times):>6} of {len(found)}{shown[0]:>9}{shown[1]:>11}{nodes:>8}", flush=True)
        document[name] = [
            {"seed": seed, "solved": solved, "cpu_s": seconds, "nodes": nodes}
            for seed, (solved, seconds, nodes) in zip(seeds, found, strict=True)
        ]
    if arguments.json:
        arguments.json.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    return 0
