"""The world as RViz, Foxglove and other programs know it: tf, robot descriptions, markers of bodies, and a cloud.

Frames: ``world``; a robot's links are ``<robot>/<link>``, as RViz' "TF Prefix" has it; a body is called as in the
scene, a camera's optical frame as in its pictures.
"""

import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Transform, TransformStamped, Vector3
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import ColorRGBA, Header, String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from hmap.naming import OPTICAL_FRAME
from hmap.node import LATCHED, HmapNode
from hmap_core.kinematics.joint_poses import JointPoses
from hmap_core.robot_description import cleaned_urdf, load_robot_description
from hmap_core.transforms import apply, rotation_matrix
from hmap_core.types import Body, BodyKind, RobotModel, Scene, SceneState, Shape, ShapeKind
from hmap_msgs_py.clouds import cloud_to_message
from hmap_msgs_py.poses import pose_to_message

FRAME = "world"
TF_DEPTH = 100  # messages, as tf2_ros has it
REPEAT = 1.0  # s of real time after which transforms that have not changed are published again
SAME = 1e-6  # m or 1
COLORS = {
    BodyKind.FIXED: (0.72, 0.72, 0.74, 1.0),
    BodyKind.MOVABLE: (0.20, 0.45, 0.80, 1.0),
    BodyKind.TOOL: (0.85, 0.60, 0.20, 1.0),
}


class StandardTopics:
    """Publishes ``tf``, ``tf_static``, ``<robot>/robot_description``, ``scene_markers`` and ``points``.

    Args:
        node: that publishes.
    """

    def __init__(self, node: HmapNode):
        self._node = node
        self._tf = node.create_publisher(TFMessage, "tf", QoSProfile(depth=TF_DEPTH))
        self._static = node.create_publisher(TFMessage, "tf_static", LATCHED)
        self._markers = node.create_publisher(MarkerArray, "scene_markers", LATCHED)
        self._points = node.create_publisher(PointCloud2, "points", LATCHED)
        self._descriptions: dict[str, Publisher] = {}
        self._joints: dict[str, JointPoses] = {}
        self._last: tuple[float, np.ndarray] = (-np.inf, np.zeros(0))

    def load(self, scene: Scene, stamp: Time) -> None:
        """A scene was loaded, or its bodies have changed."""
        self._last = (-np.inf, np.zeros(0))
        self._joints = {name: JointPoses(robot.model) for name, robot in scene.robots.items()}
        for name in self._descriptions.keys() - scene.robots.keys():
            self._node.destroy_publisher(self._descriptions.pop(name))
        for name, robot in scene.robots.items():
            if name not in self._descriptions:
                topic = f"{name}/robot_description"
                self._descriptions[name] = self._node.create_publisher(String, topic, LATCHED)
            self._descriptions[name].publish(String(data=urdf_text(name, robot.model)))
        self._static.publish(TFMessage(transforms=self._fixed(scene, stamp)))
        self._markers.publish(body_markers(scene.bodies.values(), stamp))

    def show(self, scene: Scene, state: SceneState, stamp: Time) -> None:
        """Publish the transforms of a state that have changed since the last one, or all after REPEAT."""
        poses: dict[tuple[str, str], np.ndarray] = {}
        for name, joints in self._joints.items():
            for link, T in joints.moving(state.q[name], state.gripper[name]).items():
                poses[f"{name}/{joints.parents[link]}", f"{name}/{link}"] = T
        for name, body in scene.bodies.items():
            if body.kind is not BodyKind.FIXED:
                poses[FRAME, name] = state.poses[name]
        values, now = np.array(list(poses.values())).reshape(-1, 7), time.monotonic()
        at, before = self._last
        if now - at < REPEAT and before.shape == values.shape and np.abs(values - before).max(initial=0.0) < SAME:
            return
        self._last = now, values
        self._tf.publish(TFMessage(transforms=[_transform(*frames, T, stamp) for frames, T in poses.items()]))

    def show_points(self, clouds: Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]], stamp: Time) -> None:
        """Publish what cameras see as one cloud: object -> its pose (7,), points and normals (N, 3) in its frame."""
        points = [apply(T, p) for T, p, _ in clouds.values()]
        normals = [n @ rotation_matrix(T).T for T, _, n in clouds.values()]
        if points:
            self._points.publish(cloud_to_message(np.concatenate(points), np.concatenate(normals), FRAME, stamp))

    def _fixed(self, scene: Scene, stamp: Time) -> list[TransformStamped]:
        """The transforms that never change."""
        found = []
        for name, joints in self._joints.items():
            found.append(_transform(FRAME, f"{name}/{joints.root}", scene.robots[name].base_pose, stamp))
            for link, T in joints.fixed.items():
                found.append(_transform(f"{name}/{joints.parents[link]}", f"{name}/{link}", T, stamp))
        for name, body in scene.bodies.items():
            if body.kind is BodyKind.FIXED:
                found.append(_transform(FRAME, name, body.pose, stamp))
        for name, camera in scene.cameras.items():
            found.append(_transform(FRAME, OPTICAL_FRAME.format(camera=name), camera.pose, stamp))
        return found


