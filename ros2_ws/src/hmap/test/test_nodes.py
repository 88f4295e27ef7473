"""What holds for every node."""

import ast
from importlib import import_module
from pathlib import Path

import pytest
import rclpy
from rclpy.node import Node

import hmap
from hmap.commands.run import nodes

FOLDER = Path(hmap.__file__).parent
OFFERS = ("create_", "subscribe", "serve")  # methods that take a name on the wire


@pytest.fixture(scope="module")
def names_of_rclpy():
    rclpy.init()
    node = rclpy.create_node("names")
    names = set(vars(node)) | set(dir(Node))
    node.destroy_node()
    rclpy.shutdown()
    return {name for name in names if not name.startswith("__")}


@pytest.mark.parametrize("path", [FOLDER / "node.py", *sorted((FOLDER / "nodes").glob("*.py"))], ids=lambda p: p.stem)
def test_no_attribute_hides_one_of_rclpy(path, names_of_rclpy):
    """rclpy keeps its state in private attributes of the node; hiding one breaks it in strange ways."""
    own = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store) and isinstance(node.value, ast.Name):
            own |= {node.attr} if node.value.id == "self" else set()
        if isinstance(node, ast.ClassDef):
            own |= {entry.name for entry in node.body if isinstance(entry, ast.FunctionDef)}
    assert not own & names_of_rclpy


@pytest.mark.parametrize("name", nodes())
def test_every_node_has_a_main(name):
    assert callable(import_module(f"hmap.nodes.{name}").main)


def test_no_topic_or_service_name_is_absolute():
    """Absolute names would ignore the namespace."""
    for path in FOLDER.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and getattr(node.func, "attr", "").startswith(
                ("create_", "subscribe", "serve")
            ):
                texts = [a.value for a in node.args if isinstance(a, ast.Constant) and isinstance(a.value, str)]
                assert not [text for text in texts if text.startswith("/")], path
