"""What callers of the Python interface give is checked where it comes in, and refused with its value."""

import numpy as np
import pytest

from hmap_core import planner
from hmap_core.arguments import checked_pose
from hmap_core.exceptions import Code, InputError, PlannerError
from hmap_core.scenes import load_scene
from hmap_core.types import Scene


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene("published/bolt", 0)


PLANS = {
    "seed": [(-1, "seed = -1: must be"), (1.5, "seed = 1.5: must"), ("a", "seed = 'a': must"), (True, "seed = True")],
    "time_limit": [
        (float("nan"), "time_limit = nan: must be a number of seconds"),
        ("5", "time_limit = '5': must be"),
        ([5.0], r"time_limit = \[5.0\]: must be"),
    ],
}


@pytest.mark.parametrize("call", ["plan", "plan_motion"])
@pytest.mark.parametrize(("name", "value", "says"), [(name, *case) for name, cases in PLANS.items() for case in cases])
def test_a_seed_and_a_time_limit_are_numbers(scene, call, name, value, says):
    goal = {"q": scene.robots["panda"].q, "robot": "panda"} if call == "plan_motion" else {}
    with pytest.raises(InputError, match=says):
        getattr(planner, call)(scene, **goal, **{name: value})


def test_no_time_is_a_time_limit(scene):
    with pytest.raises(PlannerError) as error:
        planner.plan(scene, time_limit=-1)
    assert error.value.code == Code.TIME_LIMIT


MOTIONS = {
    "words": ({"q": ["a"] * 7}, r"goal of 'panda' is \['a', .*; needed: 7 finite joint positions"),
    "columns": ({"q": np.zeros((7, 1))}, "goal of 'panda' is .*; needed: 7 finite"),
    "ragged": ({"T_world_ee": [[0.3, 0, 0.3], [0, 0, 0, 1]]}, "T_world_ee is .*; needed: x, y, z and a unit"),
    "word": ({"T_world_ee": "x"}, "T_world_ee is 'x'; needed"),
    "long": ({"T_world_ee": [0.5] * 1000}, r"T_world_ee is \[0.5, .*\.\.\.; needed"),
}


@pytest.mark.parametrize("kind", MOTIONS)
def test_goals_of_motions_are_numbers(scene, kind):
    goal, says = MOTIONS[kind]
    with pytest.raises(InputError, match=says):
        planner.plan_motion(scene, "panda", **goal)


STATES = {
    "no quaternion": (
        lambda s: s.poses.update(lock=np.zeros(7)),
        r"start pose of 'lock' is \[0.0, .*; needed: x, y, z",
    ),
    "no poses": (lambda s: s.poses.update(lock=None), "start pose of 'lock' is None; needed: x, y, z"),
    "no joints": (lambda s: s.q.update(panda=None), "start of 'panda' is None; needed: 7 finite"),
    "no opening": (lambda s: s.gripper.update(panda=None), "gripper of 'panda' is None; needed: a number"),
    "NaN": (lambda s: s.gripper.update(panda=float("nan")), "'panda' has its fingers nan m apart"),
}


@pytest.mark.parametrize("kind", STATES)
def test_states_are_numbers(scene, kind):
    change, says = STATES[kind]
    state = scene.start_state()
    change(state)
    for call, goal in ((planner.plan, {}), (planner.plan_motion, {"robot": "panda", "q": scene.robots["panda"].q})):
        with pytest.raises(InputError, match=says):
            call(scene, state=state, **goal)


def test_a_pose_may_be_rounded():
    np.testing.assert_array_equal(checked_pose([1, 2, 3, 0, 0, 0.7071, 0.7071], "it")[:3], [1, 2, 3])
