"""Cell files: a task, the drivers' parameter files, and parameters of nodes, for a graph with real robots."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from hmap.environment import share_path
from hmap_core.exceptions import InputError

KEYS = ("task", "seed", "drivers", "parameters", "record")
NODES = ("perception", "komo_optimiser", "supervisor", "contact_proposer", "waypoint_planner", "recorder", "viewer")
PLANNING = ("komo_optimiser", "supervisor", "contact_proposer", "waypoint_planner")
DRIVERS = ("franka_ros2", "ros2_control", "realsense2_camera", "vicon_receiver", "vrpn_mocap")


@dataclass(frozen=True)
class Cell:
    """A robot cell.

    Attributes:
        task: name or file.
        seed: of its randomisation.
        files: parameter files of the drivers.
        parameters: node -> its parameters, beside those of the files.
        record: whether a bag is written.
    """

    task: str
    seed: int = 0
    files: tuple[Path, ...] = ()
    parameters: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    record: bool = True

    def of(self, node: str, **more: Any) -> dict[str, Any]:
        """The parameters of a node; those of the cell file win."""
        scene = {"task": self.task, "seed": self.seed} if node == "perception" else {}
        return {"use_sim_time": False} | scene | more | dict(self.parameters.get(node, {}))

    def of_planning(self, supervisor: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
        """The parameters of each planning node, and of the supervisor those that are given: they win."""
        found = {node: self.of(node, warm_up=True) for node in PLANNING}
        found["supervisor"] |= supervisor
        return found


def composed(parameters: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """The parameters of several nodes for one process that runs them all: "node:name" -> value."""
    return {f"{node}:{name}": value for node, table in parameters.items() for name, value in table.items()}


def read_cell(path: Path) -> Cell:
    """Read a cell file. Files that it names are relative to its folder.

    Raises:
        InputError: it cannot be read, or an entry is wrong.
    """
    try:
        content = YAML(typ="safe", pure=True).load(path.read_text())
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except (YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is no YAML: {' '.join(str(error).split())}") from error
    if not isinstance(content, dict) or "task" not in content:
        raise InputError(f"{path}: a cell file is a table with the key task; allowed keys: {', '.join(KEYS)}")
    unknown = [key for key in content if key not in KEYS]
    if unknown:
        raise InputError(f"{path}: unknown key {unknown[0]!r}; allowed: {', '.join(KEYS)}")
    task, seed, record = content["task"], content.get("seed", 0), content.get("record", True)
    if not isinstance(task, str) or not task:
        raise InputError(f"{path}: task = {task!r}: the name of a task, or the path of a task file, is needed")
    if not isinstance(seed, int) or isinstance(seed, bool) or seed < 0:
        raise InputError(f"{path}: seed = {seed!r}: a whole number, 0 or larger, is needed")
    if not isinstance(record, bool):
        raise InputError(f"{path}: record = {record!r}: true or false is needed")
    if task.endswith((".yaml", ".yml")):
        task = str((path.parent / task).absolute())
    return Cell(task, seed, _files(path, content.get("drivers", [])), _parameters(path, content), record)


def _files(path: Path, drivers: Any) -> tuple[Path, ...]:
    """The parameter files of the drivers."""
    given = [drivers] if isinstance(drivers, str) else drivers
    if not isinstance(given, list) or not all(isinstance(name, str) for name in given):
        raise InputError(f"{path}: drivers = {drivers!r}: a list of {', '.join(DRIVERS)}, or of files, is needed")
    found = []
    for name in given:
        file = share_path(f"params/{name}.yaml") if name in DRIVERS else path.parent / name
        if not file.is_file():
            raise InputError(f"{path}: drivers: {name!r} is no file, and none of {', '.join(DRIVERS)}")
        found.append(file.absolute())
    return tuple(found)


def _parameters(path: Path, content: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    given = content.get("parameters") or {}
    if not isinstance(given, dict) or not all(isinstance(entry, dict) for entry in given.values()):
        raise InputError(f"{path}: parameters: a table of nodes, each a table of parameters, is needed")
    unknown = [name for name in given if name not in NODES]
    if unknown:
        raise InputError(f"{path}: parameters: unknown node {unknown[0]!r}; allowed: {', '.join(NODES)}")
    return {name: dict(entry) for name, entry in given.items()}
