"""``hmap bench quality``: how long the motions of plans last, how far they go, and how often contacts begin."""

import argparse
import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from hmap_core.cli.main import count, natural, positive
from hmap_core.cli.plan import check_writable
from hmap_core.deadline import DEFAULT_TIME_LIMIT

if TYPE_CHECKING:
    from hmap_core.benchmark.quality import Quality

HELP = "measure the motions of plans: durations, lengths, standing times, contact episodes"
SEEDS = 20
COLUMNS = {  # headings, and what :class:`hmap_core.benchmark.quality.Quality` calls them
    "duration s": "duration",
    "free s": "free",
    "loaded s": "loaded",
    "standing s": "standing",
    "detour": "detour",
    "swing rad": "swing",
    "tool rad": "tool_swing",
    "episodes": "episodes",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("--tasks", nargs="+", default=[], metavar="TASK", help="names or task files (all of the set)")
    parser.add_argument("--published", action="store_true", help="the tasks with the published geometry")
    parser.add_argument(
        "--plans", nargs="+", default=[], type=Path, metavar="FILE", help="measure these plan files, and plan nothing"
    )
    parser.add_argument("--seeds", type=count, default=SEEDS, metavar="N", help=f"how many for each task ({SEEDS})")
    parser.add_argument("--first-seed", type=natural, default=0, metavar="S", help="the first of them (0)")
    limit = f"for each planning ({DEFAULT_TIME_LIMIT:g})"
    parser.add_argument("--time-limit", type=positive, default=DEFAULT_TIME_LIMIT, metavar="SECONDS", help=limit)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results of each plan to this file, too")


def run(arguments: argparse.Namespace) -> int:
    """Plan, or read plans, and measure; exit code 0 if there is a plan for every task and seed."""
    if arguments.json is not None:
        check_writable(arguments.json)
    from hmap_core.benchmark.quality import medians  # other commands need no benchmarks to be imported

    results: dict[str, dict[str, Quality]] = {}
    complete = True
    print(f"{'task':<24}{'plans':>6}" + "".join(f"{name:>12}" for name in COLUMNS))
    for task, found, every in _of_files(arguments.plans) if arguments.plans else _planned(arguments):
        results[task], complete = found, complete and every
        middle = medians(list(found.values())) if found else dict.fromkeys(COLUMNS.values(), float("nan"))
        numbers = "".join(f"{middle[key]:>12.2f}" for key in COLUMNS.values())
        print(f"{task:<24}{len(found):>6}{numbers}", flush=True)
    if arguments.json is not None:
        document = {task: {name: asdict(one) for name, one in found.items()} for task, found in results.items()}
        arguments.json.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    return 0 if complete else 1


def _planned(arguments: argparse.Namespace) -> Iterator[tuple[str, dict[str, "Quality"], bool]]:
    """Each task, what its plans are like by seed, and whether there is one for every seed."""
    from hmap_core.benchmark.quality import quality
    from hmap_core.evaluation import trials
    from hmap_core.exceptions import HmapError
    from hmap_core.planner import plan
    from hmap_core.scenes import load_scene

    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    for task in trials.task_names(arguments.tasks, arguments.published):
        found = {}
        for seed in seeds:
            try:
                planned = plan(load_scene(task, seed), seed=seed, time_limit=arguments.time_limit)
            except HmapError as error:
                print(f"{task}, seed {seed}: {error}")
                continue
            found[str(seed)] = quality(planned)
        yield task, found, len(found) == len(seeds)


def _of_files(files: list[Path]) -> Iterator[tuple[str, dict[str, "Quality"], bool]]:
    """Each task of plan files, and what its plans are like by file."""
    from hmap_core.benchmark.quality import quality
    from hmap_core.plan_file import load

    results: dict[str, dict[str, Quality]] = {}
    for file in files:
        plan = load(file)
        results.setdefault(plan.scene.task, {})[str(file)] = quality(plan)
    yield from ((task, found, True) for task, found in results.items())
