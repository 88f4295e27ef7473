"""Poses that jump are named and not used, unless the body stays where it has jumped to; frames come by tf."""

import numpy as np
import pytest
from geometry_msgs.msg import Transform, TransformStamped
from tf2_msgs.msg import TFMessage

from hmap.perception.frames import Frames
from hmap.perception.jumps import STAYS, JumpFilter
from hmap_core import transforms

PERIOD = 0.01  # s


def pose(x: float, yaw: float = 0.0) -> np.ndarray:
    return transforms.pose((x, 0.0, 0.0), (0.0, 0.0, np.sin(0.5 * yaw), np.cos(0.5 * yaw)))


def feed(jumps: JumpFilter, places, start: float = 0.0) -> list[bool]:
    return [jumps.accept("box", start + PERIOD * k, place) for k, place in enumerate(places)]


@pytest.mark.parametrize("other", [pose(0.3), pose(0.0, np.pi / 2)])
def test_a_jump_is_not_used_and_named(other):
    jumps = JumpFilter()
    assert all(feed(jumps, [pose(0.0)] * 10))
    assert not any(feed(jumps, [other] * 5, 1.0))
    assert "the pose of 'box' has jumped by" in jumps.doubt.text
    assert all(feed(jumps, [pose(0.0)] * 5, 1.1)) and jumps.doubt is None


def test_a_body_that_stays_where_it_has_jumped_to_is_believed():
    jumps = JumpFilter()
    feed(jumps, [pose(0.0)] * 10)
    used = feed(jumps, [pose(0.3)] * 100, 1.0)
    assert used.index(True) == pytest.approx(STAYS / PERIOD, abs=1) and all(used[used.index(True) :])


def test_poses_that_jump_to_and_fro_are_never_believed():
    jumps = JumpFilter()
    feed(jumps, [pose(0.0)] * 10)
    assert not any(feed(jumps, [pose(0.5 if k % 2 else 1.0) for k in range(200)], 0.1))


def test_fast_motion_is_no_jump():
    jumps = JumpFilter()
    assert all(feed(jumps, [pose(1.5 * PERIOD * k) for k in range(200)]))
    assert jumps.accept("box", 0.5, pose(5.0))  # comes late, and is sorted elsewhere


def transform(parent: str, child: str, T: np.ndarray) -> TransformStamped:
    entry = TransformStamped(child_frame_id=child, transform=Transform())
    entry.header.frame_id = parent
    t, q = entry.transform.translation, entry.transform.rotation
    t.x, t.y, t.z, q.x, q.y, q.z, q.w = (float(v) for v in T)
    return entry


def test_a_frame_of_motion_capture_comes_to_the_world_by_tf():
    frames = Frames()
    assert frames.to_world("mocap") is None
    a, b = pose(1.0, 0.3), pose(0.5, -1.0)
    assert frames.add(TFMessage(transforms=[transform("room", "mocap", b), transform("world", "room", a)])) == []
    assert frames.to_world("/mocap") == pytest.approx(transforms.multiply(a, b))
    assert frames.to_world("mocap", ["room"]) == pytest.approx(b)
    frames.add(TFMessage(transforms=[transform("mocap", "world", a)]))  # a circle
    assert frames.to_world("elsewhere") is None
    (problem,) = frames.add(TFMessage(transforms=[transform("world", "bad", np.zeros(7))]))
    assert "the transform of 'bad'" in problem
