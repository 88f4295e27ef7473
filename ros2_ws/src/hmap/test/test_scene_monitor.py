"""What is compared with a plan is where everything stands after a motion, not what was last heard of before its end."""

import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from hmap.conversions import cloud_to_message, scene_to_message, state_to_message
from hmap.supervision.ports import ros_ports
from hmap.supervision.scene_monitor import REST_PERIOD, SceneMonitor
from hmap_core.contacts.camera import Cloud
from hmap_core.exceptions import Code, ExecutionError, InputError, PlannerError
from hmap_core.execution.drift import DriftTolerance
from hmap_core.execution.watcher import LOST_POSITION, Watcher
from hmap_core.scenes import load_scene
from hmap_core.simulation.dynamic import sphere
from hmap_core.types import Plan, Segment, SegmentKind, Trajectory
from hmap_msgs.msg import BodyArray, ObjectClouds
from hmap_msgs_py.bodies import body_to_message
from hmap_msgs_py.checks import ConversionError
from hmap_msgs_py.times import time_to_message

OBJECT = "bar"
FAR = 2.0 * LOST_POSITION
PATIENCE = 30.0  # s on a busy machine
NO_PATIENCE = 0.2  # s


class FakeNode:
    """Hands messages to the scene_monitor, and has a clock that stands."""

    def __init__(self, seconds: float):
        self.callbacks = {}
        self.stopping = threading.Event()
        self.seconds = seconds

    def subscribe(self, kind, topic, callback, qos=None):
        self.callbacks[topic] = callback

    def get_clock(self):
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=round(self.seconds * 1e9)))


@pytest.fixture(scope="module")
def scene():
    return load_scene("tunnel", 0)


def monitor_at(scene, seconds: float):
    """An scene_monitor whose clock stands, and a function that tells it where the object is along x."""
    node = FakeNode(seconds)
    scene_monitor = SceneMonitor(node, stale_after=PATIENCE)
    node.callbacks["scene"](scene_to_message(scene))

    def tell(stamp: float, shift: float) -> None:
        state = scene.start_state()
        state.poses[OBJECT] = state.poses[OBJECT] + np.eye(7)[0] * shift
        node.callbacks["world_state"](state_to_message(scene, state, time_to_message(stamp)))

    return scene_monitor, tell


def tell_later(scene_monitor, tell, states) -> threading.Thread:
    """Tells the next state whenever the scene_monitor waits for one."""

    def run() -> None:
        for stamp, shift in states:
            threading.Event().wait(0.05)
            tell(stamp, shift)

    thread = threading.Thread(target=run)
    thread.start()
    return thread


def x(scene, state) -> float:
    return float(state.poses[OBJECT][0] - scene.bodies[OBJECT].pose[0])


def test_settled_waits_for_a_state_of_after_now_in_which_nothing_moves(scene):
    scene_monitor, tell = monitor_at(scene, 2.0)
    tell(1.9, 0.0)
    step = 1.1 * REST_PERIOD
    moving = [(2.0 + step, 0.05), (2.0 + 2 * step, 0.08), (2.0 + 3 * step, 0.1), (2.0 + 4 * step, 0.1)]
    thread = tell_later(scene_monitor, tell, moving)
    assert x(scene, scene_monitor.settled(PATIENCE)) == pytest.approx(0.1)
    thread.join()


def test_settled_does_not_make_do_with_what_it_knows(scene):
    scene_monitor, tell = monitor_at(scene, 2.0)
    tell(1.9, 0.0)
    with pytest.raises(InputError) as caught:
        scene_monitor.settled(NO_PATIENCE)
    assert caught.value.code is Code.STALE_STATE


def watcher_of(scene, scene_monitor, planned: float) -> Watcher:
    pose = scene.bodies[OBJECT].pose + np.eye(7)[0] * planned
    trajectory = SimpleNamespace(objects={OBJECT: np.array([pose])}, time=np.zeros(1))
    plan = SimpleNamespace(scene=scene, trajectory=trajectory)
    return Watcher(plan, ros_ports(None, scene_monitor, PATIENCE))


def test_a_state_of_before_the_end_of_a_stretch_does_not_mean_that_the_object_is_lost(scene):
    scene_monitor, tell = monitor_at(scene, 2.0)
    tell(1.9, 0.0)
    thread = tell_later(scene_monitor, tell, [(2.1, FAR), (2.1 + 1.1 * REST_PERIOD, FAR)])
    watcher_of(scene, scene_monitor, FAR).check_lost(0)
    thread.join()


def test_an_object_that_stands_elsewhere_is_lost(scene):
    scene_monitor, tell = monitor_at(scene, 2.0)
    tell(1.9, 0.0)
    thread = tell_later(scene_monitor, tell, [(2.1, 0.0), (2.1 + 1.1 * REST_PERIOD, 0.0)])
    watcher = watcher_of(scene, scene_monitor, FAR)
    with pytest.raises(ExecutionError, match=OBJECT) as caught:
        watcher.check_lost(0)
    assert caught.value.code is Code.OBJECT_DROPPED
    thread.join()


