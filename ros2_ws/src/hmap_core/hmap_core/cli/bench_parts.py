"""``hmap bench parts``: object paths, whole plans and transits of bodies of many parts among many parts."""

import argparse
import json
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from pathlib import Path

from hmap_core.cli.main import count
from hmap_core.cli.plan import check_writable

HELP = "measure object paths and whole plans of bodies of many parts among many parts, and how they keep time limits"
PARTS = 1000
REPEATS = 5
LIMITS = (1.0, 2.0, 5.0)  # s, of searches that find nothing


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("--parts", type=count, default=PARTS, metavar="N", help=f"of the body ({PARTS})")
    parser.add_argument("--obstacle-parts", type=count, default=PARTS, metavar="N", help=f"around it ({PARTS})")
    parser.add_argument("--repeats", type=count, default=REPEATS, metavar="N", help=f"seeds 0 to N - 1 ({REPEATS})")
    parser.add_argument(
        "--overruns", action="store_true", help="only measure how short limits are kept, in new processes and later"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results to this file, too")


def run(arguments: argparse.Namespace) -> int:
    """Measure; exit code 1 if a path or a plan was not found, or if a limit was not kept."""
    if arguments.json is not None:
        check_writable(arguments.json)
    from hmap_core.benchmark import many_parts  # other commands need no benchmarks to be imported
    from hmap_core.compile_cache import ensure_compiled

    ensure_compiled()
    if arguments.overruns:
        return _overruns(arguments)
    results = []
    print(f"{'problem':<16}{'seed':>5}{'limit s':>9}{'CPU s':>8}{'wall s':>8}{'wall / limit':>14}  path", flush=True)
    many_parts.run(many_parts.window(30, 30, 0))  # what is compiled is loaded
    many_parts.run_plan(many_parts.carried(10, 10, 0))
    many_parts.run_transit(*many_parts.attached(80, 80, 0))

    def window(lid: bool, seed: int, limit: float) -> many_parts.Trial:
        return many_parts.run(many_parts.window(arguments.parts, arguments.obstacle_parts, seed, lid), limit)

    def carried(seed: int, limit: float) -> many_parts.Trial:
        return many_parts.run_plan(many_parts.carried(arguments.parts, arguments.obstacle_parts, seed), limit)

    def attached(seed: int, limit: float) -> many_parts.Trial:
        return many_parts.run_transit(*many_parts.attached(arguments.parts, arguments.obstacle_parts, seed), limit)

    kinds: dict[str, Callable[[int, float], many_parts.Trial]] = {
        "window": partial(window, False),
        "closed window": partial(window, True),
        "carried": carried,
        "attached": attached,
    }
    for name, measure in kinds.items():
        for seed in range(arguments.repeats):
            for limit in LIMITS if name == "closed window" else (many_parts.LIMIT,):
                trial = measure(seed, limit)
                path = f"{trial.poses} poses{'' if trial.clear else ', in collision'}" if trial.poses else "none"
                times = f"{trial.cpu:>8.2f}{trial.wall:>8.2f}{trial.wall / limit:>14.2f}"
                print(f"{name:<16}{seed:>5}{limit:>9g}{times}  {path}", flush=True)
                results.append({"problem": name, "seed": seed, **asdict(trial)})
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    found = all(trial["poses"] and trial["clear"] for trial in results if trial["problem"] != "closed window")
    return 0 if found else 1


def _overruns(arguments: argparse.Namespace) -> int:
    from hmap_core.benchmark.overruns import measured

    print(f"{'job':<16}{'seed':>5}{'limit s':>9}   time / limit: first of a process, later (CPU time)", flush=True)
    kept, results = True, []
    for seed in range(arguments.repeats):
        for overrun in measured(arguments.parts, arguments.obstacle_parts, seed):
            limit, kept = overrun.limit, kept and overrun.kept
            ratios = "".join(f"{t.wall / limit:>8.2f} ({t.cpu / limit:.2f})" for t in overrun.trials)
            print(f"{overrun.job:<16}{seed:>5}{limit:>9g}{ratios}{'' if overrun.kept else '  late'}", flush=True)
            results.append({"seed": seed, **asdict(overrun)})
    if arguments.json is not None:
        arguments.json.write_text(json.dumps(results, indent=2) + "\n", encoding="utf-8")
    return 0 if kept else 1
