"""Each node is killed in turn, while a plan is made and while it is executed: solved or a coded error, no hang."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from conftest import NODES, TASK, no_traces, wait_until_up
from sensor_msgs.msg import JointState

from hmap.launcher.processes import Graph
from hmap.operator_client import OperatorClient
from hmap.session import Session
from hmap_core.exceptions import Code, ExecutionError

ALL_NODES = ("recorder", *NODES)
TIME_LIMIT = 240.0  # s for planning on a busy machine
LIMIT = 300.0  # s for a goal; it hangs beyond
PATIENCE = 0.1  # s between two looks
STOPPED = 4.0  # s on a busy machine for the death of the supervisor to be noticed and for arms to brake
STEP = 2e-4  # rad between two measurements of an arm that moves
STILL = 2e-3  # rad that an arm which stands is measured to move


class Cell:
    """A graph with the task loaded, and the arm's joints as they come."""

    def __init__(self, folder: Path, graph: Graph, session: Session):
        self.folder, self.graph, self.session = folder, graph, session
        self.joints: list[tuple[float, np.ndarray]] = []
        session.node.create_subscription(JointState, "joint_states", self._note, 10)

    def _note(self, message: JointState) -> None:
        self.joints.append((time.monotonic(), np.array(message.position)))

    def moving(self) -> bool:
        """Whether the arm has moved between the last measurements."""
        return len(self.joints) > 5 and np.abs(self.joints[-1][1] - self.joints[-5][1]).max() > 10.0 * STILL

    def kill(self, name: str) -> None:
        os.killpg(self.graph.nodes[name].process.pid, signal.SIGKILL)

    def goal(self, phase: str = "", then=lambda: None, **fields):
        """The result of a goal; what is done once it is in a phase."""
        done = threading.Event()

        def look(feedback) -> None:
            if feedback.phase == phase and not done.is_set():
                done.set()
                then()

        self.session.manipulate(time_limit=TIME_LIMIT, on_feedback=look, **fields)
        self._wait()
        assert done.is_set() or not phase, f"there was no phase {phase!r}"
        return self.session.result()

    def goal_while_moving(self, then):
        """The result of a goal; what is done once an arm moves."""
        self.session.reset(60.0)
        wait_until_up(self.graph, self.session)
        self.joints.clear()
        self.session.manipulate(time_limit=TIME_LIMIT)
        until = time.monotonic() + LIMIT
        while not self.moving():
            assert time.monotonic() < until and not self.session.is_done(PATIENCE), self.session.result()
        then()
        self._wait()
        return self.session.result()

    def _wait(self) -> None:
        until = time.monotonic() + LIMIT
        while not self.session.is_done(timeout=PATIENCE):
            assert time.monotonic() < until, f"hangs: {self.session.feedback()}"


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    folder = tmp_path_factory.mktemp("faults")
    task = folder / "brick.yaml"
    task.write_text(TASK)
    with Graph(folder / "logs") as graph, Session() as session:
        cell = Cell(folder, graph, session)
        parameters = {
            "world": {"task": str(task), "seed": 0, "real_time_factor": 1.0},
            "recorder": {"path": folder / "bag"},
            "supervisor": {"replans": 4},
        }
        for name in ALL_NODES:
            graph.start(name, parameters.get(name))
        wait_until_up(graph, session)
        yield cell
    left = [node for node in graph.nodes.values() if node.process.poll() is None]
    assert not left, "processes are left over"
    assert no_traces(folder / "logs")


def restarted(cell, name: str, starts: int) -> bool:
    """Whether a node that had been started so often was started once more, and runs."""
    until = time.monotonic() + LIMIT
    while cell.graph.nodes[name].starts <= starts:
        assert time.monotonic() < until
        time.sleep(PATIENCE)
    return cell.graph.nodes[name].code is None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "phase"),
    [
        ("waypoint_planner", "waypoints"),
        ("contact_proposer", "contacts"),
        ("komo_optimiser", "motion"),
        ("recorder", "waypoints"),
        ("perception", "waypoints"),
    ],
)
def test_a_node_that_is_killed_while_a_plan_is_made_costs_only_time(cell, name, phase):
    wait_until_up(cell.graph, cell.session)
    starts = cell.graph.nodes[name].starts
    result = cell.goal(phase, lambda: cell.kill(name), plan_only=True)
    assert result.success, result.error
    assert restarted(cell, name, starts)
    cell.graph.check()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["waypoint_planner", "contact_proposer", "komo_optimiser", "recorder", "perception"])