def urdf_text(name: str, model: RobotModel) -> str:
    """A robot's URDF with its name in the scene, and meshes at absolute addresses, as every reader finds them.

    Raises:
        InputError: its description has errors.
    """
    path = cleaned_urdf(load_robot_description(model.urdf).require_valid())
    robot = ElementTree.parse(path).getroot()
    robot.set("name", name)
    for mesh in robot.iter("mesh"):
        mesh.set("filename", Path(mesh.get("filename", "")).absolute().as_uri())
    return ElementTree.tostring(robot, encoding="unicode")


def body_markers(bodies: Iterable[Body], stamp: Time) -> MarkerArray:
    """The shapes of bodies, each in the frame of its body; the first marker deletes those before."""
    made = [Marker(header=Header(stamp=stamp, frame_id=FRAME), action=Marker.DELETEALL)]
    for body in bodies:
        r, g, b, a = body.color or COLORS[body.kind]
        for k, (shape, kind, size, pose) in enumerate(_drawn(body)):
            marker = Marker(
                header=Header(stamp=stamp, frame_id=body.name),
                ns=body.name,
                id=k,
                type=kind,
                action=Marker.ADD,
                frame_locked=True,  # moves with the frame
                pose=pose_to_message(pose),
                scale=Vector3(x=size[0], y=size[1], z=size[2]),
                color=ColorRGBA(r=float(r), g=float(g), b=float(b), a=float(a)),
            )
            if shape.mesh is not None:
                marker.mesh_resource = shape.mesh.absolute().as_uri()
            made.append(marker)
    return MarkerArray(markers=made)


def _drawn(body: Body) -> Iterable[tuple[Shape, int, tuple[float, float, float], np.ndarray]]:
    """Shape, type, scale and pose of the markers of a body; a capsule is a cylinder with two balls."""
    for shape in body.shapes:
        size = [float(number) for number in shape.size]
        if shape.kind is ShapeKind.BOX or shape.kind is ShapeKind.MESH:
            kind = Marker.CUBE if shape.kind is ShapeKind.BOX else Marker.MESH_RESOURCE
            yield shape, kind, (size[0], size[1], size[2]), shape.pose
            continue
        across = 2.0 * size[0]
        if shape.kind is ShapeKind.SPHERE:
            yield shape, Marker.SPHERE, (across, across, across), shape.pose
            continue
        yield shape, Marker.CYLINDER, (across, across, size[1]), shape.pose
        if shape.kind is ShapeKind.CAPSULE:
            for end in (-0.5, 0.5):
                pose = shape.pose.copy()
                pose[:3] = apply(shape.pose, np.array([0.0, 0.0, end * size[1]]))
                yield shape, Marker.SPHERE, (across, across, across), pose


def _transform(parent: str, child: str, T: np.ndarray, stamp: Time) -> TransformStamped:
    pose = pose_to_message(T)
    translation = Vector3(x=pose.position.x, y=pose.position.y, z=pose.position.z)
    return TransformStamped(
        header=Header(stamp=stamp, frame_id=parent),
        child_frame_id=child,
        transform=Transform(translation=translation, rotation=pose.orientation),
    )