def new_object(*bodies) -> BodyArray:
    return BodyArray(bodies=[body_to_message(body) for body in bodies])


def test_what_only_the_cameras_have_seen_is_in_the_scene_and_in_the_state(scene):
    scene_monitor, tell = monitor_at(scene, 2.0)
    tell(2.1, 0.0)
    heard = threading.Event()
    scene_monitor.on_change(heard.set)
    before = scene_monitor.changed()
    ball = sphere("ball", 0.03, np.array([0.1, 0.2, 0.3]))
    scene_monitor._node.callbacks["new_object"](new_object(ball))
    assert heard.is_set() and scene_monitor.changed() > before
    assert scene_monitor.wait_for_change(before, NO_PATIENCE, lambda: False)
    assert set(scene_monitor.scene().bodies) == {*scene.bodies, "ball"}
    _, state = scene_monitor.state(NO_PATIENCE)  # that of before is still good
    assert np.allclose(state.poses["ball"], ball.pose)
    tell(2.2, 0.01)
    assert np.allclose(scene_monitor.state(NO_PATIENCE)[1].poses["ball"], ball.pose)
    scene_monitor._node.callbacks["new_object"](new_object())
    assert set(scene_monitor.scene().bodies) == set(scene.bodies)
    assert "ball" not in scene_monitor.state(NO_PATIENCE)[1].poses


def test_a_scene_that_is_reset_to_its_start_leaves_no_state(scene):
    scene_monitor, tell = monitor_at(scene, 2.0)
    tell(2.1, 0.0)
    scene_monitor._node.callbacks["scene"](scene_to_message(scene))
    with pytest.raises(InputError):
        scene_monitor.state(NO_PATIENCE)


def test_waiting_for_a_change_ends_when_it_is_canceled(scene):
    scene_monitor, _ = monitor_at(scene, 2.0)
    assert not scene_monitor.wait_for_change(scene_monitor.changed(), PATIENCE, lambda: True)


@pytest.mark.parametrize(("shift", "expected"), [(0.009, None), (0.011, "11.0 mm")])
def test_what_is_off_the_plan_between_two_contacts_is_told(scene, shift, expected):
    scene_monitor, tell = monitor_at(scene, 2.0)
    thread = tell_later(scene_monitor, tell, [(2.1, shift), (2.1 + 1.1 * REST_PERIOD, shift)])
    tell(1.9, shift)
    trajectory = Trajectory(
        np.zeros(1),
        {name: robot.q[None] for name, robot in scene.robots.items()},
        {name: np.zeros(1) for name in scene.robots},
        {OBJECT: scene.bodies[OBJECT].pose[None]},
    )
    to_come = Segment(0.0, 1.0, "panda_1", "panda_hand", OBJECT, SegmentKind.PUSH)
    plan = Plan(scene, trajectory, (to_come,), np.zeros((0, 7)), {})
    watcher = Watcher(plan, ros_ports(None, scene_monitor, PATIENCE))
    if expected is None:
        watcher.check_drift(0, DriftTolerance())
    else:
        with pytest.raises(ExecutionError, match=f"{OBJECT}.*{expected}") as caught:
            watcher.check_drift(0, DriftTolerance())
        assert caught.value.code is Code.GOAL_MISSED
    thread.join()


def test_clouds_are_decoded_once_asked_for_and_sent_on_as_they_came(scene):
    node = FakeNode(0.0)
    warned = []
    node.get_logger = lambda: SimpleNamespace(warning=warned.append)
    scene_monitor = SceneMonitor(node, stale_after=PATIENCE)
    node.callbacks["scene"](scene_to_message(scene))
    points = np.array([[0.0, 0.0, 0.1], [0.0, 0.1, 0.1]])
    cloud = Cloud(points, np.tile([0.0, 0.0, 1.0], (2, 1)), np.ones(2, bool))
    good = cloud_to_message(OBJECT, scene.bodies[OBJECT].pose, cloud)
    broken = cloud_to_message("other", scene.bodies[OBJECT].pose, cloud)
    broken.cloud.data = broken.cloud.data[:-3]
    node.callbacks["object_clouds"](ObjectClouds(clouds=[good, broken]))
    found = scene_monitor.clouds()
    assert found.keys() == {OBJECT} and len(warned) == 1
    np.testing.assert_allclose(found[OBJECT].points, points, atol=1e-6)
    assert cloud_to_message(OBJECT, scene.bodies[OBJECT].pose, found[OBJECT]) is good
    assert scene_monitor.clouds()[OBJECT] is found[OBJECT]


def test_older_state_that_arrives_later_replaces_nothing(scene):
    scene_monitor, tell = monitor_at(scene, 2.0)
    tell(1.9, 0.01)
    tell(1.8, 0.5)
    stamp, state = scene_monitor.state(NO_PATIENCE)
    assert stamp == pytest.approx(1.9) and x(scene, state) == pytest.approx(0.01)


