"""Stand-ins of ``launch`` and ``launch_ros``, which the wheels lack: what a launch file would start, and with what.

They take the arguments that the real classes of ROS 2 Jazzy take, and refuse others.
"""

import sys
import types
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any


class Context(dict):
    """The launch arguments by name."""


class Substitution:
    """Text that is known at the start only."""

    def perform(self, context: Context) -> str:
        raise NotImplementedError


def text_of(value: Any, context: Context) -> str:
    """The text of a string, a substitution, or a list of both."""
    if isinstance(value, str):
        return value
    if isinstance(value, Substitution):
        return value.perform(context)
    assert isinstance(value, list), f"{value!r} is no substitution"
    return "".join(text_of(part, context) for part in value)


@dataclass
class LaunchConfiguration(Substitution):
    name: str

    def perform(self, context: Context) -> str:
        return context[self.name]


@dataclass
class PythonExpression(Substitution):
    expression: list

    def perform(self, context: Context) -> str:
        return str(eval(text_of(self.expression, context), {}))


def truth(text: str) -> bool:
    """What conditions take for true and false."""
    word = text.strip().lower()
    assert word in ("true", "1", "false", "0"), f"{text!r} is no condition"
    return word in ("true", "1")


@dataclass
class IfCondition:
    predicate: Any

    def holds(self, context: Context) -> bool:
        return truth(text_of(self.predicate, context))


class UnlessCondition(IfCondition):
    def holds(self, context: Context) -> bool:
        return not super().holds(context)


@dataclass
class DeclareLaunchArgument:
    name: str
    default_value: str
    description: str


@dataclass
class OpaqueFunction:
    function: Any


@dataclass
class ParameterValue:
    value: Any
    value_type: type

    def read(self, context: Context) -> Any:
        text = text_of(self.value, context)
        return truth(text) if self.value_type is bool else self.value_type(text)


@dataclass(kw_only=True)
class Node:
    package: str
    executable: str
    name: str | None = None
    parameters: list = field(default_factory=list)
    ros_arguments: list = field(default_factory=list)
    condition: IfCondition | None = None
    respawn: bool = False
    output: str = "log"

    def arguments(self, context: Context) -> tuple[list[str], dict[str, Any]]:
        """Its ROS arguments with parameter files, and its parameters."""
        words = [text_of(word, context) for word in self.ros_arguments]
        words += [f"__node:={self.name}"] if self.name else []
        values: dict[str, Any] = {}
        for entry in self.parameters:
            if isinstance(entry, Mapping):
                values |= {k: v.read(context) if isinstance(v, ParameterValue) else v for k, v in entry.items()}
            else:
                words += ["--params-file", text_of(entry, context)]
        return words, values


@dataclass
class LaunchDescription:
    entities: list

    def nodes(self, **given: str) -> Iterator[tuple[Node, list[str], dict[str, Any]]]:
        """The nodes that are started with launch arguments, with their ROS arguments and parameters."""
        declared = {e.name: e.default_value for e in self.entities if isinstance(e, DeclareLaunchArgument)}
        assert not given.keys() - declared.keys()
        context = Context(declared | given)
        for entity in self.entities:
            made = entity.function(context) if isinstance(entity, OpaqueFunction) else [entity]
            for node in made:
                if isinstance(node, Node) and (node.condition is None or node.condition.holds(context)):
                    yield node, *node.arguments(context)


MODULES = {
    "launch": {"LaunchDescription": LaunchDescription},
    "launch.actions": {"DeclareLaunchArgument": DeclareLaunchArgument, "OpaqueFunction": OpaqueFunction},
    "launch.conditions": {"IfCondition": IfCondition, "UnlessCondition": UnlessCondition},
    "launch.substitutions": {"LaunchConfiguration": LaunchConfiguration, "PythonExpression": PythonExpression},
    "launch_ros": {},
    "launch_ros.actions": {"Node": Node},
    "launch_ros.parameter_descriptions": {"ParameterValue": ParameterValue},
}


def load(file: Path, monkeypatch) -> LaunchDescription:
    """The launch description of a file."""
    for name, content in MODULES.items():
        module = types.ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    spec = spec_from_file_location(file.name.replace(".", "_"), file)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.generate_launch_description()
