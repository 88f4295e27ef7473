"""``hmap bench graph``: what planning through the nodes costs, compared with planning in one process."""

import argparse
import gc
import json
import os
import tempfile
import time
from pathlib import Path
from statistics import median

from hmap.environment import prepare_process
from hmap_core.cli.main import count, seed_argument
from hmap_core.command_line import keep_for_results
from hmap_core.exceptions import ExecutionError

HELP = "measure the processor time of planning through the services of the nodes, against planning in one process"
TASK, REPEATS = "tunnel", 5
PLANNERS = ("supervisor", "waypoint_planner", "contact_proposer", "komo_optimiser")
UP_LIMIT, GOAL_LIMIT = 180.0, 300.0  # s on a busy machine
POLL = 0.02  # s
WARMED = "warmed up"  # in the log of a node that is
DOMAIN = 90  # ROS_DOMAIN_ID, so that a running graph is not disturbed


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("task", nargs="?", default=TASK, metavar="TASK", help=f"a task ({TASK})")
    seed_argument(parser)
    parser.add_argument(
        "--repeats", type=count, default=REPEATS, metavar="N", help=f"plans after the first ({REPEATS})"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Measure; exit code 0."""
    os.environ["ROS_DOMAIN_ID"] = str(DOMAIN)
    prepare_process()
    keep_for_results()
    alone = in_process(arguments.task, arguments.seed, arguments.repeats)
    first, later = through_graph(arguments.task, arguments.seed, arguments.repeats)
    result = {
        "task": arguments.task,
        "seed": arguments.seed,
        "in_process_cpu_s": alone,
        "graph_first_cpu_s": sum(first.values()),
        "graph_cpu_s": [sum(plan.values()) for plan in later],
        "nodes_cpu_s": {name: median(plan[name] for plan in later) for name in PLANNERS},
    }
    usual = median(result["graph_cpu_s"])
    result["graph_by_process"] = usual / median(alone)
    result["first_by_later"] = result["graph_first_cpu_s"] / usual
    if arguments.json:
        print(json.dumps(result))
        return 0
    print(f"{arguments.task}, seed {arguments.seed}, processor time of one plan with the judge's look, medians:")
    print(f"  in one process      {median(alone):.3f} s")
    print(f"  through the graph   {usual:.3f} s, {result['graph_by_process']:.2f} times as much")
    print(f"  the first plan      {result['graph_first_cpu_s']:.3f} s, {result['first_by_later']:.2f} times as much")
    for name, seconds in result["nodes_cpu_s"].items():
        print(f"    {name:<18}{seconds:.3f} s")
    return 0


def in_process(task: str, seed: int, repeats: int) -> list[float]:
    """Seconds of processor time of plans in this process, after one that does not count."""
    from hmap_core import planner
    from hmap_core.scenes import load_scene

    scene, spent = load_scene(task, seed), []
    for _ in range(repeats + 1):
        gc.collect()
        began = time.process_time()
        planner.plan(scene, seed=seed)
        spent.append(time.process_time() - began)
    return spent[1:]


def through_graph(task: str, seed: int, repeats: int) -> tuple[dict[str, float], list[dict[str, float]]]:
    """Seconds of processor time that each planning node spends on the first plan, and on each later one.

    Raises:
        ExecutionError: there is no plan in time.
    """
    from hmap.launcher.processes import Graph
    from hmap.session import Session

    spent = []
    with tempfile.TemporaryDirectory() as folder, Graph(Path(folder) / "logs") as graph, Session() as session:
        graph.start("world", {"task": task, "seed": seed})
        graph.start("perception")
        for name in PLANNERS:
            graph.start(name, {"warm_up": True})
        session.wait_until_ready(UP_LIMIT)
        logs = [graph.nodes[name].log for name in PLANNERS]
        until = time.monotonic() + UP_LIMIT
        while time.monotonic() < until and not all(WARMED in log.read_text() for log in logs):
            time.sleep(POLL)
        processes = {name: graph.nodes[name].process for name in PLANNERS}
        pids = {name: process.pid for name, process in processes.items() if process is not None}
        for _ in range(repeats + 1):
            before = {name: processor_time(pid) for name, pid in pids.items()}
            session.manipulate(seed=seed, plan_only=True)
            until = time.monotonic() + GOAL_LIMIT
            while not session.is_done(POLL):
                if time.monotonic() > until:
                    raise ExecutionError(f"no plan within {GOAL_LIMIT:g} s")
            session.result().check()
            spent.append({name: processor_time(pid) - before[name] for name, pid in pids.items()})
    return spent[0], spent[1:]


def processor_time(pid: int) -> float:
    """Seconds of processor time, user and system, that a process has spent."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
