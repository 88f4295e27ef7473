"""What the launcher does when a node dies; stand-ins are started in place of the nodes."""

import os
import signal
import sys
import time

import pytest

from hmap.launcher import processes
from hmap.launcher.processes import MAX_STARTS, Graph
from hmap_core.exceptions import Code, ExecutionError

LIMIT = 60.0  # s on a busy machine
# SIGINT ends it at once, also where these tests run in the background of a shell, which lets it be ignored
STAND_IN = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.SIG_DFL)
print(*sys.argv[1:], flush=True)
time.sleep(600)
"""


@pytest.fixture
def graph(tmp_path, monkeypatch):
    """A graph whose nodes print their arguments and wait."""
    monkeypatch.setattr(
        processes,
        "node_command",
        lambda name, assignments, files=(): [sys.executable, "-c", STAND_IN, name, *assignments],
    )
    monkeypatch.setattr(processes, "END_TIMEOUT", 0.2)
    with Graph(tmp_path / "logs") as graph:
        yield graph


def until(condition) -> None:
    end = time.monotonic() + LIMIT
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


def kill(graph, name: str) -> None:
    """Kill a node, and wait until the launcher has noticed."""
    node = graph.nodes[name]
    starts = node.starts
    until(lambda: node.log.exists() and len(node.log.read_text().splitlines()) == starts)
    os.killpg(node.process.pid, signal.SIGKILL)
    until(lambda: node.starts > starts or node.code is not None)


def test_a_recorder_that_dies_is_started_anew_with_another_bag_and_named(graph, tmp_path):
    graph.start("recorder", {"path": tmp_path / "bag"})
    graph.start("world")
    kill(graph, "recorder")
    graph.check()
    assert graph.news() == ["the node recorder ended with exit code -9; started anew"] and graph.news() == []
    log = tmp_path / "logs" / "recorder.log"
    until(lambda: len(log.read_text().splitlines()) == 2)
    first, second = log.read_text().splitlines()
    assert f"path:={tmp_path / 'bag'} " in first and f"path:={tmp_path / 'bag-2'} " in second
    assert graph.bags() == [tmp_path / "bag", tmp_path / "bag-2"]


def test_the_others_go_on_without_a_recorder_that_dies_again_and_again(graph, tmp_path):
    graph.start("recorder", {"path": tmp_path / "bag"})
    graph.start("world")
    for _ in range(MAX_STARTS):
        kill(graph, "recorder")
    graph.check()
    assert "go on without it" in graph.news()[-1]
    assert graph.expected() == ["world"]


def test_perception_and_the_planners_are_started_anew(graph):
    for name in ("perception", "waypoint_planner", "contact_proposer", "komo_optimiser"):
        graph.start(name)
        kill(graph, name)
        assert graph.nodes[name].starts == 2
    graph.check()


@pytest.mark.parametrize("name", ["supervisor", "world"])
def test_without_supervisor_or_world_the_run_ends_with_the_nodes_name(graph, name):
    graph.start(name)
    kill(graph, name)
    with pytest.raises(ExecutionError, match=f"the node {name} ended with exit code -9") as error:
        graph.check()
    assert error.value.code is Code.NODE_LOST


def test_the_supervisor_waits_longer_where_nodes_are_started_anew(graph, tmp_path):
    graph.start("supervisor")
    log = tmp_path / "logs" / "supervisor.log"
    until(lambda: log.exists() and "service_patience:=30.0" in log.read_text())


def test_a_node_that_a_signal_has_stopped_is_killed_and_started_anew(graph, monkeypatch):
    monkeypatch.setattr(processes, "STOPPED_LIMIT", 0.2)
    graph.start("perception")
    node = graph.nodes["perception"]
    until(lambda: node.log.exists() and node.log.read_text())
    os.killpg(node.process.pid, signal.SIGSTOP)
    until(lambda: node.starts == 2)
    assert "was stopped by a signal" in graph.news()[0]
    graph.check()


@pytest.mark.parametrize(("name", "number"), [("supervisor", signal.SIGKILL), ("recorder", signal.SIGINT)])
def test_a_stopped_node_ends_with_the_others_at_once_and_a_recorder_writes_its_bag(graph, monkeypatch, name, number):
    monkeypatch.setattr(processes, "END_TIMEOUT", LIMIT)
    monkeypatch.setattr(processes, "STOPPED_LIMIT", LIMIT)
    graph.start(name)
    node = graph.nodes[name]
    until(lambda: node.log.exists() and node.log.read_text())
    os.killpg(node.process.pid, signal.SIGSTOP)
    until(lambda: processes._is_stopped(node.process.pid))
    graph.end()
    assert node.code == -number


def test_the_parameters_of_several_nodes_in_one_process_are_those_of_its_supervisor(graph):
    graph.start("composed_planning", {"dry_run": True})
    log = graph.nodes["composed_planning"].log
    until(lambda: log.exists() and log.read_text())
    given = log.read_text().split()
    assert {"supervisor:dry_run:=true", "supervisor:use_sim_time:=true", "supervisor:service_patience:=30.0"} <= {
        *given
    }
    assert set(graph.expected()) == {"supervisor", "waypoint_planner", "contact_proposer", "komo_optimiser"}
