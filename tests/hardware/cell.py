"""A cell of stand-ins of drivers and the nodes for real robots, for the tests and for runs by hand."""

import argparse
import os
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from hmap.commands.cell import start
from hmap.environment import ros_environment
from hmap.launcher.cell import read_cell
from hmap.launcher.processes import Graph
from hmap.operator_client import OperatorClient
from hmap.session import Session

DRIVERS = Path(__file__).with_name("drivers.py")
NODES = ("perception", "supervisor", "komo_optimiser", "contact_proposer", "waypoint_planner")
UP_LIMIT, GOAL_LIMIT = 180.0, 300.0  # s on a busy machine
POLL = 0.1  # s
STEP = 5e-4  # rad that an arm which stands is measured to move


class StandInCell:
    """The graph, a session with it, and the switch for faults.

    Attributes:
        graph: the nodes.
        session: with them.
        operator: confirms motions.
        joints: time (s of the steady clock) and positions of all joint states.
    """

    def __init__(self, graph: Graph, session: Session):
        self.graph, self.session = graph, session
        self.operator = OperatorClient(session.node)
        self.joints: list[tuple[float, np.ndarray]] = []
        self._fault = session.node.create_publisher(String, "fault", 10)
        session.node.create_subscription(JointState, "joint_states", self._note, qos_profile_sensor_data)

    def _note(self, message: JointState) -> None:
        self.joints.append((time.monotonic(), np.array(message.position)))

    def fault(self, name: str) -> None:
        """Begin a fault of ``drivers.py``; ``clear`` ends all."""
        self._fault.publish(String(data=name))

    def moved_after(self, began: float) -> float:
        """How far (rad) a joint has moved since a time (s of the steady clock)."""
        rows = [q for at, q in self.joints if at > began and np.isfinite(q).all()]
        return float(np.ptp(rows, axis=0).max()) if rows else 0.0

    def goal(self, when: str = "", then=lambda: None, **fields):
        """The result of a goal, whose motion is confirmed; what is done once it is in a phase."""
        done = threading.Event()

        def look(feedback) -> None:
            if feedback.phase == "confirming":
                threading.Thread(target=self.operator.call, args=("confirm",)).start()
            if feedback.phase == when and not done.is_set():
                done.set()
                threading.Thread(target=then).start()

        self.session.manipulate(on_feedback=look, time_limit=120.0, **fields)
        until = time.monotonic() + GOAL_LIMIT
        while not self.session.is_done(timeout=POLL):
            assert time.monotonic() < until, f"hangs: {self.session.feedback()}"
        return self.session.result()

    def wait_until_measuring(self) -> None:
        """Until perception measures everything."""
        until = time.monotonic() + UP_LIMIT
        while len(up := self.session.ready(NODES)) < len(NODES):
            self.graph.check()
            assert time.monotonic() < until, f"only {up} are up"
            time.sleep(POLL)


@contextmanager
def stand_in_cell(
    task: str,
    drivers: list[str],
    folder: Path,
    names: dict[str, str],
    record: bool = False,
    composed: bool = False,
    **supervisor,
):
    """A running cell.

    Args:
        task: name or file of the task.
        drivers: whose parameter files are used.
        folder: for logs, the cell file and the bag.
        names: further parameters of all nodes and of the stand-ins.
        record: whether a bag is written.
        composed: whether supervisor and planners share one process.
        supervisor: parameters of it.
    """
    from ruamel.yaml import YAML

    content = {"task": task, "drivers": drivers, "record": record}
    content["parameters"] = {"perception": dict(names), "supervisor": dict(names) | supervisor}
    file = folder / "cell.yaml"
    with file.open("w") as out:
        YAML(typ="safe").dump(content, out)
    cell = read_cell(file)
    arguments = [word for path in cell.files for word in ("--params-file", str(path))]
    arguments += [word for key, value in (names | {"task": cell.task}).items() for word in ("-p", f"{key}:={value}")]
    log = (folder / "drivers.log").open("wb")
    process = subprocess.Popen(
        [sys.executable, str(DRIVERS), "--ros-args", *arguments],
        stdout=log,
        stderr=log,
        env=ros_environment(os.environ),
    )
    try:
        with Graph(folder / "logs") as graph, Session() as session:
            start(graph, cell, folder, one_process=composed)
            found = StandInCell(graph, session)
            found.wait_until_measuring()
            yield found
    finally:
        process.terminate()
        process.wait(30.0)
        log.close()


def main() -> int:
    """Solve the tunnel some times, with two arms; prints how often."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("runs", type=int, nargs="?", default=5)
    parser.add_argument("--composed", action="store_true", help="supervisor and planners in one process")
    parser.add_argument("--out", type=Path, help="keep logs and bags in this folder")
    arguments, solved = parser.parse_args(), 0
    with tempfile.TemporaryDirectory() as folder:
        for k in range(arguments.runs):
            place = (arguments.out or Path(folder)) / str(k)
            place.mkdir(parents=True)
            names = {"names.body_pose": "vrpn_mocap/{body}/pose", "gripper_position": "gap"}
            drivers, recorded = ["ros2_control", "vrpn_mocap"], arguments.out is not None
            with stand_in_cell("tunnel", drivers, place, names, recorded, arguments.composed) as cell:
                result = cell.goal()
                solved += result.success
                print(f"run {k}: {'solved' if result.success else result.error}", flush=True)
    print(f"{solved} of {arguments.runs} solved")
    return 0 if solved == arguments.runs else 1


if __name__ == "__main__":
    os.environ["ROS_DOMAIN_ID"] = str(100 + os.getpid() % 20)
    sys.exit(main())
