"""``hmap up TASK``: starts all nodes, which plan and execute a task."""

import argparse
import json
import math
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any

from hmap.environment import prepare_process
from hmap.launcher.options import graph_arguments
from hmap.launcher.page import start_page
from hmap.launcher.processes import Graph, output_folder
from hmap.launcher.spares import Spare, fork_spares
from hmap_core.cli.main import natural, positive, seed_argument, zero_or_more
from hmap_core.cli.progress import ProgressLine
from hmap_core.command_line import keep_for_results
from hmap_core.compile_cache import ensure_compiled
from hmap_core.exceptions import Code, InputError, PlannerError

HELP = "start the nodes, plan and execute a task with them, and stop them"
RESTARTS = True  # see hmap_core.cli.main
START_LIMIT = 120.0  # s for all nodes to be up
POLL = 0.1  # s
NODES, COMPOSED_NODES = 7, 4  # processes, without those of dynamic obstacles and of the page
KINEMATIC = "kinematic"
QUICK_SPEED, REAL_SPEED = 4.0, 1.0  # simulated s per s
DISCOVERY = 0.5  # s; time of the search for nodes that already run
DEFAULT_TIME_LIMIT = 120.0  # s for planning
INPUT_CODES = range(100, 200)  # of hmap_core.exceptions.Code
YES, NO, BAD_INPUT = 0, 1, 2  # exit codes
NODE_NAME = "hmap_up"
BAG, PLAN, PICTURE = "bag", "plan.json", "plan.png"  # files in the folder of the run


class Stopped(Exception):
    """SIGINT or SIGTERM was received."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command."""
    parser.add_argument("task", metavar="TASK", help="a name of `hmap tasks`, or a task file (.yaml)")
    seed_argument(parser)
    parser.add_argument("--out", type=Path, default=Path("runs"), metavar="DIR", help="of the runs' folders (runs)")
    limit = f"for planning ({DEFAULT_TIME_LIMIT:g})"
    parser.add_argument("--time-limit", type=positive, default=DEFAULT_TIME_LIMIT, metavar="SECONDS", help=limit)
    speed = "simulated seconds per second while a robot moves (4; with dynamic obstacles 1); 0: as fast as possible"
    parser.add_argument("--speed", type=zero_or_more, metavar="X", help=speed)
    parser.add_argument("--plan-only", action="store_true", help="do not execute the plan")
    dry = "plan and show, with a supervisor that never moves anything"
    parser.add_argument("--dry-run", action="store_true", help=dry)
    scaling = "of planned speeds while robots move, in (0, 1] (1)"
    parser.add_argument("--speed-scaling", type=positive, default=1.0, metavar="X", help=scaling)
    parser.add_argument("--no-picture", action="store_true", help="do not draw the plan")
    count = "bodies that appear near the path while it is executed, seen by the cameras only (1)"
    parser.add_argument("--dynamic-obstacles", type=natural, nargs="?", const=1, default=0, metavar="N", help=count)
    graph_arguments(parser)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    parser.add_argument("--keep", action="store_true", help="leave the nodes running afterwards, until Ctrl-C")


def run(arguments: argparse.Namespace) -> int:
    """Start the graph, plan and execute the task, and end the graph.

    Returns:
        The exit code.

    Raises:
        InputError: the task cannot be used, or a graph already runs.
        PlannerError: the nodes do not start in time.
        ExecutionError: a node has died.
    """
    prepare_process()
    keep_for_results()
    from hmap_core.execution.pace import scale
    from hmap_core.planner.preconditions import check_bodies  # slow to import, as is all of ROS below
    from hmap_core.scenes import load_scene

    scale("--speed-scaling", arguments.speed_scaling)
    scene = load_scene(arguments.task, arguments.seed)
    ensure_compiled(lambda text: print(text, file=sys.stderr))
    check_bodies(scene, scene.goal)
    if arguments.task.endswith((".yaml", ".yml")):
        arguments.task = str(Path(arguments.task).expanduser().absolute())
    if scene.mode == KINEMATIC and not arguments.plan_only:
        print(
            f"{arguments.task} is a kinematic task, which no real contact can execute: it is only planned",
            file=sys.stderr,
        )
        arguments.plan_only = True
    folder = output_folder(arguments.out, arguments.task, arguments.seed)
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    nodes = COMPOSED_NODES if arguments.composed else NODES
    spares = fork_spares(nodes + (arguments.dynamic_obstacles > 0) + (not arguments.no_viewer))
    try:
        return _run(arguments, folder, stop, spares)
    except Stopped:
        print("stopped", file=sys.stderr)
        return YES


