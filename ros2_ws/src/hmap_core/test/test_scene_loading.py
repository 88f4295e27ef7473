"""Scenes from task files: what is right, and what an error says of what is wrong."""

import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML
from scipy.spatial import ConvexHull

from hmap_core import transforms
from hmap_core.exceptions import Code, InputError
from hmap_core.mesh_files import read_hull
from hmap_core.scenes import convex_parts, list_robots, list_tasks, load_robot_model, load_scene, resources
from hmap_core.scenes.decompose import decompose
from hmap_core.scenes.json_schema import MODELS, schema_folder, schema_text
from hmap_core.simulation.collision_pairs import ignored_pairs
from hmap_core.types import BodyKind, ShapeKind

TASK = """\
schema: 1
mode: physical
parameters: {gap: {uniform: [0.1, 0.2]}}
fixed:
  table: {shape: box, size: [2, 2, 0.1], pose: {xyz: [0, 0, -0.05]}}
  wall: {object: bar, with: {length: 0.5}, pose: {xyz: [0, gap, 0.04], rpy_deg: [0, 0, 90]}}
movable:
  puck: {shape: cylinder, size: [0.03, 0.02], pose: {xyz: [0.4, 0, 0.01]}, mass: 0.2, friction: 0.3}
  block: {shape: box, size: [0.1, 0.1, 0.1], pose: {xyz: [0.6, 0, 0.05], quaternion: [0, 0, 1, 0]}, mass: 0.5}
tools:
  pawn:
    parts:
      - {shape: sphere, size: [0.03]}
      - {shape: capsule, size: [0.01, 0.1], pose: {xyz: [0, 0, 0.05]}}
    pose: {xyz: [0.8, 0, 0.03]}
    mass: 0.1
    graspable: [{lower: [-0.01, -0.01, 0.03], upper: [0.01, 0.01, 0.1]}]
robots:
  arm: {model: panda, base: {xyz: [0, -0.5, 0]}}
  other: {model: iiwa, base: {xyz: [0, 0.9, 0]}, q: [0.1, 0, 0, 0, 0, 0, 0]}
cameras:
  top: {position: [0, 0, 2], look_at: [0, 0, 0], up: [0, 1, 0]}
goal: {object: puck, pose: {xyz: [0.4, 0.3, 0.01]}, rotation_tolerance_deg: 180}
removable: {block: null}
"""


@pytest.fixture
def task(tmp_path: Path):
    """Writes the task with one text replaced, and returns its path."""

    def write(old: str = "", new: str = "") -> Path:
        assert old in TASK
        path = tmp_path / "task.yaml"
        path.write_text(TASK.replace(old, new, 1))
        return path

    return write


def test_builds_the_scene(task) -> None:
    scene = load_scene(task(), seed=2)
    assert scene.task == str(task()) and scene.seed == 2
    assert {name: body.kind for name, body in scene.bodies.items()} == {
        "table": BodyKind.FIXED,
        "wall": BodyKind.FIXED,
        "puck": BodyKind.MOVABLE,
        "block": BodyKind.MOVABLE,
        "pawn": BodyKind.TOOL,
    }
    assert scene.bodies["wall"].shapes[0].size == (0.5, 0.08, 0.08)
    assert scene.bodies["wall"].mass == 0.0
    assert 0.1 <= scene.bodies["wall"].pose[1] <= 0.2
    np.testing.assert_allclose(scene.bodies["wall"].pose[3:], [0, 0, np.sqrt(0.5), np.sqrt(0.5)])
    assert [shape.kind for shape in scene.bodies["pawn"].shapes] == [ShapeKind.SPHERE, ShapeKind.CAPSULE]
    assert scene.bodies["pawn"].graspable[0].shape == (2, 3)
    assert (scene.bodies["puck"].friction, scene.bodies["puck"].mass) == (0.3, 0.2)
    assert scene.removable == {"block": None}
    assert scene.goal.rotation_tolerance == pytest.approx(np.pi)
    np.testing.assert_array_equal(scene.robots["arm"].q, scene.robots["arm"].model.home)
    assert scene.robots["other"].q[0] == 0.1


