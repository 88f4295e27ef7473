"""The scaling study: what varies, what stays, and the form of its data; not its speed."""

import numpy as np
import pytest

from hmap_core.benchmark import scaling


def test_only_the_number_that_is_varied_changes():
    few, many = (scaling.instance(0, 10, n, ("panda",)) for n in (3, 6))
    assert list(few.scene.bodies) == list(many.scene.bodies)[:4]
    assert len(many.scene.bodies) == 7
    longer = scaling.instance(0, 40, 3, ("panda",))
    assert longer.steps_per_phase == (40,)
    np.testing.assert_array_equal(longer.targets[0].T_world_ee, few.targets[0].T_world_ee)
    np.testing.assert_array_equal(many.targets[0].T_world_ee, few.targets[0].T_world_ee)


def test_each_arm_has_a_target():
    instance = scaling.instance(1, 10, 2, ("panda", "iiwa"))
    assert [target.robot for target in instance.targets] == list(instance.scene.robots)
    assert len(instance.start) == 14


@pytest.mark.slow
def test_the_data_have_an_entry_for_each_value(monkeypatch, tmp_path):
    monkeypatch.setattr(scaling, "STEPS", (5, 10))
    monkeypatch.setattr(scaling, "OBSTACLES", (0, 2))
    scaling._full_instance.cache_clear()
    monkeypatch.setattr(scaling, "ARMS", (("panda",), ("panda", "iiwa")))
    monkeypatch.setattr(scaling, "STANDARD_OBSTACLES", 2)
    data = scaling.run(instances=2)
    assert data["joints"]["values"] == [7, 14]
    for axis in ("steps", "obstacles", "joints"):
        assert all(len(data[axis][key]) == 2 for key in ("values", "labels", "median_ms", "claimed"))
        assert all(ms > 0.0 for ms in data[axis]["median_ms"])
        assert all(0 <= k <= 2 for k in data[axis]["claimed"])
    file = tmp_path / "scaling.png"
    scaling.draw(data, file)
    assert file.read_bytes().startswith(b"\x89PNG")


def test_the_line_through_the_times():
    data = {"steps": {"values": [10, 20, 40], "median_ms": [3.0, 5.0, 9.0]}}
    assert scaling.linear_fit(data) == pytest.approx((0.2, 1.0))
