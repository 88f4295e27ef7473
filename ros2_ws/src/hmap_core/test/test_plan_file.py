"""Plan files and scenes as text: what is written is read again, and what is wrong is named."""

import copy
import json
import os
import re
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from hmap_core import plan_file
from hmap_core.exceptions import Code, InputError
from hmap_core.scenes import list_tasks, load_scene, scene_from_text, scene_to_text
from hmap_core.scenes.json_schema import schema_folder
from hmap_core.types import Body, BodyKind, Plan, Scene, Segment, SegmentKind, Shape, ShapeKind, Trajectory

ROUNDING = 1e-8  # more than the file's rounding, less than any tolerance of a plan
SAMPLES = 5


def assert_same(first, second, key: str = "") -> None:
    """Compares data classes, containers and arrays; numbers within ROUNDING."""
    if is_dataclass(first):
        assert type(first) is type(second), key
        for field in fields(first):
            assert_same(getattr(first, field.name), getattr(second, field.name), f"{key}.{field.name}")
    elif isinstance(first, dict):
        assert list(first) == list(second), key
        for name in first:
            assert_same(first[name], second[name], f"{key}.{name}")
    elif isinstance(first, np.ndarray | float):
        np.testing.assert_allclose(first, second, rtol=0.0, atol=ROUNDING, err_msg=key)
        assert np.shape(first) == np.shape(second), key
    elif isinstance(first, tuple | list):
        assert len(first) == len(second), key
        for i, (a, b) in enumerate(zip(first, second, strict=True)):
            assert_same(a, b, f"{key}[{i}]")
    else:
        assert first == second, key


def _plan(scene: Scene) -> Plan:
    rng = np.random.default_rng(0)
    robots, bar = scene.robots, scene.bodies["bar"].pose
    return Plan(
        scene=scene,
        trajectory=Trajectory(
            time=0.02 * np.arange(SAMPLES),
            joints={name: robot.q + rng.normal(size=(SAMPLES, 7)) for name, robot in robots.items()},
            gripper=dict.fromkeys(robots, np.full(SAMPLES, 1.0 / 15.0)),
            objects={"bar": np.tile(bar, (SAMPLES, 1))},
        ),
        segments=(
            Segment(0.0, 0.02, "panda_1", "panda_hand", None, SegmentKind.TRANSIT),
            Segment(0.02, 0.08, "panda_1", "panda_hand", "bar", SegmentKind.GRASP, bar),
        ),
        waypoints=np.array([bar, scene.goal.pose]),
        stats={"planning_time_s": 1.25, "contact_tries": 3},
    )


@pytest.fixture(scope="module")
def plan() -> Plan:
    return _plan(load_scene("tunnel", seed=1))


@pytest.fixture(scope="module")
def document(plan: Plan) -> dict:
    return plan_file.to_dict(plan)


def test_a_saved_plan_is_read_again(plan: Plan, tmp_path: Path) -> None:
    plan_file.save(plan, tmp_path / "plan.json")
    assert_same(plan, plan_file.load(tmp_path / "plan.json"))
    assert [path.name for path in tmp_path.iterdir()] == ["plan.json"]


def test_writing_is_stable(document: dict) -> None:
    assert plan_file.to_dict(plan_file.from_dict(document)) == document


@pytest.mark.parametrize("task", list_tasks())
def test_a_scene_crosses_as_text(task: str) -> None:
    scene = load_scene(task, seed=3)
    assert_same(scene, scene_from_text(scene_to_text(scene)))


