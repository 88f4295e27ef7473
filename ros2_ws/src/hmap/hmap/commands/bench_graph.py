"""``hmap bench graph``: what planning through the nodes costs, compared with planning in one process."""

import argparse
import gc
import json
import os
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from hmap.environment import prepare_process
from hmap.launcher.processes import COMPOSED, Graph
from hmap_core.cli.main import count, seed_argument
from hmap_core.command_line import keep_for_results
from hmap_core.exceptions import ExecutionError

if TYPE_CHECKING:  # slow to import
    from hmap_core.contacts.camera import Cloud
    from hmap_core.types import Plan, SceneState

HELP = "measure the processor time of planning through the services of the nodes, against planning in one process"
TASK, REPEATS = "tunnel", 5
PLANNERS = ("supervisor", "waypoint_planner", "contact_proposer", "komo_optimiser")
UP_LIMIT, GOAL_LIMIT = 180.0, 300.0  # s on a busy machine
POLL = 0.02  # s
WARMED = "warmed up"  # in the log of a node that is
DOMAIN = 90  # ROS_DOMAIN_ID, so that a running graph is not disturbed
KINDS = {  # of graphs -> what they are called, and the processes that plan
    "graph": ("by services of the nodes", PLANNERS),
    "composed": ("nodes in one process", tuple(COMPOSED)),
}


