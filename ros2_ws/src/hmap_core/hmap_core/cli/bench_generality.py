"""``hmap bench generality``: success rates and times of tasks that are generated at random, family by family."""

import argparse
import contextlib
import json
import tempfile
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

from hmap_core.cli.bench_tasks import TrialProgress, add_trial_arguments, make_folder
from hmap_core.cli.main import count, natural
from hmap_core.cli.plan import check_writable
from hmap_core.evaluation.trial import Trial

HELP = "generate tasks of many kinds, plan, judge and execute them, and say how many are solved and why others are not"
SEEDS = 25
WARM_UP = "puck_move"  # the task that a worker process plans before its first trial


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the measurement."""
    text = "names of families of tasks (all; `--list` shows them)"
    parser.add_argument("--families", nargs="+", default=[], metavar="FAMILY", help=text)
    parser.add_argument("--list", action="store_true", help="print the families and what their tasks are, and stop")
    parser.add_argument("--seeds", type=count, default=SEEDS, metavar="N", help=f"tasks of each family ({SEEDS})")
    parser.add_argument("--first-seed", type=natural, default=0, metavar="S", help="seed of the first of them (0)")
    add_trial_arguments(parser, None)
    text = "write generality.json and generality.md (tables) to this folder"
    parser.add_argument("--out", type=Path, metavar="DIR", help=text)
    text = "keep the task files in this folder, for `hmap plan DIR/FAMILY-SEED.yaml --seed SEED`"
    parser.add_argument("--save", type=Path, metavar="DIR", help=text)


def run(arguments: argparse.Namespace) -> int:
    """Run the trials and report them; exit code 0 if all were solved, or refused as they should be."""
    from hmap_core.benchmark.generality import registry, report  # slow to import, and not needed for the help

    chosen = registry.families(arguments.families)
    if arguments.list:
        print(*(f"{family.name:<22}{family.description}" for family in chosen), sep="\n")
        return 0
    if arguments.json:
        check_writable(arguments.json)
    for folder in filter(None, (arguments.out, arguments.save)):
        make_folder(folder)
    from hmap_core.evaluation.trials import run_trials  # slow to import, and not needed for the list

    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    pairs = [(family, seed) for family in chosen for seed in seeds]
    progress = TrialProgress(len(pairs))
    with _folder(arguments.save) as folder:
        wanted = []
        for family, seed in pairs:
            path = folder / f"{family.name}-{seed}.yaml"
            path.write_text(family.task_file(seed), encoding="utf-8")
            wanted.append(Trial(str(path), seed, arguments.time_limit, arguments.replans, WARM_UP))
        judges = {trial: family.judged for trial, (family, _) in zip(wanted, pairs, strict=True)}
        found = run_trials(
            wanted, arguments.jobs or -1, on_result=lambda trial, result: progress(trial, judges[trial](result))
        )
    judged = [(family, family.judged(result)) for (family, _), result in zip(pairs, found, strict=True)]
    results = {
        family.name: [result for _, result in group] for family, group in groupby(judged, key=lambda pair: pair[0])
    }
    print(*report.table(results), "", *report.failures(results), sep="\n")
    document = json.dumps(report.to_dict(results), indent=2) + "\n"
    if arguments.json:
        arguments.json.write_text(document, encoding="utf-8")
    if arguments.out:
        (arguments.out / "generality.json").write_text(document, encoding="utf-8")
        (arguments.out / "generality.md").write_text("\n".join(report.markdown(results)) + "\n", encoding="utf-8")
    return 0 if all(result.solved for _, result in judged) else 1


@contextlib.contextmanager
def _folder(saved: Path | None) -> Iterator[Path]:
    """The folder of the task files: the given one, or one that is removed afterwards."""
    if saved is not None:
        yield saved.absolute()
        return
    with tempfile.TemporaryDirectory(prefix="hmap_generality_") as folder:
        yield Path(folder)
