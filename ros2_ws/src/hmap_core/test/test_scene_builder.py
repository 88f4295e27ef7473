"""Scenes built in Python: equal to those of a task file, and refused with the same words."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from hmap_core.cli import main
from hmap_core.exceptions import Code, InputError
from hmap_core.scenes import SceneBuilder, list_tasks, load_scene, scene_to_dict
from hmap_core.transforms import from_rpy
from hmap_core.types import Scene, Shape, ShapeKind

WRITTEN = """\
schema: 1
mode: physical
motion: planar
fixed:
  table: {shape: box, size: [2, 2, 0.1], pose: {xyz: [0, 0, -0.05]}}
  wall: {object: bar, with: {length: 0.5}, pose: {xyz: [0, 0.2, 0.04], rpy_deg: [0, 0, 90]}}
  stone: {shape: mesh, mesh: stone.obj, size: [0.5, 0.5, 0.5], pose: {xyz: [1, 0, 0.1]}, friction: 0.9}
movable:
  puck: {shape: cylinder, size: [0.03, 0.02], pose: {xyz: [0.4, 0, 0.01]}, mass: 0.2, friction: 0.3}
  block:
    shape: box
    size: [0.1, 0.1, 0.1]
    pose: {xyz: [0.6, 0, 0.05], quaternion: [0, 0, 1, 0]}
    mass: 0.5
    color: [1, 0, 0, 1]
  ball: {shape: sphere, size: [0.03], pose: {xyz: [0.6, 0.4, 0.03]}, mass: 0.1}
  pill: {shape: capsule, size: [0.01, 0.04], pose: {xyz: [0.7, 0.4, 0.03]}, mass: 0.1}
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
  top: {position: [0, 0, 2], look_at: [0, 0, 0], up: [0, 1, 0], fov_y_deg: 60, width: 320, height: 240}
