"""The world changes while a plan is executed: cameras see it, everything stops, a new plan solves the task."""

import threading

import numpy as np
import pytest
from conftest import NODES, TASK, wait_until_up

from hmap.conversions import plan_from_message
from hmap.launcher.processes import Graph
from hmap.node import LATCHED
from hmap.session import Session
from hmap_core import transforms
from hmap_core.kinematics.arm import load_arm
from hmap_core.planner.conflicts import first_conflict
from hmap_core.planner.interruption import contacts
from hmap_core.scenes import load_scene
from hmap_core.simulation.dynamic import sphere
from hmap_core.trajectory.samples import index_at
from hmap_msgs.msg import BodyArray, Plan
from hmap_msgs_py.bodies import body_from_message

TIME_LIMIT = 240.0  # s for planning on a busy machine
ANSWER_LIMIT = 60.0  # s for a service
PATIENCE = 0.1  # s between two looks at whether the nodes live
RADIUS = 0.03  # m
AHEAD = 1.2  # s of the plan
SPEED = 0.5  # simulated s per s, so that a busy machine sees the obstacle in time
SEEN = 0.005  # m that an estimate may be off


class Case:
    """A graph with the task loaded, and what is heard of it."""

    def __init__(self, graph, session, task: str):
        self.graph, self.session, self.task = graph, session, task
        self.plan, self.seen = None, {}
        node = session.node
        node.create_subscription(Plan, "plan", self._take_plan, LATCHED)
        node.create_subscription(BodyArray, "new_object", self._take_new, LATCHED)

    def _take_plan(self, message) -> None:
        self.plan = plan_from_message(message)

    def _take_new(self, message) -> None:
        self.seen |= {entry.name: body_from_message(entry) for entry in message.bodies}

    def manipulate(self, on_feedback):
        self.session.manipulate(self.task, time_limit=TIME_LIMIT, on_feedback=on_feedback)
        while not self.session.is_done(timeout=PATIENCE):
            self.graph.check()
        return self.session.result()


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    folder = tmp_path_factory.mktemp("dynamic")
    file = folder / "carry.yaml"
    file.write_text(TASK)
    with Graph(folder / "logs") as graph, Session() as session:
        for name in NODES:
            world = {"task": str(file), "seed": 0, "real_time_factor": SPEED, "announce_added": False}
            graph.start(name, world if name == "world" else {})
        wait_until_up(graph, session)
        yield Case(graph, session, load_scene(str(file), 0).task)


def run_with(case, when: str, place):
    """Execute the task, and add an obstacle when a stretch begins whose text holds ``when``; phases and the result."""
    case.session.reset(ANSWER_LIMIT)
    phases, placed = [], []

    def on_feedback(feedback) -> None:
        phases.append(feedback.phase)
        if feedback.phase == "execution" and when in feedback.text and not placed:
            placed.append(place(case.plan, float(feedback.text.split()[0])))
            threading.Thread(target=case.session.add_body, args=(placed[0], ANSWER_LIMIT)).start()

    result = case.manipulate(on_feedback)
    assert placed, (phases, result.error)
    (body,) = placed
    case.session.remove_body(body.name, ANSWER_LIMIT)
    assert result.success, result.error
    return phases, result, body


def in_the_way_of_the_hand(plan, now: float):
    """A sphere where the hand soon comes by, on its way to the object."""
    robot = plan.scene.robots["arm"]
    time = plan.trajectory.time
    made = contacts(plan)[0]
    k = index_at(time, max(now + AHEAD, 0.6 * time[made.begin]))
    tip = load_arm(robot.model).end_effector(plan.trajectory.joints["arm"][k])
    body = sphere("ball_1", RADIUS, transforms.multiply(robot.base_pose, tip)[:3])
    assert first_conflict(plan, {"ball_1": body}, now) is not None
    return body


def in_the_way_of_the_object(plan, now: float):
    """A sphere on the path of the object, which is being carried or pushed."""
    poses = plan.trajectory.objects["brick"]
    k = int(np.abs(poses[:, 1]).argmin())
    body = sphere("ball_2", RADIUS, np.array([*poses[k, :2], RADIUS + 0.005]))
    assert first_conflict(plan, {"ball_2": body}, now) is not None
    return body


@pytest.mark.slow
@pytest.mark.parametrize(("when", "place"), [("transit", in_the_way_of_the_hand), ("brick", in_the_way_of_the_object)])
def test_an_obstacle_that_appears_on_the_way_is_seen_and_gone_round(case, when, place):
    phases, result, body = run_with(case, when, place)
    assert phases.count("stopping") == 1 and "replanning" in phases
    assert phases.index("stopping") < phases.index("replanning") < phases[::-1].index("execution") + len(phases)
    assert result.statistics["blocked"] == 1
    seen = case.seen[body.name]["shapes"][0], case.seen[body.name]["pose"]
    assert seen[0]["kind"] == "sphere" and seen[0]["size"][0] == pytest.approx(RADIUS, abs=SEEN)
    assert np.linalg.norm(seen[1][:3] - body.pose[:3]) < SEEN
    scene = load_scene("tunnel", 0)
    assert result.position_error < scene.execution_tolerance[0]