@dataclass(frozen=True)
class GraphPlan:
    """A plan that the graph has made.

    Attributes:
        plan: the plan, which begins where everything was measured.
        clouds: what the cameras had seen of each object.
        cpu_s: process -> s of processor time that it has spent.
    """

    plan: "Plan"
    clouds: Mapping[str, "Cloud"]
    cpu_s: Mapping[str, float]

    @property
    def state(self) -> "SceneState":
        """Where everything was measured."""
        from hmap_core.types import SceneState

        begin, moves = self.plan.scene.start_state(), self.plan.trajectory
        return SceneState(begin.q, {name: float(gap[0]) for name, gap in moves.gripper.items()}, begin.poses)

    @property
    def total_s(self) -> float:
        """Processor time of all processes, s."""
        return sum(self.cpu_s.values())


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("task", nargs="?", default=TASK, metavar="TASK", help=f"a task ({TASK})")
    seed_argument(parser)
    parser.add_argument(
        "--repeats", type=count, default=REPEATS, metavar="N", help=f"plans after the first ({REPEATS})"
    )
    stop = f"measure instead how long arms move on after the supervisor is killed, and after pause and stop ({REPEATS})"
    parser.add_argument("--stop", type=count, nargs="?", const=REPEATS, metavar="N", help=stop)
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Measure; exit code 0."""
    os.environ["ROS_DOMAIN_ID"] = str(DOMAIN)
    prepare_process()
    keep_for_results()
    if arguments.stop:
        from hmap.commands import bench_stop

        rests = bench_stop.measured(arguments.task, arguments.seed, arguments.stop)
        print(json.dumps(rests) if arguments.json else "\n".join(bench_stop.lines(rests)))
        return 0
    result: dict[str, Any] = {"task": arguments.task, "seed": arguments.seed}
    for kind, (_, processes) in KINDS.items():
        result[kind] = measured(arguments.task, arguments.seed, arguments.repeats, processes)
    if arguments.json:
        print(json.dumps(result))
        return 0
    print(f"{arguments.task}, seed {arguments.seed}, s of processor time of one plan with the judge's look, medians;")
    print("times: by what one process without nodes takes from the same measurements")
    print(f"{'':<32}{'s':>8}{'alone':>8}{'times':>8}{'first s':>9}{'first/later':>13}{'same plan':>11}")
    for kind, (text, processes) in KINDS.items():
        entry = result[kind]
        print(
            f"{text:<32}{entry['cpu_s']:8.3f}{entry['in_process_cpu_s']:8.3f}{entry['by_process']:8.2f}"
            f"{entry['first_cpu_s']:9.3f}{entry['first_by_later']:13.2f}{entry['same_plans']:6d} of {entry['plans']}"
        )
        for name in processes if len(processes) > 1 else ():
            print(f"  {name:<30}{entry['processes_cpu_s'][name]:8.3f}")
    return 0


def measured(task: str, seed: int, repeats: int, processes: Sequence[str]) -> dict[str, Any]:
    """What plans of a graph cost, beside those of this process from the same measurements: medians.

    Args:
        task, seed: that is planned.
        repeats: plans after the first.
        processes: that plan.
    """
    first, *later = through_graph(task, seed, repeats, processes)
    in_process(first, seed)  # loads what planning needs
    alone = [in_process(plan, seed) for plan in later]
    usual = median(plan.total_s for plan in later)
    return {
        "plans": len(later),
        "cpu_s": usual,
        "in_process_cpu_s": median(cpu for cpu, _ in alone),
        "by_process": median(plan.total_s / cpu for plan, (cpu, _) in zip(later, alone, strict=True)),
        "same_plans": sum(same for _, same in alone),
        "first_cpu_s": first.total_s,
        "first_by_later": first.total_s / usual,
        "processes_cpu_s": {name: median(plan.cpu_s[name] for plan in later) for name in processes},
    }


def in_process(made: GraphPlan, seed: int) -> tuple[float, bool]:
    """Plan in this process what the graph has planned.

    Returns:
        Seconds of processor time, and whether the plan is as long as that of the graph, as it should be.
    """
    from hmap_core import planner

    gc.collect()
    began = time.process_time()
    plan = planner.plan(made.plan.scene, made.state, seed=seed, clouds=made.clouds)
    spent = time.process_time() - began
    return spent, len(plan.trajectory.time) == len(made.plan.trajectory.time)


def through_graph(task: str, seed: int, repeats: int, processes: Sequence[str]) -> list[GraphPlan]:
    """Plans of a graph.

    Args:
        task, seed: that is planned.
        repeats: plans after the first.
        processes: that plan.

    Raises:
        ExecutionError: there is no plan in time.
    """
    from hmap.conversions import cloud_from_message
    from hmap.node import LATCHED
    from hmap.session import Session
    from hmap_msgs.msg import ObjectClouds

    plans: list[GraphPlan] = []
    pictures: list[ObjectClouds] = []
    with tempfile.TemporaryDirectory() as folder, Graph(Path(folder) / "logs") as graph, Session() as session:
        session.node.create_subscription(ObjectClouds, "object_clouds", pictures.append, LATCHED)
        graph.start("world", {"task": task, "seed": seed})
        graph.start("perception")
        for name in processes:
            graph.start(name, {"warm_up": True})
        session.wait_until_ready(UP_LIMIT)
        _wait_until_warm([graph.nodes[name].log for name in processes])
        started = {name: graph.nodes[name].process for name in processes}
        pids = {name: process.pid for name, process in started.items() if process is not None}
        for _ in range(repeats + 1):
            before = {name: processor_time(pid) for name, pid in pids.items()}
            session.manipulate(seed=seed, plan_only=True)
            until = time.monotonic() + GOAL_LIMIT
            while not session.is_done(POLL):
                if time.monotonic() > until:
                    raise ExecutionError(f"no plan within {GOAL_LIMIT:g} s")
            plan = session.result().check().plan
            if plan is None:
                raise ExecutionError("the result has no plan")
            spent = {name: processor_time(pid) - before[name] for name, pid in pids.items()}
            seen = {each.object: cloud_from_message(each) for each in pictures[-1].clouds} if pictures else {}
            clouds = {name: cloud for name, cloud in seen.items() if cloud is not None}
            plans.append(GraphPlan(plan, clouds, spent))
    return plans


def _wait_until_warm(logs: Sequence[Path]) -> None:
    until = time.monotonic() + UP_LIMIT
    while time.monotonic() < until and not all(WARMED in log.read_text() for log in logs):
        time.sleep(POLL)


def processor_time(pid: int) -> float:
    """Seconds of processor time that the threads of a process have spent."""
    threads = Path(f"/proc/{pid}/task").iterdir()
    return sum(int((thread / "schedstat").read_text().split()[0]) for thread in threads) * 1e-9