goal: {object: puck, pose: {xyz: [0.4, 0.3, 0.01]}, rotation_tolerance_deg: 180}
removable: {block: null, ball: {xyz: [0.7, -0.4, 0.03]}}
execution_tolerance: {position: 0.03, rotation_deg: 180}
"""


def built(mesh: Path) -> SceneBuilder:
    """The scene of WRITTEN."""
    scene = SceneBuilder("mine", mode="physical", motion="planar", execution_tolerance=(0.03, np.pi))
    scene.add_box("table", [2, 2, 0.1], [0, 0, -0.05])
    scene.add_object("wall", "bar", from_rpy([0, 0.2, 0.04], [0, 0, np.pi / 2]), values={"length": 0.5})
    scene.add_mesh("stone", mesh, [1, 0, 0.1], scale=[0.5, 0.5, 0.5], friction=0.9)
    scene.add_cylinder("puck", 0.03, 0.02, [0.4, 0, 0.01], movable=True, mass=0.2, friction=0.3)
    red, turned = (1.0, 0.0, 0.0, 1.0), np.array([0.6, 0, 0.05, 0, 0, 1, 0])
    scene.add_box("block", np.full(3, 0.1), turned, movable=True, removable=True, mass=0.5, color=red)
    scene.add_sphere("ball", 0.03, [0.6, 0.4, 0.03], movable=True, mass=0.1, removable=[0.7, -0.4, 0.03])
    scene.add_capsule("pill", np.float32(0.01), 0.04, {"xyz": [0.7, 0.4, 0.03]}, movable=True, mass=0.1)
    shaft = Shape(ShapeKind.CAPSULE, (0.01, 0.1), from_rpy([0, 0, 0.05], [0, 0, 0]))
    grip = np.array([[-0.01, -0.01, 0.03], [0.01, 0.01, 0.1]])
    scene.add_body(
        "pawn", [{"shape": "sphere", "size": [0.03]}, shaft], [0.8, 0, 0.03], tool=True, mass=0.1, graspable=[grip]
    )
    scene.add_robot("arm", "panda", [0, -0.5, 0]).add_robot("other", "iiwa", [0, 0.9, 0], q=[0.1, 0, 0, 0, 0, 0, 0])
    scene.add_camera("top", [0, 0, 2], [0, 0, 0], up=[0, 1, 0], fov_y=np.deg2rad(60), width=320, height=240)
    return scene.set_goal("puck", [0.4, 0.3, 0.01], rotation_tolerance=np.pi)


@pytest.fixture
def stone(tmp_path: Path) -> Path:
    """A convex mesh beside the task file."""
    path = tmp_path / "stone.obj"
    trimesh.creation.icosphere(subdivisions=1, radius=0.2).export(path)
    return path


def same(first: Scene, second: Scene) -> bool:
    """Whether two scenes are equal but for their names."""
    return scene_to_dict(replace(first, task="")) == scene_to_dict(replace(second, task=""))


def small() -> SceneBuilder:
    """A scene with what it has to have."""
    scene = SceneBuilder("small").add_box("table", [2, 2, 0.1], [0, 0, -0.05])
    scene.add_box("box", [0.05, 0.05, 0.08], [0.5, -0.2, 0.04], movable=True, mass=0.3).add_robot("arm", "panda")
    return scene.set_goal("box", [0.5, 0.2, 0.04])


def test_the_scene_is_that_of_the_task_file(tmp_path: Path, stone: Path) -> None:
    path = tmp_path / "written.yaml"
    path.write_text(WRITTEN)
    scene = built(stone).build(seed=4)
    assert same(scene, load_scene(path, seed=4))
    assert (scene.task, scene.seed) == ("mine", 4)


def test_a_saved_scene_is_the_same_when_it_is_read(tmp_path: Path, stone: Path) -> None:
    scene = built(stone)
    path = scene.save(tmp_path / "saved.yaml")
    assert same(load_scene(path, seed=2), scene.build(2))
    assert SceneBuilder.from_yaml(path).to_yaml() == scene.to_yaml()


def test_a_saved_scene_can_be_planned(tmp_path: Path, capsys) -> None:
    path = small().save(tmp_path / "small.yaml")
    assert main(["plan", str(path), "--out", str(tmp_path / "plan.json"), "--time-limit", "240"]) == 0
    assert main(["check", str(tmp_path / "plan.json")]) == 0
    capsys.readouterr()


@pytest.mark.parametrize("task", list_tasks())
def test_a_task_that_is_read_stays_what_it_is(task: str) -> None:
    assert same(SceneBuilder.from_yaml(task).build(3), load_scene(task, 3))


def test_a_task_can_be_changed(tmp_path: Path, stone: Path) -> None:
    """Relative paths go on naming the files beside the first task."""
    (tmp_path / "written.yaml").write_text(WRITTEN)
    scene = SceneBuilder.from_yaml(tmp_path / "written.yaml", "other")
    scene.remove("ball").add_sphere("ball", 0.02, [0.6, 0.4, 0.02], movable=True, mass=0.1).remove("other")
    (tmp_path / "sub").mkdir()
    changed = load_scene(scene.save(tmp_path / "sub" / "changed.yaml"))
    assert changed.bodies["ball"].shapes[0].size == (0.02,) and list(changed.robots) == ["arm"]
    assert "ball" not in changed.removable and changed.bodies["stone"].shapes[0].mesh == stone
    with pytest.raises(InputError, match="there is no 'ball2'") as error:
        scene.remove("ball2")
    assert error.value.code is Code.UNKNOWN_OBJECT


AT, BOX = [0.0, 0.0, 0.5], [0.1, 0.1, 0.1]
WRONG = [
    (lambda s: s.add_box("my box", BOX, AT), Code.INVALID_SCENE, "fixed.my box: a name is letters"),
    (lambda s: s.add_box(3, BOX, AT), Code.INVALID_SCENE, "a name is letters"),
    (lambda s: s.add_box("box", BOX, AT), Code.INVALID_SCENE, "fixed.box: a body has this name"),
    (lambda s: s.add_box("arm", BOX, AT), Code.INVALID_SCENE, "a robot has this name"),
    (lambda s: s.add_robot("box", "panda"), Code.INVALID_SCENE, "a body has this name"),
    (lambda s: s.add_box("b", [1, -1, 1], AT), Code.INVALID_SCENE, "fixed.b.size[1] = -1: must be greater"),
    (lambda s: s.add_box("b", [1, 1], AT), Code.INVALID_SCENE, "size of a box is [x, y, z] full extents"),
    (lambda s: s.add_sphere("b", "big", AT), Code.INVALID_SCENE, "fixed.b.size[0] = 'big'"),
    (lambda s: s.add_box("b", 0.5, AT), Code.INVALID_SCENE, "fixed.b.size = 0.5: must be a list"),
    (lambda s: s.add_box("b", BOX, [0, 0]), Code.INVALID_POSE, "fixed.b.pose: [0, 0] is no pose"),
    (lambda s: s.add_box("b", BOX, [0, 0, 0, 0, 0, 0, 2]), Code.INVALID_POSE, "quaternion has norm 2"),
    (lambda s: s.add_box("b", BOX, [0, 0, np.nan]), Code.INVALID_POSE, "must be a finite number"),
    (lambda s: s.add_box("b", BOX, {"xyz": AT, "rpy": AT}), Code.INVALID_SCENE, "Did you mean 'rpy_deg'?"),
    (lambda s: s.add_box("b", BOX, AT, frction=1), Code.INVALID_SCENE, "Did you mean 'friction'?"),
    (lambda s: s.add_box("b", BOX, AT, movable=True), Code.INVALID_SCENE, "needs a mass of at least"),
    (lambda s: s.add_box("b", BOX, AT, graspable=[[AT, AT]]), Code.INVALID_SCENE, "lower must be below upper"),
    (lambda s: s.add_box("b", BOX, AT, removable=True), Code.INVALID_SCENE, "removable has to be movable"),
    (lambda s: s.add_body("b", [], AT), Code.INVALID_SCENE, "fixed.b.parts"),
    (lambda s: s.add_mesh("b", "nix.obj", AT), Code.INVALID_SCENE, "file not found"),
    (lambda s: s.add_object("b", "barr", AT), Code.UNKNOWN_OBJECT, "Did you mean 'bar'?"),
    (lambda s: s.add_object("b", "bar", AT, values={"lenth": 1}), Code.INVALID_SCENE, "Did you mean 'length'?"),
    (lambda s: s.add_robot("b", "pnda"), Code.UNKNOWN_ROBOT, "Did you mean 'panda'?"),
    (lambda s: s.add_robot("b", "panda", q=[0, 1]), Code.INVALID_SCENE, "must have 7 numbers"),
    (lambda s: s.add_robot("b", "panda", q=[9, 0, 0, 0, 0, 0, 0]), Code.INVALID_SCENE, "within the joint's limits"),
    (lambda s: s.add_camera("c", AT, AT), Code.INVALID_SCENE, "look_at must differ from position"),
    (lambda s: s.set_goal("box", AT, position_tolerance=0), Code.INVALID_SCENE, "goal.position_tolerance = 0"),
    (lambda s: s.set_goal("box", [0, 0]), Code.INVALID_POSE, "goal.pose"),
]


@pytest.mark.parametrize(("add", "code", "says"), WRONG)
def test_what_is_wrong_is_told_at_once_and_changes_nothing(add, code: Code, says: str) -> None:
    scene = small()
    before = scene.to_yaml()
    with pytest.raises(InputError) as error:
        add(scene)
    assert error.value.code is code and says in error.value.reason
    assert error.value.reason.startswith("scene 'small': ")
    assert scene.to_yaml() == before
    scene.build()


INCOMPLETE = [
    (lambda: SceneBuilder("e"), Code.INVALID_SCENE, "movable: is missing"),
    (lambda: SceneBuilder("e", mode="phys"), Code.INVALID_SCENE, "Did you mean 'physical'?"),
    (lambda: small().set_goal("bix", AT), Code.UNKNOWN_OBJECT, "Did you mean 'box'?"),
    (lambda: small().set_goal("table", AT), Code.INVALID_SCENE, "'table' is fixed; movable: box"),
    (lambda: small().remove("arm"), Code.INVALID_SCENE, "robots"),
]


@pytest.mark.parametrize(("make", "code", "says"), INCOMPLETE)
def test_what_is_missing_is_told_when_it_is_built(make, code: Code, says: str, tmp_path: Path) -> None:
    scene = make()
    for finish in (scene.build, lambda: scene.save(tmp_path / "x.yaml")):
        with pytest.raises(InputError) as error:
            finish()
        assert error.value.code is code and says in error.value.reason
    assert not (tmp_path / "x.yaml").exists()


def test_a_task_file_ends_in_yaml_and_lies_in_a_folder(tmp_path: Path) -> None:
    for path, says in ((tmp_path / "x.json", "ends in .yaml"), (tmp_path / "nix" / "x.yaml", "cannot be written")):
        with pytest.raises(InputError, match=says):
            small().save(path)


def test_a_wrong_execution_tolerance_is_told() -> None:
    with pytest.raises(InputError, match=r"execution_tolerance.position = -1"):
        SceneBuilder("e", execution_tolerance=(-1, 0.1))