def _run(arguments: argparse.Namespace, folder: Path, stop: threading.Event, spares: list[Spare]) -> int:
    from hmap.session import Session  # imports ROS; a wrong task name is reported before that

    files: dict[str, Path] = {}
    with ProgressLine() as line:
        with Graph(folder / "logs", spares) as graph, Session(name=NODE_NAME) as session:

            def between() -> None:
                for text in graph.news():
                    line.note(text)
                graph.check()
                if stop.is_set():
                    raise Stopped

            _start(graph, session, arguments, folder, line, between)
            if not arguments.no_viewer:
                line.note(start_page(graph, arguments.port))
            session.manipulate(
                arguments.task,
                seed=arguments.seed,
                plan_only=arguments.plan_only,
                time_limit=arguments.time_limit,
                on_feedback=lambda feedback: _show(line, feedback),
            )
            while not session.is_done(timeout=POLL):
                between()
            result = session.result()
            files |= {path.name: path for path in graph.bags()}
            if arguments.keep:
                files |= _save(result, folder, not arguments.no_picture, line)
                _print(result, files, arguments.json)
                line.show("up", "the nodes run on; Ctrl-C ends them")
                while not stop.is_set():
                    stop.wait(POLL)
                    between()
            line.show("stopping", "the nodes end")
        if not arguments.keep:
            files |= _save(result, folder, not arguments.no_picture, line)
    if not arguments.keep:
        _print(result, files, arguments.json)
    return _exit_code(result)


def _start(graph: Graph, session, arguments: argparse.Namespace, folder: Path, line: ProgressLine, between) -> None:
    line.show("starting", "looking for nodes that run already")
    until = time.monotonic() + DISCOVERY
    while time.monotonic() < until:
        if session.ready(["supervisor"]):
            raise InputError("a graph of nodes runs here already; end it, or set another ROS_DOMAIN_ID")
        time.sleep(POLL)
    graph.start("recorder", {"path": folder / BAG})
    world = {"task": arguments.task, "seed": arguments.seed, "real_time_factor": _speed(arguments)}
    if arguments.dynamic_obstacles:
        world["announce_added"] = False
        graph.start("dynamic_obstacles", {"count": arguments.dynamic_obstacles, "seed": arguments.seed})
    graph.start("world", world)
    supervisor = {"dry_run": arguments.dry_run, "speed_scaling": arguments.speed_scaling}
    if arguments.composed:
        graph.start("composed_planning", supervisor)
    else:
        graph.start("komo_optimiser")
        graph.start("supervisor", supervisor)
        for name in ("contact_proposer", "waypoint_planner"):
            graph.start(name)
    graph.start("perception")
    until = time.monotonic() + START_LIMIT
    while len(up := session.ready(nodes := graph.expected())) < len(nodes):
        between()
        missing = [name for name in nodes if name not in up]
        line.show("starting", f"{len(up)} of {len(nodes)} nodes are up; waiting for {', '.join(missing)}")
        if time.monotonic() > until:
            raise PlannerError(f"not up after {START_LIMIT:g} s: {', '.join(missing)}", Code.SERVICE_UNAVAILABLE)
        time.sleep(POLL)
    line.show("up", ", ".join(up))


def _speed(arguments: argparse.Namespace) -> float:
    """Simulated seconds per second: real time if new bodies have to be detected in time."""
    if arguments.speed is not None:
        return float(arguments.speed)
    return REAL_SPEED if arguments.dynamic_obstacles else QUICK_SPEED


def _show(line: ProgressLine, feedback) -> None:
    line.planning(feedback.phase, feedback.waypoint, feedback.waypoints, feedback.attempt, feedback.text)


def _save(result, folder: Path, picture: bool, line: ProgressLine) -> dict[str, Path]:
    """Write the plan and its picture; returns the files by kind."""
    from hmap_core import plan_file
    from hmap_core.viz.picture import render

    if result.plan is None:
        return {}
    files = {"plan": folder / PLAN}
    plan_file.save(result.plan, files["plan"])
    if picture:
        line.show("drawing")
        files["picture"] = folder / PICTURE
        render(result.plan, files["picture"])
    return files


def _print(result, files: dict[str, Path], as_json: bool) -> None:
    """Print the summary."""
    from hmap_core.viz.summary import summary

    if as_json:
        print(json.dumps(_report(result, files)), flush=True)
        return
    print(("solved" if result.executed else "planned, not executed") if result.success else "not solved")
    if not result.success:
        print(f"{'reason':<16}{result.error}")
    if result.plan is not None:
        lines = summary(result.plan)
        lines["final error"] = f"{result.position_error * 1e3:.2f} mm, {math.degrees(result.rotation_error):.2f} deg"
        for name, value in lines.items():
            print(f"{name:<16}{value}")
    for name, path in files.items():
        print(f"{name:<16}{path}")
    sys.stdout.flush()


def _report(result, files: dict[str, Path]) -> dict[str, Any]:
    """What ``--json`` prints; ``goal_error`` and ``reason`` as of ``hmap execute``."""
    from hmap_core.viz.summary import summary

    error = {"position_m": result.position_error, "rotation_deg": math.degrees(result.rotation_error)}
    return {
        "solved": result.success and result.executed,
        "planned": result.plan is not None,
        "goal_error": None if result.plan is None else error,
        "reason": None if result.success else str(result.error),
        "code": None if result.success else result.error.code.name,
        "summary": None if result.plan is None else summary(result.plan),
        "files": {name: str(path) for name, path in files.items()},
    }


def _exit_code(result) -> int:
    if result.success:
        return YES
    return BAD_INPUT if result.error.code in INPUT_CODES else NO
