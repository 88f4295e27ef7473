"""The real graph: every node its own process, talking over DDS, in a domain of its own."""

import os
import time

import pytest

FIRST_DOMAIN, DOMAINS = 120, 100  # ROS_DOMAIN_ID; each process of tests takes its own
UP_LIMIT = 180.0  # s for all nodes to be up on a busy machine
# a task that needs a single contact
TASK = """
schema: 1
description: Carry a brick along a table.
mode: physical
fixed:
  table: {shape: box, size: [2.4, 2.4, 0.1], pose: {xyz: [0, 0, -0.05]}}
movable:
  brick: {shape: box, size: [0.05, 0.05, 0.08], pose: {xyz: [0.5, -0.2, 0.04]}, mass: 0.3, friction: 0.6}
robots:
  arm: {model: panda, base: {xyz: [0, 0, 0], rpy_deg: [0, 0, 0]}}
cameras:
  overhead: {position: [1.1, 0.0, 1.4], look_at: [0.5, 0, 0]}
goal: {object: brick, pose: {xyz: [0.5, 0.2, 0.04]}}
"""
NODES = ("world", "komo_optimiser", "supervisor", "contact_proposer", "waypoint_planner", "perception")

os.environ["ROS_DOMAIN_ID"] = str(FIRST_DOMAIN + os.getpid() % DOMAINS)
os.environ["ROS_PYTHON_CHECK_FIELDS"] = "1"


@pytest.fixture(scope="module")
def graph(tmp_path_factory):
    """The graph with the tunnel loaded, and a session with it."""
    from hmap.launcher.processes import Graph
    from hmap.session import Session

    folder = tmp_path_factory.mktemp("graph")
    with Graph(folder / "logs") as graph, Session() as session:
        graph.session = session
        for name in NODES:
            task = {"task": "tunnel", "seed": 0, "real_time_factor": 0.0} if name == "world" else {}
            graph.start(name, task)
        graph.wait_until_up = lambda: wait_until_up(graph, session)
        graph.wait_until_up()
        yield graph


def wait_until_up(graph, session) -> None:
    until = time.monotonic() + UP_LIMIT
    while len(up := session.ready(graph.nodes)) < len(graph.nodes):
        graph.check()
        assert time.monotonic() < until, f"only {up} are up"
        time.sleep(0.2)


def no_traces(folder) -> bool:
    """Whether the logs are free of Python's traces."""
    return not any("Traceback" in path.read_text() for path in folder.glob("*.log"))
