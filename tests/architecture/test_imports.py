"""Imports go one way, and the planner knows no ROS. The order of the layers is that of docs and CONTRIBUTING.md."""

import ast
import re
from pathlib import Path

import pytest

from hmap_core.benchmark.generality.registry import FAMILIES

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ROOT / "ros2_ws" / "src"
PACKAGES = {
    "hmap_scenes": SOURCES / "hmap_scenes" / "hmap_scenes",
    "hmap_core": SOURCES / "hmap_core" / "hmap_core",
    "hmap_msgs_py": ROOT / "hmap_msgs_py" / "hmap_msgs_py",
    "hmap": SOURCES / "hmap" / "hmap",
}
MAY_IMPORT = {
    "hmap_scenes": set(),
    "hmap_core": {"hmap_scenes"},
    "hmap_msgs_py": {"hmap_msgs"},
    "hmap": {"hmap_core", "hmap_scenes", "hmap_msgs", "hmap_msgs_py"},
}
OURS = {"hmap", "hmap_core", "hmap_msgs", "hmap_msgs_py", "hmap_scenes"}
ROS_PREFIXES = ("rclpy", "rcl_", "ament_", "rosidl_", "launch", "tf2_", "rosbag2")

# Inside hmap_core a module imports modules of lower layers, and of its own where that makes no circle; lowest first.
LAYERS = (
    {
        "arguments",
        "array_cache",
        "cache_locator",
        "clock",
        "command_line",
        "compile_cache",
        "deadline",
        "deferred",
        "exceptions",
        "garbage",
        "lazy",
        "obj_text",
        "regular_file",
        "timed_work",
        "transforms",
    },
    {"types"},
    {"mesh_files"},
    {"robot_description"},
    {"scenes"},
    {"kinematics", "collision", "plan_file", "trajectory"},
    {"komo", "stability", "validation"},
    {"waypoints", "contacts"},
    {"planner"},
    {"baselines"},
    {"execution"},
    {"simulation"},
    {"benchmark", "evaluation", "learning", "robot_setup", "viz"},
    {"viewer"},
    {"precompile"},
    {"cli"},
    {"__main__"},
)
# The judge must not share the planner's models, so that an error in them cannot hide.
PLANNING = {
    "kinematics",
    "collision",
    "komo",
    "stability",
    "validation",
    "waypoints",
    "contacts",
    "trajectory",
    "execution",
    "planner",
}
JUDGE_MAY_IMPORT = {"exceptions", "validation"}
# Only the simulation knows PyBullet; these use the simulation: a path inside the package, or a folder of it.
SIMULATION = "hmap_core.simulation"
SIMULATION_USERS = {
    "hmap_core": {
        "simulation",
        "evaluation",
        "robot_setup",
        "viz",
        "cli/bench_robustness.py",
        "cli/execute.py",
        "learning/motions.py",
    },
    "hmap": {"world", "nodes/world.py", "nodes/dynamic_obstacles.py"},
}


def imports(path: Path, package: Path) -> set[str]:
    """Every dotted name that a file imports, those inside functions included; relative ones made absolute."""
    names = set()
    parents = (package.name, *path.relative_to(package).parts[:-1])
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), str(path))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(parents[: len(parents) - node.level + 1]) if node.level else ""
            module = ".".join(part for part in (base, node.module) if part)
            names |= {f"{module}.{alias.name}" for alias in node.names}
    return names


def is_ros(name: str) -> bool:
    """Whether a top-level module belongs to ROS."""
    return name.startswith(ROS_PREFIXES) or name.endswith("_msgs")


def files(package: str) -> list[Path]:
    return sorted(PACKAGES[package].rglob("*.py"))


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_import_one_way(package):
    wrong = []
    for path in files(package):
        tops = {name.split(".")[0] for name in imports(path, PACKAGES[package])} & OURS
        wrong += [f"{path.relative_to(ROOT)} imports {top}" for top in tops - MAY_IMPORT[package] - {package}]
    assert not wrong


@pytest.mark.parametrize("package", ["hmap_core", "hmap_scenes"])
def test_core_knows_no_ros(package):
    wrong = []
    for path in files(package):
        tops = {name.split(".")[0] for name in imports(path, PACKAGES[package])}
        wrong += [f"{path.relative_to(ROOT)} imports {top}" for top in tops if is_ros(top)]
    assert not wrong


