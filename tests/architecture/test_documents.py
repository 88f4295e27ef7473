"""Every test that a page of the documentation names is there."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NAMED = re.compile(r"`(test_\w+\.py)::(test_\w+)`")


def names_in(name: str) -> set[str]:
    """The tests in the files of a name."""
    folders = (ROOT / "tests", ROOT / "ros2_ws" / "src", ROOT / "hmap_msgs_py" / "test")
    trees = [ast.parse(path.read_text()) for folder in folders for path in folder.rglob(name)]
    return {node.name for tree in trees for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_tests_that_the_pages_name_are_there():
    named = {pair for path in (ROOT / "docs").rglob("*.md") for pair in NAMED.findall(path.read_text())}
    assert named, "docs/hardware.md has a table of them"
    assert not [f"{file}::{test}" for file, test in sorted(named) if test not in names_in(file)]
