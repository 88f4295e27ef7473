"""``hmap bench table``: every method on every task with paired seeds, and what that shows."""

import argparse
import shlex
import sys
from pathlib import Path

from hmap_core.cli.bench_tasks import TrialProgress, make_folder
from hmap_core.cli.main import count, natural, positive
from hmap_core.evaluation.trial import DEFAULT_PLANNER, PYBULLET, Trial
from hmap_core.exceptions import InputError

HELP = "compare methods on tasks with paired seeds: intervals and exact tests; a run that is killed resumes"
SEEDS = 10
TIME_LIMIT = 180.0  # s, as in the paper


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the table."""
    parser.add_argument("--tasks", nargs="+", default=[], metavar="TASK", help="names or task files (all of the set)")
    parser.add_argument("--physical", action="store_true", help="the tasks that are executed, not the published ones")
    planners = "names of `hmap plugins`; the others are compared with the first (all, hmap first)"
    parser.add_argument("--planners", nargs="+", default=[], metavar="NAME", help=planners)
    parser.add_argument("--seeds", type=count, default=SEEDS, metavar="N", help=f"how many for each cell ({SEEDS})")
    parser.add_argument("--first-seed", type=natural, default=0, metavar="S", help="the first of them (0)")
    limit = f"for each planning ({TIME_LIMIT:g})"
    parser.add_argument("--time-limit", type=positive, default=TIME_LIMIT, metavar="SECONDS", help=limit)
    replans = "new plans by hmap that an execution may ask for (0)"
    parser.add_argument("--replans", type=natural, default=0, metavar="N", help=replans)
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--jobs", type=count, metavar="J", help="trials at once (one on each core)")
    where.add_argument("--dask", metavar="ADDRESS", help="do them on the cluster of this Dask scheduler")
    out = "folder of the results; the same command resumes what is there"
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help=out)


def run(arguments: argparse.Namespace) -> int:
    """Run the trials that the folder does not have yet, and write the table; exit code 0."""
    make_folder(arguments.out)
    from hmap_core.evaluation import trials  # slow to import, and not needed to reject a path
    from hmap_core.evaluation.table import figure, machine, report
    from hmap_core.evaluation.table.log import TrialLog, key_of
    from hmap_core.evaluation.table.table import build

    planners = planner_names(arguments.planners)
    tasks = trials.task_names(arguments.tasks, not arguments.physical)
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    wanted = [
        Trial(task, seed, arguments.time_limit, arguments.replans, engine=PYBULLET, planner=planner)
        for seed in seeds  # one after the other, so that an interrupted table has all cells of the first seeds
        for task in tasks
        for planner in planners
    ]
    jobs = arguments.jobs or -1
    log = TrialLog(arguments.out)
    with log.opened(machine.session(planners, jobs, arguments.dask), wanted):
        left = [trial for trial in wanted if key_of(trial) not in log.results]
        progress = TrialProgress(len(left))

        def finished(trial: Trial, result) -> None:
            log.add(trial, result)
            progress(trial, result)

        trials.run_trials(
            left,
            jobs,
            arguments.dask,
            finished,
            on_machines=lambda machines: log.describe(machine=" + ".join(machines)),
        )
    sessions = [session for session in log.sessions if session["seconds"] > 0.0]
    table = build(wanted, log.results, executed_tasks(tasks))
    command = command_of(arguments)
    page = report.markdown(table, sessions, command)
    files = {
        "table.md": page,
        "table.tex": report.latex(table),
        "trials.csv": report.csv_text(table),
        "table.json": report.json_text(table, sessions, command),
    }
    for name, text in files.items():
        (arguments.out / name).write_text(text, encoding="utf-8")
    figure.draw(table, arguments.out / "solved_by_time.png")
    print(page, end="")
    return 0


def planner_names(chosen: list[str]) -> list[str]:
    """The methods of a table: those chosen, or all that can be used here, the default one first.

    Raises:
        InputError: a method is unknown, cannot be used here, or is given twice.
    """
    from hmap_core.planner import plugins  # slow to import

    known = plugins.plugins(plugins.PLANNERS)
    if not chosen:
        return [name for name in (DEFAULT_PLANNER, *sorted(set(known) - {DEFAULT_PLANNER})) if _loads(name)]
    for name in chosen:
        plugins.create(plugins.PLANNERS, name)
        if chosen.count(name) > 1:
            raise InputError(f"--planners names '{name}' twice; each is one row")
    return chosen


def _loads(name: str) -> bool:
    """Whether a method can be used here; if not, the reason is printed."""
    from hmap_core.planner import plugins  # slow to import

    try:
        plugins.create(plugins.PLANNERS, name)
    except InputError as error:
        print(f"without {name}: {error.reason}", file=sys.stderr)
        return False
    return True


def executed_tasks(tasks: list[str]) -> set[str]:
    """Those of some tasks that are executed under dynamics."""
    from hmap_core.scenes import load_scene  # slow to import
    from hmap_core.types import TaskMode

    return {task for task in tasks if load_scene(task, 0).mode is not TaskMode.KINEMATIC}


def command_of(arguments: argparse.Namespace) -> str:
    """The command that makes the same table."""
    words = ["hmap", "bench", "table"]
    for name in ("tasks", "planners"):
        given = getattr(arguments, name)
        words += [f"--{name}", *given] if given else []
    words += ["--physical"] * arguments.physical
    words += ["--seeds", str(arguments.seeds), "--time-limit", f"{arguments.time_limit:g}"]
    words += ["--first-seed", str(arguments.first_seed)] if arguments.first_seed else []
    words += ["--replans", str(arguments.replans)] if arguments.replans else []
    words += ["--dask", arguments.dask] if arguments.dask else []
    words += ["--jobs", str(arguments.jobs)] if arguments.jobs else []
    return shlex.join([*words, "--out", str(arguments.out)])