def test_state_of_an_hour_ahead_counts_neither_now_nor_later(scene):
    scene_monitor, tell = monitor_at(scene, 2.0)
    with pytest.raises(ConversionError, match="world state is stamped 3600.00 s ahead"):
        tell(3602.0, 0.5)
    with pytest.raises(InputError):
        scene_monitor.state(NO_PATIENCE)
    tell(1.9, 0.0)
    assert scene_monitor.state(NO_PATIENCE)[0] == pytest.approx(1.9)


def test_simulation_that_is_started_anew_is_followed(scene):
    scene_monitor, tell = monitor_at(scene, 500.0)
    tell(499.9, 0.3)
    tell(0.1, 0.02)  # arrives before the clock is known to have jumped back
    scene_monitor._node.seconds = 0.2
    assert scene_monitor.state(NO_PATIENCE)[0] == pytest.approx(0.1)
    tell(0.3, 0.04)
    assert x(scene, scene_monitor.state(NO_PATIENCE)[1]) == pytest.approx(0.04)


def test_one_bad_body_does_not_hide_the_others(scene):
    scene_monitor, _ = monitor_at(scene, 2.0)
    good, bad = (sphere(name, 0.03, np.array([0.1, 0.2, 0.3])) for name in ("good", "bad"))
    message = new_object(good, bad, good)
    message.bodies[1].pose.orientation.w = 0.0
    problems = scene_monitor._node.callbacks["new_object"](message)
    assert set(scene_monitor.scene().bodies) == {*scene.bodies, "good"}
    assert len(problems) == 2 and "'bad'" in problems[0] and "'good'" in problems[1]


def test_other_frames_than_the_world_are_refused(scene):
    scene_monitor, _ = monitor_at(scene, 2.0)
    message = new_object()
    message.header.frame_id = "camera"
    with pytest.raises(ConversionError, match="frame 'camera'"):
        scene_monitor._node.callbacks["new_object"](message)


def test_older_clouds_replace_nothing(scene):
    scene_monitor, _ = monitor_at(scene, 2.0)
    cloud = Cloud(np.zeros((2, 3)), np.tile([0.0, 0.0, 1.0], (2, 1)), np.ones(2, bool))
    for stamp, names in ((1.9, (OBJECT, "new")), (1.8, (OBJECT, "old"))):
        message = ObjectClouds(clouds=[cloud_to_message(name, scene.bodies[OBJECT].pose, cloud) for name in names])
        message.header.stamp = time_to_message(stamp)
        scene_monitor._node.callbacks["object_clouds"](message)
    assert set(scene_monitor.clouds()) == {OBJECT, "new"}
    message.header.stamp = time_to_message(3600.0)
    with pytest.raises(ConversionError, match="clouds is stamped 3598.00 s ahead"):
        scene_monitor._node.callbacks["object_clouds"](message)


@pytest.mark.parametrize(("died", "stale_after"), [(False, 0.01), (True, 0.01), (True, PATIENCE)])
def test_a_clock_that_stands_excuses_silence_unless_who_publishes_it_has_died(scene, died, stale_after):
    node = FakeNode(2.0)
    scene_monitor = SceneMonitor(node, stale_after, clock_died=lambda: died)
    node.callbacks["scene"](scene_to_message(scene))
    node.callbacks["world_state"](state_to_message(scene, scene.start_state(), time_to_message(1.9)))
    time.sleep(0.05)
    assert scene_monitor.silent() is died


def test_a_cancel_ends_the_waiting_for_a_state_and_for_a_scene(scene):
    scene_monitor, _ = monitor_at(scene, 2.0)
    for wait in (
        lambda: scene_monitor.settled(PATIENCE, lambda: True),
        lambda: scene_monitor.wait_for_scene("bolt", 0, PATIENCE, lambda: True),
    ):
        with pytest.raises(PlannerError) as caught:
            wait()
        assert caught.value.code is Code.CANCELED


def test_what_the_cameras_have_seen_counts_also_where_it_comes_before_the_scene(scene):
    node = FakeNode(2.0)
    scene_monitor = SceneMonitor(node, stale_after=PATIENCE)
    cloud = Cloud(np.zeros((2, 3)), np.tile([0.0, 0.0, 1.0], (2, 1)), np.ones(2, bool))
    seen = ObjectClouds(clouds=[cloud_to_message(OBJECT, scene.bodies[OBJECT].pose, cloud)])
    node.callbacks["object_clouds"](seen)
    node.callbacks["new_object"](new_object(sphere("ball", 0.03, np.array([0.1, 0.2, 0.3]))))
    node.callbacks["scene"](scene_to_message(scene))
    assert scene_monitor.clouds().keys() == {OBJECT} and set(scene_monitor.scene().bodies) == {*scene.bodies, "ball"}
    other = load_scene("published/bookshelf_mini", 0)
    node.callbacks["scene"](scene_to_message(other))
    assert scene_monitor.clouds() == {} and set(scene_monitor.scene().bodies) == set(other.bodies)