def test_camera_looks_at_its_point_with_y_down(task) -> None:
    camera = load_scene(task()).cameras["top"]
    np.testing.assert_allclose(transforms.apply(camera.pose, [0.0, 0.0, 2.0]), [0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(transforms.rotation_matrix(camera.pose)[:, 1], [0, -1, 0], atol=1e-12)


def test_the_seed_decides(task) -> None:
    poses = [load_scene(task(), seed).bodies["wall"].pose for seed in (0, 0, 1)]
    np.testing.assert_array_equal(poses[0], poses[1])
    assert poses[0][1] != poses[2][1]
    assert load_scene(task("mode:", "seed: 7\nmode:")).seed == 7


CASES = [
    # old, new, line, what the error says, code
    ("mode: physical", "mode: fysical", 2, "mode = 'fysical': must be one of kinematic, physical", Code.INVALID_SCENE),
    ("mode: physical", "mood: physical", 2, "mood = 'physical': unknown key. Did you mean 'mode'?", Code.INVALID_SCENE),
    ("schema: 1", "schema: 3", 1, "must be 1", Code.INVALID_SCENE),
    ("schema: 1\n", "", 1, "schema: is missing", Code.INVALID_SCENE),
    ("size: [2, 2, 0.1]", "size: [2, -2, 0.1]", 5, "fixed.table.size[1] = -2: must be greater", Code.INVALID_SCENE),
    ("size: [2, 2, 0.1]", "size: [2, 2]", 5, "size of a box is [x, y, z] full extents", Code.INVALID_SCENE),
    ("size: [2, 2, 0.1]", "size: 2", 5, "fixed.table.size = 2: must be a list", Code.INVALID_SCENE),
    ("size: [2, 2, 0.1]", "size: [2, 2, 'gap - 1']", 5, "'gap - 1': must be greater than or", Code.INVALID_SCENE),
    ("size: [2, 2, 0.1]", "size: [2, 2, 1e9]", 5, "must be between -1000 and 1000", Code.INVALID_SCENE),
    ("shape: box, size: [2", "shape: cube, size: [2", 5, "'cube': must be one of box, cylinder", Code.INVALID_SCENE),
    ("object: bar", "object: baar", 6, "Did you mean 'bar'?", Code.UNKNOWN_OBJECT),
    ("object: bar", "object: no.yaml", 6, "file not found", Code.UNKNOWN_OBJECT),
    ("{length: 0.5}", "{lenght: 0.5}", 6, "fixed.wall.with.lenght = 0.5: the object 'bar' has no", Code.INVALID_SCENE),
    ("{length: 0.5}", "{length: -1}", 6, "with the values given here", Code.INVALID_SCENE),
    ("size: [2, 2, 0.1]", "size: 9" + 5000 * "9", 5, "more than 300 digits in a row", Code.INVALID_SCENE),
    ("mass: 0.2, ", "", 8, "'puck' needs a mass of at least 0.001 kg; none is given", Code.INVALID_SCENE),
    ("mass: 0.2, ", "mass: 1e-12, ", 8, "at least 0.001 kg; it is 1e-12 kg", Code.INVALID_SCENE),
    ("quaternion: [0, 0, 1, 0]", "quaternion: [0, 0, 1, 1]", 9, "norm 1.41421; it must be 1", Code.INVALID_POSE),
    ("xyz: [0.4, 0, 0.01]", "xyz: [0.4, .nan, 0.01]", 8, "movable.puck.pose.xyz[1] = nan", Code.INVALID_POSE),
    ("xyz: [0.4, 0, 0.01]", "xyz: [0.4, 0]", 8, "must be a list of 3 numbers [x, y, z]", Code.INVALID_POSE),
    ("mode: physical", 'mode: "\\ud800"', 2, "is not Unicode text", Code.INVALID_SCENE),
    ("xyz: [0.4, 0, 0.01]", "xyz: [0.4, true, 0]", 8, "must be a number", Code.INVALID_SCENE),
    ("  pawn:", "  puck:", 11, "a movable body has this name already", Code.INVALID_SCENE),
    ("  arm:", "  puck:", 19, "a body has this name already", Code.INVALID_SCENE),
    ("  other:", "  arm:", 20, "duplicate key", Code.INVALID_SCENE),
    ("  arm:", "  0arm:", 19, "a name is letters, digits", Code.INVALID_SCENE),
    ("model: iiwa", "model: no.yaml", 20, "robots.other.model = 'no.yaml': ", Code.INVALID_SCENE),
    ("model: iiwa", "model: iwa", 20, "Did you mean 'iiwa'? Known: fr3, gen3_2f85, iiwa", Code.UNKNOWN_ROBOT),
    ("q: [0.1, 0", "q: [0.1", 20, "must have 7 numbers", Code.INVALID_SCENE),
    ("q: [0.1", "q: [9.9", 20, "robots.other.q[0] = 9.9: must be within the joint's limits", Code.INVALID_SCENE),
    ("up: [0, 1, 0]", "up: [0, 0, 1]", 22, "up must not be along the view", Code.INVALID_SCENE),
    ("goal: {object: puck", "goal: {object: pck", 23, "Did you mean 'puck'?", Code.UNKNOWN_OBJECT),
    ("goal: {object: puck", "goal: {object: wall", 23, "'wall' is fixed; movable: puck", Code.INVALID_SCENE),
    ("goal: {object: puck", "goal: {objct: puck", 23, "Did you mean 'object'?", Code.INVALID_SCENE),
    ("removable: {block", "removable: {blok", 24, "Did you mean 'block'?", Code.UNKNOWN_OBJECT),
    ("lower: [-0.01, -0.01, 0.03]", "lower: [1, -0.01, 0.03]", 17, "lower must be below upper", Code.INVALID_SCENE),
    ("mode: physical", "mode: physical\nseed: 1.5", 3, "seed = 1.5", Code.INVALID_SCENE),
    ("mode: physical", "mode: physical\nunsolvable: maybe", 3, "must be true or false", Code.INVALID_SCENE),
    ("mode: physical", "mode: [", 4, "not valid YAML", Code.INVALID_SCENE),
    ("mode: physical", "mode: &a\n  x: *a", 2, "mode: must be one of", Code.INVALID_SCENE),
    ("mode: physical", "mode: 2020-01-01", 2, "mode: a value of the kind", Code.INVALID_SCENE),
    ("mode: physical", "1: physical", 1, "the key 1 must be text", Code.INVALID_SCENE),
    ("shape: sphere, size: [0.03]", "shape: mesh, mesh: no.obj", 13, "tools.pawn.parts[0].mesh", Code.INVALID_SCENE),
]


@pytest.mark.parametrize(("old", "new", "line", "says", "code"), CASES)
def test_an_error_names_file_line_key_and_what_is_allowed(task, old, new, line, says, code) -> None:
    path = task(old, new)
    with pytest.raises(InputError) as error:
        load_scene(path)
    assert error.value.reason.startswith(f"{path}:{line}: ")
    assert says in error.value.reason
    assert error.value.code is code


_LAUGHS = b"a0: &a0 [x, x, x, x]\n" + b"".join(
    b"a%d: &a%d [%s]\n" % (i, i, b", ".join([b"*a%d" % (i - 1)] * 9)) for i in range(1, 9)
)


@pytest.mark.parametrize(
    "content",
    [
        b"", b"# nothing", b"3", b"- 1", b"a: b: c", b"\xff\xfe\x00", b"--- {}\n--- {}", b"{}",
        b"x: !!python/name:os.system", _LAUGHS, b"a: " + b"[" * 400 + b"]" * 400, b"[" * 5000,
    ],
)  # fmt: skip
def test_a_file_that_is_no_scene_is_an_input_error(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "task.yaml"
    path.write_bytes(content)
    with pytest.raises(InputError, match="task.yaml"):
        load_scene(path)


def test_a_file_that_is_no_text_is_told_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "task.yaml"
    path.write_bytes(b"schema: 1\nmode: \xff\n")
    with pytest.raises(InputError, match=r"task.yaml:2: not text in UTF-8: the byte 0xff"):
        load_scene(path)


def test_unknown_tasks_and_wrong_seeds() -> None:
    with pytest.raises(InputError, match=r"Did you mean 'tunnel'\? Known: .*published/tunnel") as error:
        load_scene("tunel")
    assert error.value.code is Code.UNKNOWN_TASK
    for task in ("", "../robots/panda", "no/such.yaml", "/", "x" * 5000 + ".yaml", "\0.yaml"):
        with pytest.raises(InputError) as error:
            load_scene(task)
        assert error.value.code is Code.UNKNOWN_TASK
    for seed in (-1, 1.0, "0", True):
        with pytest.raises(InputError, match="must be an integer"):
            load_scene("tunnel", seed)


_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.sampled_from(["gap", "1/0"]),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=6,
)


def _slots(value, found: list) -> list:
    """Every (container, key) of a nested value."""
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, entry in entries:
        found.append((value, key))
        _slots(entry, found)
    return found


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_whatever_is_changed_there_is_a_scene_or_an_input_error(tmp_path: Path, data) -> None:
    document = YAML(typ="safe").load(TASK)
    container, key = data.draw(st.sampled_from(_slots(document, [])))
    container[key] = data.draw(_VALUES)
    path = tmp_path / "fuzz.yaml"
    path.write_text(json.dumps(document))  # JSON is YAML, but for NaN, which then is a wrong string
    try:
        load_scene(path)
    except InputError as error:
        assert "fuzz.yaml" in error.reason


def test_a_concave_mesh_is_refused_unless_its_hull_is_meant(task, tmp_path: Path) -> None:
    trimesh.creation.annulus(0.02, 0.05, 0.05).export(tmp_path / "ring.stl")
    trimesh.creation.icosphere(radius=0.05).export(tmp_path / "ball.stl")
    old = "shape: cylinder, size: [0.03, 0.02]"
    with pytest.raises(InputError, match="concave or open.*decompose: true.*convex parts.*convex_hull: true"):
        load_scene(task(old, "shape: mesh, mesh: ring.stl"))
    for mesh in ("mesh: ring.stl, convex_hull: true", "mesh: ball.stl, size: [1, 1, 0.5]"):
        shape = load_scene(task(old, f"shape: mesh, {mesh}")).bodies["puck"].shapes[0]
        assert shape.kind is ShapeKind.MESH and shape.mesh is not None and shape.mesh.parent == tmp_path


def test_a_concave_mesh_is_decomposed_once(task, tmp_path: Path, monkeypatch, caplog) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    trimesh.creation.annulus(0.02, 0.05, 0.05).export(tmp_path / "ring.stl")
    trimesh.creation.icosphere(radius=0.05).export(tmp_path / "ball.stl")
    file = task("shape: cylinder, size: [0.03, 0.02]", "shape: mesh, mesh: ring.stl, size: [1, 1, 2], decompose: true")
    shapes = load_scene(file).bodies["puck"].shapes
    assert len(shapes) > 3 and "ring.stl" in caplog.text and "once" in caplog.text
    hulls = [read_hull(shape.mesh).vertices for shape in shapes]
    assert all(shape.size == (1.0, 1.0, 2.0) for shape in shapes)
    assert all(np.linalg.norm(hull.mean(axis=0)[:2]) > 0.02 for hull in hulls)  # the hole stays open
    volume = sum(ConvexHull(hull).volume for hull in hulls)
    assert volume == pytest.approx(np.pi * (0.05**2 - 0.02**2) * 0.05, rel=0.15)
    caplog.clear()
    convex_parts._kept.cache_clear()
    assert load_scene(file).bodies["puck"].shapes[0].mesh == shapes[0].mesh and not caplog.text
    convex = load_scene(task("shape: cylinder, size: [0.03, 0.02]", "shape: mesh, mesh: ball.stl, decompose: true"))
    assert [shape.mesh for shape in convex.bodies["puck"].shapes] == [tmp_path / "ball.stl"]
    both = "shape: mesh, mesh: ring.stl, decompose: true, convex_hull: true"
    with pytest.raises(InputError, match="convex_hull: true or decompose: true, not both"):
        load_scene(task("shape: cylinder, size: [0.03, 0.02]", both))


def test_a_users_object_and_robot_lie_beside_the_task(task, tmp_path: Path) -> None:
    (tmp_path / "box.yaml").write_text("schema: 1\nshape: box\nsize: [0.1, 0.2, 0.3]\nmass: 1.5\n")
    robot = (resources.package_path("hmap_scenes") / "robots" / "panda.yaml").read_text()
    (tmp_path / "mine.yaml").write_text(robot)
    scene = load_scene(task("shape: cylinder, size: [0.03, 0.02]", "object: box.yaml"))
    assert scene.bodies["puck"].shapes[0].size == (0.1, 0.2, 0.3)
    assert scene.bodies["puck"].mass == 0.2
    assert load_scene(task("model: panda", "model: mine.yaml")).robots["arm"].model.name == "mine"


def test_a_decomposed_mesh_loads(task, tmp_path: Path) -> None:
    trimesh.creation.annulus(0.02, 0.05, 0.05, sections=16).export(tmp_path / "ring.stl")
    parts = decompose(tmp_path / "ring.stl")
    assert len(parts) > 2
    listed = ", ".join(f"{{shape: mesh, mesh: {part.name}}}" for part in parts)
    scene = load_scene(task("shape: cylinder, size: [0.03, 0.02]", f"parts: [{listed}]"))
    assert len(scene.bodies["puck"].shapes) == len(parts)
    (tmp_path / "text.stl").write_text("no mesh")
    with pytest.raises(InputError, match="mesh = 'text.stl': .*not a mesh"):
        load_scene(task("shape: cylinder, size: [0.03, 0.02]", "shape: mesh, mesh: text.stl"))
    with pytest.raises(InputError, match="not a mesh"):
        decompose(tmp_path / "text.stl")


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("panda_joint3,", "panda_joint33,", "Did you mean 'panda_joint3'?"),
        ("link: panda_hand", "link: panda_hnd", "Did you mean 'panda_hand'?"),
        ("panda.urdf", "pnda.urdf", "file not found"),
        ("pybullet_data:", "http:", "unknown scheme"),
        ("home: [0.0,", "home: [", "home = .*has 6 numbers; joints has 7"),
        ("home: [0.0,", "home: [3.0,", r"of panda_joint1 must be within its limits \[-2.8973, 2.8973\]"),
        ("velocity_limits: [2.1750,", "velocity_limits: [0,", "must be greater than 0"),
        ("max_opening: 0.0778", "max_opening: 0.09", "at most open_opening"),
        ("[panda_link0, panda_link1]", "[panda_link0, panda_linkX]", r"ignored_collisions\[0\]\[1\]"),
    ],
)
def test_a_wrong_robot_file_is_named(tmp_path: Path, old: str, new: str, says: str) -> None:
    text = (resources.package_path("hmap_scenes") / "robots" / "panda.yaml").read_text()
    assert old in text
    (tmp_path / "robot.yaml").write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=says) as error:
        load_robot_model("robot.yaml", tmp_path)
    assert "robot.yaml:" in error.value.reason


