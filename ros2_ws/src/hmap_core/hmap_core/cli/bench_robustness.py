"""``hmap bench robustness``: how often plans solve their tasks in worlds that are off, with and without new plans."""

import argparse
import json
from pathlib import Path

from hmap_core.cli.bench_tasks import TrialProgress, add_trial_arguments
from hmap_core.cli.execute import engine_argument
from hmap_core.cli.main import count, natural
from hmap_core.cli.plan import check_writable
from hmap_core.deadline import DEFAULT_TIME_LIMIT
from hmap_core.evaluation.trial import Trial

HELP = "execute tasks in worlds whose friction, masses and poses are off, in open and closed loop"
SEEDS, SAMPLES = 5, 1
PERTURBATION = "friction=0.3,mass=0.5,pose=0.002:1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the measurement."""
    parser.add_argument("--tasks", nargs="+", default=[], metavar="TASK", help="names or task files (all of the set)")
    parser.add_argument("--seeds", type=count, default=SEEDS, metavar="N", help=f"how many for each task ({SEEDS})")
    parser.add_argument("--first-seed", type=natural, default=0, metavar="S", help="the first of them (0)")
    parser.add_argument("--samples", type=count, default=SAMPLES, metavar="N", help=f"worlds for each seed ({SAMPLES})")
    text = f"how far they are off at most ({PERTURBATION}); the planner does not know it"
    parser.add_argument("--perturb", default=PERTURBATION, metavar="WHAT", help=text)
    engine_argument(parser)
    add_trial_arguments(parser, DEFAULT_TIME_LIMIT)
    parser.add_argument("--markdown", type=Path, metavar="FILE", help="write the table to this file, too")


def run(arguments: argparse.Namespace) -> int:
    """Run the trials and report them; exit code 0 if all were solved in closed loop."""
    for path in filter(None, (arguments.json, arguments.markdown)):
        check_writable(path)
    from hmap_core.benchmark import robustness  # slow to import, and not needed to reject a path
    from hmap_core.evaluation.trials import run_trials, task_names
    from hmap_core.simulation.engines import check_engine
    from hmap_core.simulation.perturbation import Perturbation

    check_engine(arguments.engine)
    Perturbation.parse(arguments.perturb)
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    more = {"engine": arguments.engine, "perturbation": arguments.perturb}
    wanted = [
        Trial(task, seed, arguments.time_limit, replans, sample=1000 * seed + sample, **more)
        for task in task_names(arguments.tasks)
        for seed in seeds
        for sample in range(arguments.samples)
        for replans in (0, arguments.replans)
    ]
    found = run_trials(wanted, arguments.jobs or -1, None, TrialProgress(len(wanted)))
    rows = robustness.rows(wanted, found)
    print(*robustness.table(rows), sep="\n")
    print(*robustness.failures(wanted, found), sep="\n")
    if arguments.json:
        document = {"engine": arguments.engine, "perturbation": arguments.perturb, "tasks": robustness.to_dict(rows)}
        arguments.json.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    if arguments.markdown:
        arguments.markdown.write_text("\n".join(robustness.markdown(rows)) + "\n", encoding="utf-8")
    return 0 if all(result.solved for trial, result in zip(wanted, found, strict=True) if trial.max_replans) else 1
