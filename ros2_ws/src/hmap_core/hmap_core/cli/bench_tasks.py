"""``hmap bench tasks``: success rates and times of the tasks over many seeds."""

import argparse
import json
import sys
import time
from itertools import groupby
from pathlib import Path

from hmap_core.cli.main import count, natural, positive
from hmap_core.cli.plan import LIMITS, check_writable
from hmap_core.deadline import DEFAULT_TIME_LIMIT
from hmap_core.evaluation.trial import DEFAULT_PLANNER, DEFAULT_REPLANS, Trial, TrialResult
from hmap_core.exceptions import InputError

HELP = "plan tasks with many seeds, let the judge check the plans, execute them, and say how many are solved"
SEEDS = 10
TOLD = 160  # largest number of characters of a reason in the line of a trial


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the measurement."""
    parser.add_argument("--tasks", nargs="+", default=[], metavar="TASK", help="names or task files (all of the set)")
    parser.add_argument("--published", action="store_true", help="the tasks with the published geometry")
    parser.add_argument("--seeds", type=count, default=SEEDS, metavar="N", help=f"how many for each task ({SEEDS})")
    parser.add_argument("--first-seed", type=natural, default=0, metavar="S", help="the first of them (0)")
    add_trial_arguments(parser, DEFAULT_TIME_LIMIT)
    text = "proposes contacts before they are sampled (auto); `hmap plugins` lists them"
    parser.add_argument("--proposer", default="", metavar="NAME", help=text)
    parser.add_argument("--dask", metavar="ADDRESS", help="do them on the cluster of this Dask scheduler")
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="write tasks.json, tasks.md and tasks.png to this folder"
    )


def add_trial_arguments(parser: argparse.ArgumentParser, time_limit: float | None) -> None:
    """Add the options that all measurements by trials have; ``time_limit`` in s is the default, None that of plans."""
    limit = f"for each planning ({LIMITS if time_limit is None else f'{time_limit:g}'})"
    parser.add_argument("--time-limit", type=positive, default=time_limit, metavar="SECONDS", help=limit)
    replans = f"new plans that an execution may ask for ({DEFAULT_REPLANS})"
    parser.add_argument("--replans", type=natural, default=DEFAULT_REPLANS, metavar="N", help=replans)
    parser.add_argument("--jobs", type=count, metavar="J", help="trials at once (one on each core)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the results to this file, too")


def run(arguments: argparse.Namespace) -> int:
    """Run the trials and report them; exit code 0 if all were solved."""
    if arguments.json:
        check_writable(arguments.json)
    if arguments.out:
        make_folder(arguments.out)
    if arguments.proposer:
        from hmap_core.planner import plugins  # slow to import, and rarely needed

        plugins.create(plugins.CONTACT_PROPOSERS, arguments.proposer)  # a wrong name ends it before the first trial
    from hmap_core.evaluation import summary, trials  # slow to import, and not needed to reject a path

    wanted = [
        Trial(task, seed, arguments.time_limit, arguments.replans, proposer=arguments.proposer)
        for task in trials.task_names(arguments.tasks, arguments.published)
        for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    ]
    found = trials.run_trials(wanted, arguments.jobs or -1, arguments.dask, TrialProgress(len(wanted)))
    pairs = groupby(zip(wanted, found, strict=True), key=lambda pair: pair[0].name)
    results = {name: [result for _, result in group] for name, group in pairs}
    print(*summary.table(results), sep="\n")
    document = json.dumps(summary.to_dict(results), indent=2) + "\n"
    if arguments.json:
        arguments.json.write_text(document, encoding="utf-8")
    if arguments.out:
        from hmap_core.evaluation.figure import draw  # slow to import, and rarely needed

        (arguments.out / "tasks.json").write_text(document, encoding="utf-8")
        (arguments.out / "tasks.md").write_text("\n".join(summary.markdown(results)) + "\n", encoding="utf-8")
        draw(results, arguments.out / "tasks.png")
    return 0 if all(result.solved for result in found) else 1


def make_folder(path: Path) -> None:
    """Make a folder for results, if it is not there.

    Raises:
        InputError: it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be made a folder: {error.strerror}") from error


class TrialProgress:
    """Prints one line to standard error for every finished trial."""

    def __init__(self, total: int):
        """
        Args:
            total: number of trials.
        """
        self._began, self._total, self._done = time.monotonic(), total, 0

    def __call__(self, trial: Trial, result: TrialResult) -> None:
        self._done += 1
        planned = "" if result.planning_s is None else f", planning {result.planning_s:.2f} s"
        replans = f", {result.replans} new plans" if result.replans else ""
        verdict = "solved" if result.solved else f"not solved: {' '.join(result.reason.split())[:TOLD]}"
        now = time.monotonic() - self._began
        head = f"[{now:7.1f} s] {self._done} of {self._total}"
        name = trial.name if trial.planner == DEFAULT_PLANNER else f"{trial.name} by {trial.planner}"
        print(f"{head}  {name}, seed {trial.seed}{planned}{replans}: {verdict}", file=sys.stderr, flush=True)
