"""``hmap bench learning``: planning time with learned contacts, relative to sampling only."""

import argparse
import json
from pathlib import Path

from hmap_core.cli.main import count, natural, positive
from hmap_core.cli.plan import check_writable
from hmap_core.cli.progress import ProgressLine
from hmap_core.deadline import DEFAULT_TIME_LIMIT

HELP = "compare learned contacts with sampling only: paired seeds, bootstrap intervals of the ratios"
SEEDS = 10


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("--tasks", nargs="+", default=[], metavar="TASK", help="names or task files (the seven)")
    parser.add_argument("--seeds", type=count, default=SEEDS, metavar="N", help=f"how many for each task ({SEEDS})")
    parser.add_argument("--first-seed", type=natural, default=0, metavar="S", help="the first of them (0)")
    parser.add_argument("--weights", default="", metavar="FILE", help="of the model (the shipped ones)")
    limit = f"for each planning ({DEFAULT_TIME_LIMIT:g})"
    parser.add_argument("--time-limit", type=positive, default=DEFAULT_TIME_LIMIT, metavar="SECONDS", help=limit)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all runs to this file, too")
    parser.add_argument("--figure", type=Path, metavar="PNG", help="draw the ratios, too")


def run(arguments: argparse.Namespace) -> int:
    """Compare; exit code 1 if fewer plans were found with learned contacts."""
    for path in filter(None, (arguments.json, arguments.figure)):
        check_writable(path)
    from hmap_core.evaluation.trials import task_names
    from hmap_core.learning import ablation  # other commands need no benchmarks to be imported

    tasks = task_names(arguments.tasks)
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    with ProgressLine() as line:
        found = ablation.compare(
            tasks, seeds, arguments.weights, arguments.time_limit, lambda task, seed: line.show(task, f"seed {seed}")
        )
    print(*ablation.table(found), sep="\n")
    if arguments.json is not None:
        text = json.dumps([one.to_dict() for one in found], indent=2)
        arguments.json.write_text(text + "\n", encoding="utf-8")
    if arguments.figure is not None:
        ablation.figure(found, arguments.figure)
    worse = [one for one in found if sum(r.solved for r in one.learned) < sum(r.solved for r in one.sampled)]
    return 1 if worse else 0
