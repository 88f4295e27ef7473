"""Files that cannot be judged are refused with code INVALID_PLAN_FILE and a reason that names the place."""

import ast
import copy
from pathlib import Path

import pytest
import validation_fixtures as plans

import hmap_core.validation
from hmap_core.exceptions import Code, InputError
from hmap_core.validation import check


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    return plans.carry(plans.write_gantry(tmp_path_factory.mktemp("gantry")))


def at(plan: dict, path: str):
    """The container of the last key of a path like ``robots.gantry.urdf``, and that key."""
    *way, last = [int(key) if key.isdigit() else key for key in path.split(".")]
    for key in way:
        plan = plan[key]
    return plan, last


NAN, INFINITY = float("nan"), float("inf")
WRONG = [
    ("format", "other-plan", "hmap-plan"),
    ("version", 2, "version 1"),
    ("mode", "magic", "kinematic, physical"),
    ("goal.object", "nobody", "allowed: cube"),
    ("goal.object", "table", "allowed: cube"),
    ("goal.pose", [0, 0, 0, 0, 0, 0, 2], "norm 2"),
    ("goal.position_tolerance_m", -1, "zero or more"),
    ("scene.bodies.0.kind", "liquid", "fixed, movable, tool"),
    ("scene.bodies.0.shape", "cone", "allowed: box"),
    ("scene.bodies.0.size", [1, 1], "3 numbers"),
    ("scene.bodies.0.size", [1, 1, -1], "from 1e-05 to 1000 m"),
    ("scene.bodies.0.size", [1, 1, 1e-9], "from 1e-05 to 1000 m"),
    ("scene.bodies.0.pose", [1e300, 0, 0, 0, 0, 0, 1], "up to 1e+09"),
    ("version", 10**400, "a number is needed"),
    ("robots.gantry.gripper.finger_links", [], "at least one"),
    ("scene.bodies.0.name", "cube", "same name"),
    ("scene.bodies.1.pose", [0, 0, 0, 1], "7 numbers"),
    ("robots.gantry.urdf", "nowhere://x.urdf", "unknown scheme"),
    ("robots.gantry.urdf", "/nonexistent.urdf", "no such file"),
    ("robots.gantry.urdf", __file__, "not a readable URDF"),
    ("robots.gantry.joint_names", ["x", "y", "w"], "no moving joint 'w'"),
    ("robots.gantry.end_effector_link", "paw", "allowed: paw"),
    ("robots.gantry.velocity_limits", [1.0, 1.0], "3 numbers"),
    ("robots.gantry.gripper.finger_links", ["thumb"], "no link 'thumb'"),
    ("trajectory.time", [], "at least one"),
    ("trajectory.time", [0.5], "uniform"),
    ("trajectory.time.7", 0.1401, "uniform"),
    ("trajectory.time.7", 0.02, "increase"),
    ("trajectory.time.0", 0.001, "uniform"),
    ("trajectory.joints.gantry.3.1", NAN, "NaN"),
    ("trajectory.joints.gantry.3.1", INFINITY, "infinity"),
    ("trajectory.joints.gantry.3", [0.0, 0.0], "numbers are needed"),
    ("trajectory.joints.gantry", [[0.0, 0.0, 0.3]], "shape (1, 3)"),
    ("trajectory.joints.robot_x", [], "no robot of that name"),
    ("trajectory.objects.ghost", [], "no body of that name"),
    ("trajectory.objects.cube.5", [0, 0, 0, 0, 0, 0, 0.5], "norm 0.5"),
    ("trajectory.gripper.gantry", [0.08], "shape (1,)"),
    ("segments", [], "no gaps"),
    ("segments.1.end", 1.2, "no gaps"),
    ("segments.1.start", 0.8, "in two segments"),
    ("segments.0.end", 99.0, "within 0 to"),
    ("segments.0.robot", "nobody", "allowed: gantry"),
    ("segments.0.kind", "throw", "allowed: transit"),
    ("segments.2.object", "table", "allowed: cube"),
    ("segments.2.manipulator", "cube", "allowed: hand"),
    ("segments.2.contact_pose", None, "7 numbers"),
]


@pytest.mark.parametrize(
    ("path", "value", "reason"), WRONG, ids=[f"{path}={str(value)[:20]}" for path, value, _ in WRONG]
)
def test_wrong_value_is_refused(plan, path, value, reason):
    wrong = copy.deepcopy(plan)
    container, key = at(wrong, path)
    container[key] = value
    with pytest.raises(InputError) as error:
        check(wrong)
    assert error.value.code == Code.INVALID_PLAN_FILE
    assert reason in error.value.reason


MISSING = ["format", "mode", "scene", "goal", "robots", "trajectory", "segments", "scene.bodies.0.pose", "goal.pose"]
MISSING += ["robots.gantry.q_start", "robots.gantry.urdf", "trajectory.time", "trajectory.joints", "trajectory.objects"]
MISSING += ["trajectory.joints.gantry", "trajectory.gripper.gantry", "segments.2.object", "segments.2.contact_pose"]


@pytest.mark.parametrize("path", MISSING)
def test_missing_key_is_named(plan, path):
    wrong = copy.deepcopy(plan)
    container, key = at(wrong, path)
    del container[key]
    with pytest.raises(InputError) as error:
        check(wrong)
    assert error.value.code == Code.INVALID_PLAN_FILE
    assert key in error.value.reason


@pytest.mark.parametrize("plan", [None, 3, [], "plan", {}])
def test_what_is_no_plan_at_all(plan):
    with pytest.raises(InputError) as error:
        check(plan)
    assert error.value.code == Code.INVALID_PLAN_FILE


def test_the_judge_is_independent():
    """Nothing of hmap_core but the exceptions is imported."""
    for path in Path(hmap_core.validation.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                allowed = name == "hmap_core.exceptions" or name.startswith("hmap_core.validation")
                assert allowed or not name.startswith("hmap"), f"{path.name} imports {name}"
