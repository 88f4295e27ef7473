"""Names of joints, controllers and cameras in ROS: parameters, because every driver has its own names.

In a format, ``{robot}`` is the robot's name in the scene, ``{joint}`` the joint's name in its model, ``{number}`` its
number in the arm from 1, ``{camera}`` the camera's name and ``{body}`` the body's.
"""

from rclpy.exceptions import InvalidTopicNameException
from rclpy.expand_topic_name import expand_topic_name
from rclpy.validate_full_topic_name import validate_full_topic_name
from rclpy.validate_topic_name import validate_topic_name

from hmap.node import HmapNode
from hmap_core.exceptions import InputError
from hmap_core.types import RobotModel

FORMATS = {
    "arm_joint": ("{robot}_{joint}", "name of an arm joint in joint_states and trajectories; FR3: fr3_joint{number}"),
    "finger_joint": ("{robot}_{joint}", "name of a finger joint in joint_states"),
    "arm_action": (
        "{robot}_arm_controller/follow_joint_trajectory",
        "FollowJointTrajectory action of an arm; FR3: fr3_arm_controller/follow_joint_trajectory",
    ),
    "gripper_action": (
        "{robot}_gripper/gripper_cmd",
        "GripperCommand action of a gripper; FR3: franka_gripper/gripper_action",
    ),
    "camera": ("camera/{camera}", "namespace of a camera's topics, which are called as realsense2_camera does"),
    "body_pose": ("vicon/{body}/{body}", "PoseStamped topic of a body; vrpn_mocap: vrpn_mocap/{body}/pose"),
}
OPTICAL_FRAME = "{camera}_color_optical_frame"  # as realsense2_camera names it
ON_THE_GRAPH = ("arm_action", "gripper_action", "camera", "body_pose")  # names of topics and actions
FIELDS = dict.fromkeys(("robot", "joint", "number", "camera", "body"), "x")


class Naming:
    """Names in ROS, from the parameters ``names.*`` of a node.

    Args:
        node: declares the parameters.
        used: the keys of FORMATS that the node uses.

    Raises:
        InputError: a format has an unknown field, or gives no valid topic name.
    """

    def __init__(self, node: HmapNode, *used: str):
        self._formats = {key: node.parameter(f"names.{key}", *FORMATS[key]) for key in used}
        for key, text in self._formats.items():
            try:
                name = text.format(**FIELDS)
            except (KeyError, ValueError, IndexError) as error:
                allowed = ", ".join(f"{{{name}}}" for name in FIELDS)
                raise InputError(
                    f"parameter names.{key} = {text!r}: unknown field {error}; allowed: {allowed}"
                ) from None
            if key in ON_THE_GRAPH:
                _check(key, text, name)

    def arm_joints(self, robot: str, model: RobotModel) -> list[str]:
        """Names of the arm's joints, base to tip."""
        return self._joints("arm_joint", robot, model.joint_names)

    def finger_joints(self, robot: str, model: RobotModel) -> list[str]:
        """Names of the gripper's joints; empty without a gripper."""
        return self._joints("finger_joint", robot, model.gripper.joint_names if model.gripper else ())

    def arm_action(self, robot: str) -> str:
        """Name of an arm's FollowJointTrajectory action."""
        return self._formats["arm_action"].format(robot=robot)

    def gripper_action(self, robot: str) -> str:
        """Name of a gripper's GripperCommand action."""
        return self._formats["gripper_action"].format(robot=robot)

    def camera(self, camera: str) -> str:
        """Namespace of a camera's topics."""
        return self._formats["camera"].format(camera=camera)

    def body_pose(self, body: str) -> str:
        """Topic of a body's pose."""
        return self._formats["body_pose"].format(body=body)

    def _joints(self, key: str, robot: str, joints) -> list[str]:
        text = self._formats[key]
        return [text.format(robot=robot, joint=joint, number=i + 1) for i, joint in enumerate(joints)]


def _check(key: str, text: str, name: str) -> None:
    try:
        validate_topic_name(name)
        validate_full_topic_name(expand_topic_name(name, "node", "/"))
    except InvalidTopicNameException as error:
        raise InputError(f"parameter names.{key} = {text!r}: {str(error).splitlines()[0]}") from None