def test_every_shape_crosses_and_a_mesh_that_is_not_there_is_made_from_its_vertices(
    tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    mesh = tmp_path / "ball.stl"
    trimesh.creation.icosphere(subdivisions=1, radius=0.05).export(mesh)
    pose = np.array([0.1, 0.2, 0.3, 0.5, 0.5, 0.5, 0.5])
    shapes = (
        Shape(ShapeKind.BOX, (0.1, 0.2, 0.3), pose),
        Shape(ShapeKind.CYLINDER, (0.1, 0.2)),
        Shape(ShapeKind.SPHERE, (0.1,)),
        Shape(ShapeKind.CAPSULE, (0.1, 0.2)),
        Shape(ShapeKind.MESH, (1.0, 1.0, 2.0), pose, mesh),
    )
    region = np.array([[-0.1, -0.1, -0.1], [0.1, 0.1, 0.1]])
    body = Body("thing", BodyKind.TOOL, shapes, pose, 0.4, 0.7, (region,), (0.1, 0.2, 0.3, 1.0))
    single = Body("single", BodyKind.MOVABLE, shapes[4:], pose, 0.4)
    scene = load_scene("tunnel")
    scene = replace(
        scene, bodies=scene.bodies | {"thing": body, "single": single}, removable={"thing": None, "single": pose}
    )
    text = scene_to_text(scene)
    assert_same(scene, scene_from_text(text))
    mesh.unlink()
    made = scene_from_text(text).bodies["single"].shapes[0].mesh
    assert made is not None and made.is_relative_to(tmp_path / "cache")
    assert trimesh.load_mesh(made).volume == pytest.approx(trimesh.creation.icosphere(1, 0.05).volume, rel=1e-5)


def _set(document: dict, *path_and_value) -> dict:
    *path, key, value = path_and_value
    changed = copy.deepcopy(document)
    target = changed
    for step in path:
        target = target[step]
    if value is ...:
        del target[key]
    else:
        target[key] = value
    return changed


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("format", "other"), "format = 'other': must be 'hmap-plan'"),
        (("version", 2), "version = 2: must be 1"),
        (("goal", ...), "goal: Field required"),
        (("mode", "magic"), "mode = 'magic': must be 'kinematic' or 'physical'"),
        (("goal", "object", "table"), "'table' is not a movable body; there are: bar"),
        (("goal", "pose", [0, 0, 0, 0, 0, 0, 2]), "goal.pose: holds a quaternion of norm 2"),
        (("goal", "pose", [0, 0, 0, 0, 0, 1]), "goal.pose: must be 7 numbers; it is 6"),
        (("scene", "bodies", 0, "pose", [0, 0, float("nan"), 0, 0, 0, 1]), "must be finite numbers; at [2]"),
        (("scene", "bodies", 0, "name", "bar"), "the name 'bar' is used twice"),
        (("scene", "bodies", 0, "parts", 0, "size", [1, 1]), "size of a box is [x, y, z]"),
        (("scene", "bodies", 3, "size", [1, -1, 1]), "scene.bodies[3].size[1] = -1: must be greater than 0"),
        (("scene", "bodies", 3, "mass", -1), "scene.bodies[3].mass = -1: must be greater"),
        (("robots", "panda_1", "q_start", [0, 0]), "q_start must have one number for each of the 7 joints"),
        (("robots", "panda_1", "urdf", "pybullet_data://no.urdf"), "file not found"),
        (("trajectory", "time", 1, 0.0), "time must start at 0 and increase"),
        (("trajectory", "joints", "panda_1", ...), "trajectory.joints must have the keys panda_1, panda_2"),
        (("trajectory", "gripper", "panda_1", [0, 0]), "gripper.panda_1 has 2 samples; time has 5"),
        (("trajectory", "joints", "panda_1", 1, [0, 0]), "trajectory.joints.panda_1: must be n x n numbers"),
        (("trajectory", "objects", "bar", 2, 0, "x"), "trajectory.objects.bar: must be n x 7 numbers"),
        (("segments", 1, "kind", "carry"), "segments[1].kind = 'carry'"),
        (("segments", 1, "robot", "r2"), "segments[1].robot = 'r2' is not in the scene"),
        (("segments", 1, "contact_pose", None), "a grasp segment needs object and contact_pose"),
        (("segments", 1, "end", 0.0), "end must not be before start"),
    ],
)
def test_a_wrong_plan_file_is_named(document: dict, change: tuple, says: str) -> None:
    with pytest.raises(InputError) as error:
        plan_file.from_dict(_set(document, *change), "x.json")
    assert error.value.code is Code.INVALID_PLAN_FILE
    assert error.value.reason.startswith("x.json: ")
    assert says in error.value.reason


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b"3", b"\xff", b"[" * 100_000, b'{"format": "hmap-plan"}'])
def test_a_file_that_is_no_plan_is_an_input_error(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "plan.json").write_bytes(content)
    with pytest.raises(InputError, match="plan.json") as error:
        plan_file.load(tmp_path / "plan.json")
    assert error.value.code is Code.INVALID_PLAN_FILE


