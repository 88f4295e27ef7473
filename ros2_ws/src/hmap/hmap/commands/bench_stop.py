"""``hmap bench graph --stop``: how long arms move on after the supervisor is killed, and after pause and stop."""

import os
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np

from hmap.launcher.processes import Graph
from hmap_core.exceptions import Code, ExecutionError

if TYPE_CHECKING:  # slow to import
    from hmap.session import Session

NODES = ("perception", "waypoint_planner", "contact_proposer", "komo_optimiser")
KINDS = {
    "killed": "supervisor killed (SIGKILL)",
    "stop": "service supervisor/stop",
    "pause": "service supervisor/pause",
}
RATE = 100.0  # Hz of joint states: what is measured is known to 0.01 s
FAST = 0.2  # rad/s; the supervisor is killed while a joint is faster
LOOK = 0.1  # s in which speeds are measured
STILL = 1e-3  # rad from where an arm comes to rest; nearer, it rests
WATCH = 2.5  # s for which joints are watched afterwards
UP_LIMIT, GOAL_LIMIT = 180.0, 120.0  # s on a busy machine
POLL = 0.005  # s
GONE = (Code.NODE_LOST, Code.SERVICE_UNAVAILABLE)  # of a goal that went to a supervisor that had been killed
Samples = list[tuple[float, np.ndarray]]  # s of the steady clock, and rad


def measured(task: str, seed: int, repeats: int) -> dict[str, dict[str, Any]]:
    """Kind -> how long (s) arms moved on in each repeat, and how fast (rad/s) the fastest joint was before.

    Args:
        task, seed: that is executed in real time.
        repeats: of each kind.

    Raises:
        HmapError: no arm moves in time, or the task is not planned.
    """
    from sensor_msgs.msg import JointState

    from hmap.operator_client import OperatorClient
    from hmap.session import Session

    found: dict[str, dict[str, list[float]]] = {kind: {"rest_s": [], "speed_rad_s": []} for kind in KINDS}
    joints: Samples = []
    with tempfile.TemporaryDirectory() as folder, Graph(Path(folder) / "logs") as graph, Session() as session:
        operator = OperatorClient(session.node)
        note = lambda message: joints.append((time.monotonic(), np.array(message.position)))  # noqa: E731
        session.node.create_subscription(JointState, "joint_states", note, 100)
        graph.start("world", {"task": task, "seed": seed, "real_time_factor": 1.0, "joint_state_rate": RATE})
        for name in (*NODES, "supervisor"):
            graph.start(name)
        session.wait_until_ready(UP_LIMIT)
        for _ in range(repeats):
            for kind in KINDS:
                rest, speed = _once(session, joints, _action(kind, graph, operator.call))
                found[kind]["rest_s"].append(rest)
                found[kind]["speed_rad_s"].append(speed)
                if kind == "killed":
                    graph.start("supervisor")
                    session.wait_until_ready(UP_LIMIT)
                if kind == "pause":
                    operator.call("stop")
                    operator.call("resume")
                session.reset(GOAL_LIMIT)
                session.wait_until_ready(UP_LIMIT)
    return found


def lines(found: dict[str, dict[str, Any]]) -> list[str]:
    """What :func:`measured` has found, as a table."""
    head = f"{'s until all arms rest':<32}{'median':>8}{'most':>8}{'rad/s before':>14}{'n':>4}"
    rows = [
        f"{text:<32}{median(found[kind]['rest_s']):8.2f}{max(found[kind]['rest_s']):8.2f}"
        f"{median(found[kind]['speed_rad_s']):14.2f}{len(found[kind]['rest_s']):4d}"
        for kind, text in KINDS.items()
    ]
    return [head, *rows]


def _action(kind: str, graph: Graph, call: Callable[[str], Any]) -> Callable[[], None]:
    """What stops the arms; it returns at once."""
    if kind != "killed":
        return threading.Thread(target=call, args=(kind,), daemon=True).start
    process = graph.nodes["supervisor"].process
    assert process is not None, "it was started"
    return lambda: os.killpg(process.pid, signal.SIGKILL)


def _once(session: "Session", joints: Samples, act: Callable[[], None]) -> tuple[float, float]:
    """Execute a task until an arm is fast, and act; seconds until arms rest, and the speed before."""
    joints.clear()
    session.manipulate()
    until = time.monotonic() + GOAL_LIMIT
    while (speed := fastest(joints)) < FAST:
        if session.is_done(POLL):
            error = session.result().error
            if error is None or error.code not in GONE:
                session.result().check()
            time.sleep(LOOK)  # the supervisor that was killed; the new one is not known yet
            session.manipulate()
        if time.monotonic() > until:
            raise ExecutionError(f"no arm has moved within {GOAL_LIMIT:g} s")
    began = time.monotonic()
    act()
    time.sleep(WATCH)
    return rest_after(list(joints), began), speed


def fastest(joints: Samples) -> float:
    """The speed (rad/s) of the fastest joint over the last LOOK seconds."""
    recent = [entry for entry in joints[-int(2.0 * RATE * LOOK) :] if entry[0] > time.monotonic() - LOOK]
    if len(recent) < 2:
        return 0.0
    (begin, first), (end, last) = recent[0], recent[-1]
    return float(np.abs(last - first).max() / max(end - begin, LOOK / 2.0))


def rest_after(joints: Sequence[tuple[float, np.ndarray]], began: float) -> float:
    """Seconds after a time until all joints are within STILL of where they come to rest."""
    last = joints[-1][1]
    moving = [at for at, q in joints if np.abs(q - last).max() > STILL]
    return max(0.0, max(moving, default=began) - began)
