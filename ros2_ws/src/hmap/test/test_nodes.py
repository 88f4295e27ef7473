"""What holds for every node."""

import ast
import os
import signal
from importlib import import_module
from pathlib import Path

import pytest
import rclpy
from rclpy.node import Node

import hmap
from hmap.commands.run import nodes
from hmap.environment import LAUNCHER
from hmap.naming import Naming
from hmap.node import BAD_INPUT, HmapNode, launcher_died, run
from hmap_core.exceptions import InputError

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


class Parameters:
    """Stands in for a node of which some parameters are set."""

    def __init__(self, **given):
        self._given = given

    def parameter(self, name, default, description):
        return self._given.get(name.removeprefix("names."), default)


def test_formats_of_names_give_the_names_on_the_wire():
    naming = Naming(Parameters(body_pose="vrpn_mocap/{body}/pose"), "body_pose", "camera")
    assert naming.body_pose("bar") == "vrpn_mocap/bar/pose"
    assert naming.camera("overhead") == "camera/overhead"


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("body_pose", "{thing}"),
        ("body_pose", "vicon {body}"),
        ("camera", "camera//{camera}"),
        ("camera", ""),
        ("arm_action", "{robot"),
        ("gripper_action", "1/{robot}"),
    ],
)
def test_a_format_that_gives_no_name_is_refused_with_the_parameter(key, text):
    with pytest.raises(InputError, match=f"names.{key}"):
        Naming(Parameters(**{key: text}), key)


def test_arguments_that_ros_does_not_take_are_bad_input(capfd, monkeypatch):
    monkeypatch.setattr(signal, "signal", lambda *_: None)  # the handlers stay those of pytest
    monkeypatch.setattr("hmap.node.ros_environment", dict)
    arguments = ["--ros-args", "--params-file", "/nowhere/parameters.yaml"]
    assert run(HmapNode, arguments) == BAD_INPUT
    assert "parameters.yaml" in capfd.readouterr().err


def test_no_topic_or_service_name_is_absolute():
    """Absolute names would ignore the namespace."""
    for path in FOLDER.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and getattr(node.func, "attr", "").startswith(
                ("create_", "subscribe", "serve")
            ):
                texts = [a.value for a in node.args if isinstance(a, ast.Constant) and isinstance(a.value, str)]
                assert not [text for text in texts if text.startswith("/")], path


def test_a_node_knows_whether_its_launcher_lives(monkeypatch):
    monkeypatch.delenv(LAUNCHER, raising=False)
    assert not launcher_died()
    monkeypatch.setenv(LAUNCHER, str(os.getppid()))
    assert not launcher_died()
    monkeypatch.setenv(LAUNCHER, str(os.getpid()))  # any process but the parent
    assert launcher_died()
