"""Modules stay short, and the planner's layout is what its pages say."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ROOT / "ros2_ws" / "src"
FOLDERS = (
    SOURCES / "hmap_core" / "hmap_core",
    SOURCES / "hmap" / "hmap",
    SOURCES / "hmap_scenes" / "hmap_scenes",
    ROOT / "hmap_msgs_py" / "hmap_msgs_py",
)
LONGEST = 500  # lines
TWO_SCREENS = 200  # lines, of the file with the three loops
PLANNER = SOURCES / "hmap_core" / "hmap_core" / "planner"
STRATEGIES = PLANNER / "strategies"


def modules() -> list[Path]:
    return sorted(path for folder in FOLDERS for path in folder.rglob("*.py"))


@pytest.mark.parametrize("path", modules(), ids=lambda path: path.relative_to(ROOT).as_posix())
def test_no_module_is_longer_than_it_may_be(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= LONGEST


def test_the_three_loops_fit_on_two_screens():
    assert len((PLANNER / "search.py").read_text(encoding="utf-8").splitlines()) <= TWO_SCREENS


@pytest.mark.parametrize(
    "path",
    [p for p in sorted(STRATEGIES.rglob("*.py")) if p.name not in ("__init__.py", "base.py")],
    ids=lambda path: path.relative_to(STRATEGIES).as_posix(),
)
def test_a_strategy_has_a_name_and_the_two_methods_of_the_protocol(path):
    classes = [node for node in ast.parse(path.read_text()).body if isinstance(node, ast.ClassDef)]
    assert classes
    for node in classes:
        methods = {entry.name for entry in node.body if isinstance(entry, ast.FunctionDef)}
        attributes = {
            t.id for e in node.body if isinstance(e, ast.Assign) for t in e.targets if isinstance(t, ast.Name)
        }
        assert {"applies", "solve"} <= methods and "name" in attributes


def test_every_strategy_is_in_a_list():
    listed = set()
    for path in (STRATEGIES / "__init__.py", STRATEGIES / "repair" / "__init__.py"):
        listed |= {node.func.id for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Call)}
    made = {
        node.name
        for path in STRATEGIES.rglob("*.py")
        if path.name != "base.py"
        for node in ast.parse(path.read_text()).body
        if isinstance(node, ast.ClassDef)
    }
    assert made == listed


def test_only_the_simulation_imports_the_physics_engine():
    wrong = []
    for path in modules():
        names = {
            alias.name if isinstance(node, ast.Import) else node.module
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.Import | ast.ImportFrom)
            for alias in node.names
        }
        inside = "simulation" in path.relative_to(ROOT).parts
        if any(name and name.split(".")[0] in ("pybullet", "pybullet_utils") for name in names) and not inside:
            wrong.append(path.relative_to(ROOT).as_posix())
    assert not wrong
