"""A cell with real robots on a native ROS installation: ``ros2 launch hmap cell.launch.py cell:=my_cell.yaml``.

The same nodes as ``hmap cell my_cell.yaml`` starts; the drivers run already. ``hmap doctor`` looks at everything.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from hmap.launcher.cell import read_cell

PLANNERS = ("waypoint_planner", "contact_proposer", "komo_optimiser")
RESPAWN_PATIENCE = 30.0  # s that the supervisor waits for a node that is started anew
ARGUMENTS = {
    "cell": ("", "the cell file"),
    "dry_run": ("false", "plan and show, and never move anything"),
    "bag": ("bag", "folder of the bag; must not exist yet"),
}


def generate_launch_description() -> LaunchDescription:
    """All nodes; planners and perception are started anew when they die."""
    declared = [DeclareLaunchArgument(name, default_value=d, description=text) for name, (d, text) in ARGUMENTS.items()]
    return LaunchDescription([*declared, OpaqueFunction(function=_nodes)])


def _nodes(context) -> list[Node]:
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    cell = read_cell(Path(value["cell"]))
    patience = {"service_patience": RESPAWN_PATIENCE, "state_patience": RESPAWN_PATIENCE}
    dry = {"dry_run": True} if value["dry_run"] == "true" else {}
    supervisor = cell.of("supervisor", warm_up=True, **patience) | dry
    nodes = [_node("perception", cell, cell.of("perception"), respawn=True), _node("supervisor", cell, supervisor)]
    nodes += [_node(name, cell, cell.of(name, warm_up=True), respawn=True) for name in PLANNERS]
    if cell.record:
        nodes.append(_node("recorder", cell, cell.of("recorder", path=value["bag"]), respawn=False))
    return nodes


def _node(name: str, cell, parameters: dict, **more) -> Node:
    files = [str(file) for file in cell.files]
    return Node(package="hmap", executable=name, name=name, parameters=[*files, parameters], output="screen", **more)
