"""``hmap plan TASK``: plan a task and write the plan to a file."""

import argparse
import sys
from pathlib import Path

from hmap_core.cli.main import positive, seed_argument
from hmap_core.cli.progress import ProgressLine
from hmap_core.deadline import DEFAULT_CPU_LIMIT, DEFAULT_TIME_LIMIT
from hmap_core.exceptions import HmapError, InputError

HELP = "plan a task, let the judge check the plan, and write it to a file"
LIMITS = f"{DEFAULT_TIME_LIMIT:g}, and {DEFAULT_CPU_LIMIT:g} of processor time"  # if no limit is given, for helps
ANIMATION_SUFFIX = ".gif"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``hmap plan``."""
    parser.add_argument("task", metavar="TASK", help="a name of `hmap tasks`, or a task file (.yaml)")
    seed_argument(parser)
    parser.add_argument("--out", type=Path, metavar="FILE", help="the plan file (TASK-SEED.json)")
    parser.add_argument("--time-limit", type=positive, metavar="SECONDS", help=f"for planning ({LIMITS})")
    parser.add_argument("--picture", type=Path, metavar="PNG", help="draw key frames of the plan, too")
    parser.add_argument("--animation", type=Path, metavar="GIF", help="draw the plan as an animated GIF, too")
    parts_arguments(parser)
    parser.add_argument("--explain", action="store_true", help="print what was tried, and why it failed, as a tree")


def parts_arguments(parser: argparse.ArgumentParser) -> None:
    """The options that choose parts of the planner by name."""
    listed = "`hmap plugins` lists them"
    parser.add_argument("--planner", default="hmap", metavar="NAME", help=f"the method (hmap); {listed}")
    text = f"plans the path of the object (hmap, the search of H-MaP); {listed}"
    parser.add_argument("--object-path", metavar="NAME", help=text)
    text = f"proposes contacts before they are sampled (auto, a model where it knows robots and task); {listed}"
    parser.add_argument("--proposer", metavar="NAME", help=text)
    text = f"searches transits of arms where the optimiser finds none (hmap, two trees); {listed}"
    parser.add_argument("--transit", metavar="NAME", help=text)


def run(arguments: argparse.Namespace) -> int:
    """Run ``hmap plan``; its exit code."""
    out = arguments.out or Path(f"{Path(arguments.task).stem}-{arguments.seed}.json")
    for path in filter(None, (out, arguments.picture, arguments.animation)):
        check_writable(path)
    check_animation(arguments.animation)
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
        if arguments.animation:
            animate(plan, arguments.animation, line)
    if arguments.explain and "search" in plan.stats:
        explain(plan.stats["search"])
    print_summary(plan, {"plan": out, "picture": arguments.picture, "animation": arguments.animation})
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


def check_animation(path: Path | None) -> None:
    """Raises InputError where an animation cannot be written in the format that a file name asks for."""
    if path is not None and path.suffix.lower() != ANIMATION_SUFFIX:
        raise InputError(f"{path}: an animation is written as GIF; its name has to end in {ANIMATION_SUFFIX}")


def animate(plan, path: Path, line: ProgressLine) -> None:
    """Write the animation of a plan."""
    from hmap_core.viz.animation import animate as write  # slow to import, and seldom needed

    write(plan, path, lambda done, of: line.show("drawing", f"frame {done} of {of}"))


def print_summary(plan, files: dict[str, Path | None]) -> None:
    """What was found, for people, and the files by kind."""
    from hmap_core.viz.summary import summary

    for name, value in summary(plan).items():
        print(f"{name:<16}{value}")
    for name, path in files.items():
        if path is not None:
            print(f"{name:<16}{path}")
    sys.stdout.flush()
