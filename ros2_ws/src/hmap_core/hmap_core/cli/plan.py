"""``hmap plan TASK``: plan a task and write the plan to a file."""

import argparse
import sys
from pathlib import Path

from hmap_core.cli.main import positive, seed_argument
from hmap_core.cli.progress import ProgressLine
from hmap_core.exceptions import HmapError, InputError

HELP = "plan a task, let the judge check the plan, and write it to a file"
DEFAULT_TIME_LIMIT = 60.0  # s


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``hmap plan``."""
    parser.add_argument("task", metavar="TASK", help="a name of `hmap tasks`, or a task file (.yaml)")
    seed_argument(parser)
    parser.add_argument("--out", type=Path, metavar="FILE", help="the plan file (TASK-SEED.json)")
    limit = f"for planning ({DEFAULT_TIME_LIMIT:g})"
    parser.add_argument("--time-limit", type=positive, default=DEFAULT_TIME_LIMIT, metavar="SECONDS", help=limit)
    parser.add_argument("--picture", type=Path, metavar="PNG", help="draw the plan, too")
    parts_arguments(parser)
    parser.add_argument("--explain", action="store_true", help="print what was tried, and why it failed, as a tree")


def parts_arguments(parser: argparse.ArgumentParser) -> None:
    """The options that choose parts of the planner by name."""
    listed = "`hmap plugins` lists them"
    parser.add_argument("--planner", default="hmap", metavar="NAME", help=f"the method (hmap); {listed}")
    text = f"plans the path of the object (hmap, the search of H-MaP); {listed}"
    parser.add_argument("--object-path", metavar="NAME", help=text)
    text = f"proposes contacts before they are sampled (sampled); {listed}"
    parser.add_argument("--proposer", metavar="NAME", help=text)
    text = f"searches transits of arms where the optimiser finds none (hmap, two trees); {listed}"
    parser.add_argument("--transit", metavar="NAME", help=text)


def run(arguments: argparse.Namespace) -> int:
    """Run ``hmap plan``; its exit code."""
    out = arguments.out or Path(f"{Path(arguments.task).stem}-{arguments.seed}.json")
    for path in filter(None, (out, arguments.picture)):
        check_writable(path)
    from hmap_core.scenes import load_scene  # slow to import, and not needed to refuse a path

    scene = load_scene(arguments.task, arguments.seed)
    with ProgressLine() as line:
        line.show("starting", "loading the planner")
        from hmap_core import plan_file, planner  # slower still, and not needed to refuse a task

        try:
            plan = planner.plan(
                scene,
                seed=arguments.seed,
                time_limit=arguments.time_limit,
                planner=arguments.planner,
                object_path=arguments.object_path,
                proposer=arguments.proposer,
                transit=arguments.transit,
                progress=lambda p: line.planning(p.phase, p.waypoint, p.waypoints, p.attempt, p.text),
            )
        except HmapError as error:
            if arguments.explain and error.search is not None:
                line.clear()
                explain(error.search)
            raise
        plan_file.save(plan, out)
        if arguments.picture:
            line.show("drawing")
            draw(plan, arguments.picture)
    if arguments.explain and "search" in plan.stats:
        explain(plan.stats["search"])
    print_summary(plan, out, arguments.picture)
    return 0


def explain(search: dict) -> None:
    """Print a search tree (:mod:`hmap_core.planner.search_tree`)."""
    from hmap_core.planner.search_tree import Attempt

    for text in Attempt.from_dict(search).lines():
        print(text)
    sys.stdout.flush()


def check_writable(path: Path) -> None:
    """Raises InputError where a file cannot be put, before the time for making it is spent."""
    if path.is_dir():
        raise InputError(f"{path} is a folder; a file is needed")
    if not path.absolute().parent.is_dir():
        raise InputError(f"{path}: there is no folder {path.absolute().parent}")


def draw(plan, path: Path) -> None:
    """Write the picture of a plan."""
    from hmap_core.viz.picture import render  # slow to import, and seldom needed

    render(plan, path)


def print_summary(plan, out: Path, picture: Path | None) -> None:
    """What was found, for people."""
    from hmap_core.viz.summary import summary

    for name, value in summary(plan).items():
        print(f"{name:<16}{value}")
    print(f"{'plan':<16}{out}")
    if picture:
        print(f"{'picture':<16}{picture}")
    sys.stdout.flush()
