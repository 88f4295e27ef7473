"""The thread of the simulated world: commands, cancel, preemption, bodies."""

import numpy as np
import pytest

from hmap.world.loop import WorldLoop
from hmap_core import transforms
from hmap_core.exceptions import Code, HmapError, InputError
from hmap_core.scenes import load_scene
from hmap_core.simulation.controllers import Outcome, Tolerances
from hmap_core.types import Body, BodyKind, JointTrajectory, Shape, ShapeKind

WAIT = 60.0  # s of real time, on a busy machine
ROBOT = "panda_1"


@pytest.fixture(scope="module")
def scene():
    return load_scene("tunnel", 0)


@pytest.fixture
def loop(scene):
    loop = WorldLoop(scene, speed=0.0, idle_speed=1.0, on_chunk=lambda world: None)
    loop.start()
    yield loop
    loop.stop()


@pytest.fixture
def paced(scene):
    """A loop in real time, in which a motion lasts."""
    loop = WorldLoop(scene, speed=1.0, idle_speed=1.0, on_chunk=lambda world: None)
    loop.start()
    yield loop
    loop.stop()


def swing(scene, duration: float, angle: float = 0.3) -> JointTrajectory:
    q = scene.robots[ROBOT].q
    target = q + angle * np.eye(7)[0]
    return JointTrajectory(scene.robots[ROBOT].model.joint_names, np.array([0.0, duration]), np.array([q, target]),
                           np.zeros((2, 7)))  # fmt: skip


def cube(name: str) -> Body:
    shape = Shape(ShapeKind.BOX, (0.05, 0.05, 0.05))
    return Body(name, BodyKind.MOVABLE, (shape,), transforms.pose((0.5, 0.5, 0.075)), 0.1)


def test_a_trajectory_is_followed_to_its_end(loop, scene):
    motion = loop.follow(ROBOT, swing(scene, 1.0), Tolerances())
    assert motion.done.wait(WAIT)
    assert motion.outcome is Outcome.SUCCEEDED
    q = loop.call(lambda: loop.world.state().q[ROBOT])
    assert q[0] - scene.robots[ROBOT].q[0] == pytest.approx(0.3, abs=0.01)


def test_a_cancel_brings_the_arm_to_rest(loop, scene):
    motion = loop.follow(ROBOT, swing(scene, 1000.0), Tolerances())
    loop.cancel_arm(ROBOT)
    assert motion.done.wait(WAIT)
    assert motion.outcome is Outcome.CANCELED


def test_a_new_trajectory_takes_the_place_of_the_old(loop, scene):
    first = loop.follow(ROBOT, swing(scene, 1000.0), Tolerances())
    second = loop.follow(ROBOT, swing(scene, 1.0), Tolerances())
    assert first.done.is_set() and first.outcome is Outcome.PREEMPTED
    assert second.done.wait(WAIT) and second.outcome is Outcome.SUCCEEDED


def test_a_trajectory_with_a_start_is_taken_up_in_its_middle(loop, scene):
    first = loop.follow(ROBOT, swing(scene, 1000.0), Tolerances())
    began = loop.call(lambda: loop.world.time)
    slower = swing(scene, 1000.0)
    second = loop.follow(ROBOT, slower, Tolerances(), began)
    assert first.outcome is Outcome.PREEMPTED and not second.done.is_set()
    with pytest.raises(InputError, match="ago"):
        loop.follow(ROBOT, slower, Tolerances(), began - 2000.0)
    assert not second.done.is_set()


def test_the_scene_without_what_was_added(loop, scene):
    loop.call(lambda: loop.add(cube("cube")))
    assert set(loop.scene_without_added().bodies) == set(scene.bodies)
    assert set(loop.scene.bodies) == {*scene.bodies, "cube"}


def test_a_wrong_trajectory_is_refused_and_the_old_one_goes_on(loop, scene):
    first = loop.follow(ROBOT, swing(scene, 1000.0), Tolerances())
    with pytest.raises(InputError):
        loop.follow(ROBOT, swing(scene, 1.0, float("nan")), Tolerances())
    assert not first.done.is_set()


def test_a_gripper_reports_what_it_reached(loop):
    motion = loop.grip(ROBOT, 0.03, 20.0)
    assert motion.done.wait(WAIT)
    assert motion.outcome is Outcome.SUCCEEDED
    assert motion.state.opening == pytest.approx(0.03, abs=0.002)


def test_bodies_come_and_go_with_the_scene(loop):
    loop.call(lambda: loop.add(cube("cube")))
    assert "cube" in loop.scene.bodies
    loop.call(lambda: loop.move("cube", transforms.pose((0.6, 0.5, 0.075))))
    assert loop.scene.bodies["cube"].pose[0] == pytest.approx(0.6)
    loop.call(lambda: loop.remove("cube"))
    assert "cube" not in loop.scene.bodies


@pytest.mark.parametrize(
    ("act", "code"),
    [
        (lambda loop: loop.add(cube("bar")), Code.INVALID_SCENE),
        (lambda loop: loop.move("nix", transforms.pose()), Code.UNKNOWN_OBJECT),
        (lambda loop: loop.move("table", transforms.pose()), Code.INVALID_INPUT),
        (lambda loop: loop.remove("bar"), Code.INVALID_INPUT),
    ],
)
def test_what_may_not_be_done_is_refused(loop, act, code):
    before = loop.scene
    with pytest.raises(InputError) as caught:
        loop.call(lambda: act(loop))
    assert caught.value.code is code
    assert loop.scene is before


def test_loading_ends_what_moves(loop, scene):
    motion = loop.follow(ROBOT, swing(scene, 1000.0), Tolerances())
    loop.call(lambda: loop.load(scene))
    assert motion.outcome is Outcome.CANCELED


def test_after_the_end_calls_are_refused(scene):
    loop = WorldLoop(scene, 0.0, 1.0, lambda world: None)
    loop.start()
    motion = loop.follow(ROBOT, swing(scene, 1000.0), Tolerances())
    loop.stop()
    assert motion.done.is_set()
    with pytest.raises(HmapError):
        loop.call(lambda: None)


def test_all_arms_are_stopped_at_once(loop, scene):
    motion = loop.follow(ROBOT, swing(scene, 1000.0), Tolerances())
    assert loop.stop_arms() == [ROBOT]
    assert motion.done.wait(WAIT)
    assert motion.outcome is Outcome.CANCELED and loop.stop_arms() == []


def test_commands_to_robots_of_a_scene_that_was_replaced_are_refused_and_cancels_do_nothing(paced, scene):
    other = load_scene("bolt", 0)
    motion = paced.grip(ROBOT, 0.02, 10.0)
    paced.call(lambda: paced.load(other))
    assert motion.done.wait(WAIT) and motion.outcome is Outcome.CANCELED
    paced.cancel_gripper(ROBOT)
    paced.cancel_arm(ROBOT)
    with pytest.raises(InputError, match=f"robot {ROBOT!r} has no gripper in the loaded scene; there are: ") as error:
        paced.grip(ROBOT, 0.02, 10.0)
    assert error.value.code is Code.UNKNOWN_ROBOT
    with pytest.raises(InputError, match=f"robot {ROBOT!r} has no arm"):
        paced.follow(ROBOT, swing(scene, 1.0), Tolerances())