@pytest.mark.parametrize("package", PACKAGES)
def test_only_the_simulation_imports_pybullet(package):
    """Its data package is found by path, and not imported either."""
    wrong = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in files(package)
        for name in imports(path, PACKAGES[package])
        if name.split(".")[0].startswith("pybullet")
        and not (package == "hmap_core" and path.is_relative_to(PACKAGES[package] / "simulation"))
    ]
    assert not wrong


@pytest.mark.parametrize("package", PACKAGES)
def test_only_users_at_the_top_import_the_simulation(package):
    allowed = [PACKAGES[package] / name for name in SIMULATION_USERS.get(package, ())]
    assert all(path.exists() for path in allowed)
    wrong = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in files(package)
        for name in imports(path, PACKAGES[package])
        if f"{name}.".startswith(f"{SIMULATION}.") and not any(path.is_relative_to(user) for user in allowed)
    ]
    assert not wrong


def core_imports(path: Path) -> set[str]:
    """The modules right inside hmap_core that a file of it imports."""
    found = imports(path, PACKAGES["hmap_core"])
    return {name.split(".")[1] for name in found if name.startswith("hmap_core.")}


def layer_of(module: str) -> int | None:
    return next((i for i, layer in enumerate(LAYERS) if module in layer), None)


def module_of(path: Path) -> str:
    return path.relative_to(PACKAGES["hmap_core"]).parts[0].removesuffix(".py")


def test_every_core_module_has_a_layer():
    modules = {module_of(path) for path in files("hmap_core")} - {"__init__"}
    assert {module for module in modules if layer_of(module) is None} == set()


def test_core_imports_downwards():
    wrong = []
    for path in files("hmap_core"):
        module = module_of(path)
        if module == "__init__":
            continue
        for imported in core_imports(path) - {module}:
            lower = layer_of(imported)
            if lower is not None and lower > layer_of(module):
                wrong.append(f"{path.relative_to(ROOT)} imports {imported}")
    assert not wrong


def test_core_modules_make_no_circle():
    edges = {}
    for path in files("hmap_core"):
        module = module_of(path)
        found = {name for name in core_imports(path) if layer_of(name) is not None}
        edges.setdefault(module, set()).update(found - {module})
    circle = set(edges)
    while True:  # drop who imports nothing of the rest, and whom nothing of the rest imports
        used = set().union(*(edges[module] for module in circle))
        kept = {module for module in circle & used if edges[module] & circle}
        if kept == circle:
            break
        circle = kept
    assert not circle


def test_judge_is_independent():
    wrong = []
    for path in files("hmap_core"):
        if module_of(path) == "validation":
            known = {name for name in core_imports(path) if layer_of(name) is not None}
            wrong += [f"{path.name} imports {name}" for name in known - JUDGE_MAY_IMPORT]
    assert not wrong


def test_the_planner_knows_no_task():
    """What a task needs is in its file: no name of one that comes with hmap, nor its first word, is in the code."""
    tasks = (SOURCES / "hmap_scenes" / "hmap_scenes" / "tasks").rglob("*.yaml")
    names = {name for task in tasks for name in (task.stem, task.stem.split("_")[0])}
    word = re.compile(rf"\b({'|'.join(sorted(names))})\b", re.IGNORECASE)
    found = {
        f"{path.relative_to(SOURCES)}: {match.group()}"
        for path in files("hmap_core")
        if module_of(path) in PLANNING
        for match in word.finditer(path.read_text(encoding="utf-8"))
    }
    assert not found


def test_the_planner_knows_no_family_of_generated_tasks():
    """Nor imports what generates them."""
    names = [family.name for family in FAMILIES.values()]
    word = re.compile(rf"\b({'|'.join(names)}|benchmark\.generality)\b", re.IGNORECASE)
    found = {
        f"{path.relative_to(SOURCES)}: {match.group()}"
        for path in files("hmap_core")
        if module_of(path) in PLANNING
        for match in word.finditer(path.read_text(encoding="utf-8"))
    }
    assert not found


def test_checker_sees_what_it_should(tmp_path):
    """A forbidden import inside a function, and relative ones."""
    package = tmp_path / "pkg"
    (package / "sub").mkdir(parents=True)
    file = package / "sub" / "a.py"
    inside = "def f():\n    import rclpy.node\n"
    file.write_text(inside + "from ..other import x\nfrom . import y\nfrom sensor_msgs.msg import Image\n")
    found = imports(file, package)
    assert found == {"rclpy.node", "pkg.other.x", "pkg.sub.y", "sensor_msgs.msg.Image"}
    assert is_ros("sensor_msgs") and is_ros("rclpy") and not is_ros("hmap_msgs_py") and not is_ros("numpy")