@pytest.mark.parametrize("name", list_robots())
def test_ignored_pairs_are_those_that_never_or_always_collide(name: str) -> None:
    model = load_robot_model(name)
    found = ignored_pairs(model, 100, np.random.default_rng(1))
    listed = set(model.ignored_collisions)
    # few samples find more pairs that never collide, never fewer, and the same adjacent ones
    assert listed <= set(found)
    assert {pair for pair, reason in found.items() if reason == "adjacent"} <= listed


@pytest.mark.parametrize("name", sorted(MODELS))
def test_committed_json_schemas_are_current_and_accept_what_is_shipped(name: str) -> None:
    text = (schema_folder() / f"{name}.schema.json").read_text()
    assert text == schema_text(name, MODELS[name]), "run: python -m hmap_core.scenes"
    validator = jsonschema.Draft202012Validator(json.loads(text))
    files = list((schema_folder().parent / f"{name}s").rglob("*.yaml"))
    assert files
    for file in files:
        validator.validate(YAML(typ="safe").load(file.read_text()))


def test_tasks_are_listed() -> None:
    assert {"tunnel", "published/tunnel"} <= set(list_tasks())


def test_the_example_in_the_documentation_loads(tmp_path: Path) -> None:
    text = (Path(__file__).parents[4] / "docs" / "scenes.md").read_text(encoding="utf-8")
    (tmp_path / "example.yaml").write_text(text.split("```yaml\n")[1].split("```")[0])
    scene = load_scene(tmp_path / "example.yaml")
    assert set(scene.bodies) == {"table", "wall", "puck", "crate", "pawn"}