def test_a_file_that_cannot_be_read_or_written_is_an_input_error(plan: Plan, tmp_path: Path) -> None:
    for call in (
        lambda: plan_file.load(tmp_path / "no.json"),
        lambda: plan_file.save(plan, tmp_path / "no" / "x.json"),
    ):
        with pytest.raises(InputError, match="cannot be"):
            call()


def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.json")
    with pytest.raises(InputError, match="pipe.json: cannot be read: it is a folder, a pipe or a device"):
        plan_file.load(tmp_path / "pipe.json")


def test_a_byte_order_mark_is_no_matter(document: dict, tmp_path: Path) -> None:
    (tmp_path / "plan.json").write_text(json.dumps(document), encoding="utf-8-sig")
    assert plan_file.to_dict(plan_file.load(tmp_path / "plan.json")) == document


def test_a_plan_with_nan_is_not_written(plan: Plan, tmp_path: Path) -> None:
    broken = replace(plan, waypoints=np.full((1, 7), np.nan))
    with pytest.raises(InputError, match=r"plan.waypoints\[0\]\[0\] = nan"):
        plan_file.save(broken, tmp_path / "plan.json")
    assert not list(tmp_path.iterdir())


def test_nan_in_a_trajectory_is_named_by_its_place(plan: Plan) -> None:
    for key in ("joints", "gripper", "objects"):
        arrays = {name: np.array(samples) for name, samples in getattr(plan.trajectory, key).items()}
        name = next(iter(arrays))
        place = (len(arrays[name]) - 1,) + (0,) * (arrays[name].ndim - 1)
        arrays[name][place] = np.inf
        broken = replace(plan, trajectory=replace(plan.trajectory, **{key: arrays}))
        where = f"plan.trajectory.{key}.{name}{''.join(f'[{i}]' for i in place)} = inf"
        with pytest.raises(InputError, match=re.escape(where)):
            plan_file.to_dict(broken)


def test_statistics_may_hold_numpy_values_and_nan(plan: Plan) -> None:
    stats = {"n": np.int64(3), "t": np.float64(0.5), "list": np.arange(2), "none": float("inf"), "path": Path("x")}
    written = plan_file.to_dict(replace(plan, stats=stats))["stats"]
    assert written == {"n": 3, "t": 0.5, "list": [0, 1], "none": None, "path": "x"}


def _slots(value, found: list) -> list:
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, entry in entries:
        found.append((value, key))
        _slots(entry, found)
    return found


_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=6,
)


@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_whatever_is_changed_there_is_a_plan_or_an_input_error(document: dict, data) -> None:
    changed = copy.deepcopy(document)
    container, key = data.draw(st.sampled_from(_slots(changed, [])))
    container[key] = data.draw(_VALUES)
    try:
        plan_file.from_dict(changed)
    except InputError as error:
        assert error.code is Code.INVALID_PLAN_FILE


def test_committed_json_schema_is_current_and_accepts_a_plan(document: dict) -> None:
    text = (schema_folder() / plan_file.SCHEMA_FILE).read_text()
    assert text == plan_file.json_schema(), "run: python -m hmap_core.plan_file"
    validator = jsonschema.Draft202012Validator(json.loads(text))
    validator.validate(document)
    assert not validator.is_valid(_set(document, "goal", ...))
