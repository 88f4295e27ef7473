"""The whole graph on a native ROS installation: ``ros2 launch hmap hmap.launch.py task:=tunnel seed:=0``.

Then send a goal: ``ros2 action send_goal --feedback manipulate hmap_msgs/action/Manipulate "{}"``.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition, UnlessCondition
from launch.substitutions import LaunchConfiguration, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from hmap.launcher.processes import COMPOSED, RESPAWN_PATIENCE

(PROCESS, TOGETHER), *_ = COMPOSED.items()  # the process with supervisor and planners, and its nodes
PLANNERS = [name for name in TOGETHER if name != "supervisor"]
WARM = {"warm_up": True}  # plan a small task while waiting, so that the first goal is as fast as later ones
ARGUMENTS = {
    "task": ("tunnel", "name of a task, or path of a task file"),
    "seed": ("0", "of its randomisation"),
    "simulate": ("true", "start the simulated world; false with real robots"),
    "real_time_factor": ("4.0", "speed of the simulation"),
    "record": ("true", "write a bag"),
    "dynamic_obstacles": ("0", "bodies that appear near the path, seen by the cameras only; simulated world only"),
    "composed": ("false", "supervisor and planners in one process, without services between them"),
    "viewer": ("true", "offer the page for the browser"),
    "bag": ("bag", "folder of the bag; must not exist yet"),
}


def generate_launch_description() -> LaunchDescription:
    """All nodes; planners and perception are started anew when they die."""
    value = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    scene = {
        "task": ParameterValue(value["task"], value_type=str),
        "seed": ParameterValue(value["seed"], value_type=int),
    }
    clock = {"use_sim_time": ParameterValue(value["simulate"], value_type=bool)}
    speed = {"real_time_factor": ParameterValue(value["real_time_factor"], value_type=float)}
    bag = {"path": ParameterValue(value["bag"], value_type=str)}
    appear = PythonExpression([value["dynamic_obstacles"], " > 0"])
    hidden = {"announce_added": ParameterValue(PythonExpression(["not ", appear]), value_type=bool)}
    obstacles = {
        "count": ParameterValue(value["dynamic_obstacles"], value_type=int),
        "seed": ParameterValue(value["seed"], value_type=int),
    }
    patience = {"service_patience": RESPAWN_PATIENCE, "state_patience": RESPAWN_PATIENCE}
    apart, together = UnlessCondition(value["composed"]), IfCondition(value["composed"])
    given = [f"{name}:warm_up:=true" for name in TOGETHER]
    given += [f"supervisor:{name}:={seconds}" for name, seconds in patience.items()]
    words = [word for text in (*given, ["supervisor:use_sim_time:=", value["simulate"]]) for word in ("-p", text)]
    nodes = [
        _node("world", [scene, speed, hidden], condition=IfCondition(value["simulate"])),
        _node("dynamic_obstacles", [clock, obstacles], condition=IfCondition(appear)),
        _node("perception", [clock], condition=IfCondition(value["simulate"]), respawn=True),
        _node("perception", [clock, scene], condition=UnlessCondition(value["simulate"]), respawn=True),
        _node("recorder", [clock, bag], condition=IfCondition(value["record"])),
        _node("viewer", [], condition=IfCondition(value["viewer"]), respawn=True),
        _node("supervisor", [clock, WARM, patience], condition=apart),
        *[_node(name, [WARM], condition=apart, respawn=True) for name in PLANNERS],
        # without a name, which would become that of all nodes in the process
        Node(package="hmap", executable=PROCESS, ros_arguments=words, condition=together, output="screen"),
    ]
    declared = [DeclareLaunchArgument(name, default_value=d, description=text) for name, (d, text) in ARGUMENTS.items()]
    return LaunchDescription([*declared, *nodes])


def _node(name: str, parameters: list, **more) -> Node:
    return Node(package="hmap", executable=name, name=name, parameters=parameters, output="screen", **more)