def test_a_node_that_is_killed_while_an_arm_moves_does_not_end_the_run(cell, name):
    starts = cell.graph.nodes[name].starts
    result = cell.goal_while_moving(lambda: cell.kill(name))
    assert result.success, result.error
    assert result.executed and restarted(cell, name, starts)
    cell.graph.check()


# the operator


def rest_after(cell, began: float) -> float:
    """Seconds after a time (of the steady clock) at which the arm has come to rest, once it stands for a second."""
    until = time.monotonic() + STOPPED
    while time.monotonic() < until:
        late = [(at, q) for at, q in list(cell.joints) if at > began]
        moved = [
            at for (at, q), (_, before) in zip(late[1:], late[:-1], strict=True) if np.abs(q - before).max() > STEP
        ]
        last = moved[-1] if moved else began
        if late and late[-1][0] - last > 1.0:
            return last - began
        time.sleep(PATIENCE)
    raise AssertionError("the arm does not come to rest")


@pytest.mark.slow
def test_an_operator_pauses_slows_and_stops_the_arm(cell):
    operator, rests = OperatorClient(cell.session.node), []

    def pause_slow_and_go_on() -> None:
        began = time.monotonic()
        assert operator.call("pause")[0]
        rests.append(rest_after(cell, began))
        assert cell.session.feedback().phase == "paused"
        operator.scale_speed(0.5)
        assert operator.call("resume")[0]

    result = cell.goal_while_moving(pause_slow_and_go_on)
    assert result.success and result.executed, result.error
    operator.scale_speed(float("nan"))  # named, and nothing changes

    def stop() -> None:
        began = time.monotonic()
        assert operator.call("stop")[0]
        rests.append(rest_after(cell, began))

    result = cell.goal_while_moving(stop)
    assert result.error.code is Code.CANCELED and result.executed
    assert "speed_scaling = nan: it has to be above 0" in cell.graph.nodes["supervisor"].log.read_text()
    operator.scale_speed(1.0)
    assert operator.call("resume") == (False, "nothing is paused")
    assert not operator.call("stop")[0] and not operator.call("confirm")[0]
    print("seconds to rest:", rests)
    assert max(rests) < STOPPED


MISSED = """
import sys
from hmap.nodes import supervisor
supervisor.runs_already = lambda role: False
sys.exit(supervisor.main())
"""


@pytest.mark.slow
@pytest.mark.parametrize("start", [("-m", "hmap.nodes.supervisor"), ("-c", MISSED)], ids=["found", "found late"])
def test_a_second_supervisor_is_refused(cell, start):
    done = subprocess.run([sys.executable, *start], capture_output=True, text=True, timeout=LIMIT)
    assert done.returncode == 2
    assert "another supervisor runs on this cell already" in done.stderr and "Traceback" not in done.stderr
    assert cell.goal(plan_only=True).success, "the first supervisor works on"


@pytest.mark.slow
def test_nothing_moves_on_without_the_supervisor_and_its_end_is_named(cell):
    """After those that need it."""
    killed = []

    def kill() -> None:
        cell.kill("supervisor")
        killed.append(time.monotonic())

    result = cell.goal_while_moving(kill)
    assert result.error.code is Code.NODE_LOST and "supervisor" in result.error.reason
    time.sleep(1.5 * STOPPED)
    late = [q for at, q in cell.joints if at > killed[0] + STOPPED]
    assert len(late) > 5 and np.ptp(late, axis=0).max() < STILL
    assert "the supervisor has died; stopped: arm" in cell.graph.nodes["world"].log.read_text()
    with pytest.raises(ExecutionError, match="the node supervisor ended with exit code -9") as error:
        cell.graph.check()
    assert error.value.code is Code.NODE_LOST


def children(pid: int) -> dict[str, int]:
    """The processes that a process has started, by name."""
    found = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return {Path(f"/proc/{child}/comm").read_text().strip(): int(child) for child in found}


@pytest.mark.slow
def test_up_ends_with_the_name_of_the_world_that_died_and_leaves_nothing_behind(tmp_path):
    command = [str(Path(sys.executable).with_name("hmap")), "up", "published/bolt", "--out", str(tmp_path)]
    up = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    lines = []
    for line in up.stderr:
        lines.append(line)
        if "] up" in line:
            break
    nodes = children(up.pid)
    os.kill(nodes["world"], signal.SIGKILL)
    _, rest = up.communicate(timeout=LIMIT)
    text = "".join(lines) + rest
    assert up.returncode == 1 and "execution/NODE_LOST" in text and "the node world ended with exit code -9" in text
    assert "Traceback" not in text
    time.sleep(0.5)
    assert not [name for name, pid in nodes.items() if os.path.exists(f"/proc/{pid}")]
