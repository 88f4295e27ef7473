"""A cell with real robots on a native ROS installation: ``ros2 launch hmap cell.launch.py cell:=my_cell.yaml``.

The same nodes as ``hmap cell my_cell.yaml`` starts; the drivers run already. ``hmap doctor`` looks at everything.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from hmap.launcher.cell import Cell, composed, read_cell
from hmap.launcher.processes import RESPAWN_PATIENCE, assignments

ARGUMENTS = {
    "cell": ("", "the cell file"),
    "dry_run": ("false", "plan and show, and never move anything"),
    "composed": ("false", "supervisor and planners in one process, without services between them"),
    "viewer": ("true", "offer the page for the browser"),
    "enclaves": ("", "of SROS2, such as /hmap: each process gets the enclave of its name in it; empty: none"),
    "bag": ("bag", "folder of the bag; must not exist yet"),
}


def generate_launch_description() -> LaunchDescription:
    """All nodes; planners and perception are started anew when they die."""
    declared = [DeclareLaunchArgument(name, default_value=d, description=text) for name, (d, text) in ARGUMENTS.items()]
    return LaunchDescription([*declared, OpaqueFunction(function=_nodes)])


def _nodes(context) -> list[Node]:
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    cell = read_cell(Path(value["cell"]))
    enclaves = value["enclaves"]
    nodes = [_node("perception", cell, cell.of("perception"), enclaves, respawn=True)]
    supervisor = {"dry_run": True} if _yes(value["dry_run"]) else {}
    patience = {"service_patience": RESPAWN_PATIENCE, "state_patience": RESPAWN_PATIENCE}
    parameters = cell.of_planning(supervisor)
    parameters["supervisor"] = patience | parameters["supervisor"]
    if _yes(value["composed"]):
        # without a name, which would become that of all nodes in the process; what is given last wins
        given = [word for file in cell.files for word in ("--params-file", str(file))]
        given += [word for text in assignments(composed(parameters)) for word in ("-p", text)]
        given += _enclave(enclaves, "composed_planning")
        nodes.append(Node(package="hmap", executable="composed_planning", ros_arguments=given, output="screen"))
    else:
        nodes += [
            _node(name, cell, table, enclaves, respawn=name != "supervisor") for name, table in parameters.items()
        ]
    if cell.record:
        nodes.append(_node("recorder", cell, cell.of("recorder", path=value["bag"]), enclaves, respawn=False))
    if _yes(value["viewer"]):
        nodes.append(_node("viewer", cell, cell.of("viewer"), enclaves, respawn=True))
    return nodes


def _yes(text: str) -> bool:
    return text.lower() in ("true", "1")


def _node(name: str, cell: Cell, parameters: dict, enclaves: str, **more) -> Node:
    given = {"parameters": [*map(str, cell.files), parameters], "ros_arguments": _enclave(enclaves, name)}
    return Node(package="hmap", executable=name, name=name, output="screen", **given, **more)


def _enclave(enclaves: str, process: str) -> list[str]:
    return ["--enclave", f"{enclaves.rstrip('/')}/{process}"] if enclaves else []
