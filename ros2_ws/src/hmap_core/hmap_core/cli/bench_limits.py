"""``hmap bench limits``: what motions to goals on joint limits cost, compared with others."""

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from hmap_core.cli.main import count, seed_argument
from hmap_core.cli.plan import check_writable

HELP = "measure motions to goals on joint limits against motions of the same joint distances inside the limits"
TASK, CASES = "bookshelf_mini", 50


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("task", nargs="?", default=TASK, metavar="TASK", help=f"in whose scene ({TASK})")
    parser.add_argument("--cases", type=count, default=CASES, metavar="N", help=f"two motions each ({CASES})")
    seed_argument(parser)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results to this file, too")


def run(arguments: argparse.Namespace) -> int:
    """Measure; the exit code."""
    if arguments.json is not None:
        check_writable(arguments.json)
    import numpy as np

    from hmap_core.benchmark import limits  # other commands need no benchmarks to be imported
    from hmap_core.scenes import load_scene

    scene = load_scene(arguments.task, arguments.seed)
    robot = next(iter(scene.robots))
    inside, on_limits = limits.measure(scene, robot, arguments.cases, arguments.seed)
    print(f"{len(inside.seconds)} motions of '{robot}' each, CPU time")
    for name, costs in (("inside the limits", inside), ("goal on limits", on_limits)):
        median, mean = 1e3 * np.median(costs.seconds), 1e3 * np.mean(costs.seconds)
        print(f"{name:<20}median {median:8.1f} ms, mean {mean:8.1f} ms, {costs.failures} not found")
    ratios = [float(kind(on_limits.seconds) / kind(inside.seconds)) for kind in (np.median, np.mean)]
    print(f"{'ratio':<20}median {ratios[0]:8.2f}   , mean {ratios[1]:8.2f}")
    if arguments.json is not None:
        results = {"inside": asdict(inside), "on_limits": asdict(on_limits)}
        arguments.json.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    return 0
