"""Looks at everything that hmap needs of a cell, before anything moves."""

import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from control_msgs.action import FollowJointTrajectory, GripperCommand
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image, JointState
from tf2_msgs.msg import TFMessage

from hmap.conversions import scene_from_message
from hmap.doctor.findings import (
    FAIL,
    OK,
    WARN,
    Finding,
    Topic,
    action_findings,
    joint_findings,
    message_findings,
    pose_findings,
    state_finding,
    topic_findings,
)
from hmap.doctor.graph_view import GraphView, kind_name
from hmap.heartbeats import probe_limit
from hmap.naming import FORMATS
from hmap.perception.frames import Frames
from hmap.session import PLANNING_NODES, SERVICES
from hmap_core.exceptions import HmapError
from hmap_core.trajectory.samples import movable_bodies
from hmap_core.types import Scene
from hmap_msgs.msg import InstanceNames, WorldState
from hmap_msgs.msg import Scene as SceneMessage
from hmap_msgs_py.checks import ConversionError

DISCOVERY = 1.5  # s for the graph to be known
NODES_LIMIT = 8.0  # s at most until a node that runs is known, on a busy machine
STALE, POSE_FRAMES = 1.0, ["world", "vicon"]  # of perception, where it does not tell
CAMERA = {
    "aligned_depth_to_color/image_raw": Image,
    "aligned_depth_to_color/camera_info": CameraInfo,
    "instance_mask/image_raw": Image,
    "instance_mask/names": InstanceNames,
}
DEPTH_ENCODING = "16UC1"
MODELS = "start the driver, or set the parameter names.{} of perception and supervisor"


def action_kind(kind: type) -> str:
    """The name of an action type, such as ``control_msgs/action/GripperCommand``."""
    return f"{kind.__module__.split('.')[0]}/action/{kind.__name__}"


class Examination:
    """One look at the graph.

    Attributes:
        findings: what was found so far.
    """

    def __init__(self, node: Node, seconds: float):
        """
        Args:
            node: that looks; somebody else spins it.
            seconds: for which messages are waited for.
        """
        self.findings: list[Finding] = []
        self._seconds = seconds
        self._clock: float | None = None  # s of /clock
        self._view = GraphView(node, self._now)
        self._joints: dict[str, tuple[float, float]] = {}
        self._tf = Frames()

    def run(self) -> list[Finding]:
        """Look at everything; returns the findings, worst first."""
        time.sleep(DISCOVERY)
        self._wait(lambda: not self._absent(Counter(self._view.nodes())), NODES_LIMIT)
        self._nodes()
        told = self._told()
        scene_topic = self._view.watch("scene", SceneMessage)
        state = self._view.watch("world_state", WorldState)
        joints = self._view.watch("joint_states", JointState, self._note_joints)
        self._view.watch("/clock", Clock, self._note_clock)
        for topic in ("/tf_static", "/tf"):
            self._view.watch(topic, TFMessage, self._tf.add)
        self._wait(lambda: scene_topic.messages > 0, self._seconds)
        scene = self._read_scene(scene_topic)
        names = {key: str(told.get(f"names.{key}", default)) for key, (default, _) in FORMATS.items()}
        if scene is not None:
            self._wait(lambda: self._drivers_known(scene, names), probe_limit())
        poses, cameras = self._watch_scene(scene, names)
        time.sleep(self._seconds)
        now = self._now()
        stale = float(told.get("stale_after", STALE))
        self._times(told)
        self._look(joints, JointState, "start the robot's drivers", now, stale)
        if scene is not None:
            wanted = {name: _wire(scene, names, name) for name in scene.robots}
            self.findings += joint_findings(joints, self._joints, wanted)
            self._poses(scene, poses, list(told.get("pose_frames", POSE_FRAMES)), now, stale)
            self._cameras(cameras, now, stale)
            self._actions(scene, names)
        self._look(state, WorldState, "perception publishes it once it measures everything above", now, 2.0 * stale)
        return sorted(self.findings, key=lambda finding: (FAIL, WARN, OK).index(finding.level))

    # what is heard

    def _now(self) -> float | None:
        return time.time() if self._clock is None else self._clock

    def _note_clock(self, message: Clock) -> None:
        self._clock = message.clock.sec + 1e-9 * message.clock.nanosec

    def _note_joints(self, message: JointState) -> None:
        velocities = list(message.velocity) + [0.0] * (len(message.name) - len(message.velocity))
        self._joints.update(zip(message.name, zip(message.position, velocities, strict=False), strict=False))

    def _wait(self, done: Callable[[], bool], limit: float) -> None:
        until = time.monotonic() + limit
        while not done() and time.monotonic() < until:
            time.sleep(0.05)

    def _told(self) -> dict[str, Any]:
        """Parameters of perception and supervisor, and whether they agree on names."""
        keys = [f"names.{key}" for key in FORMATS]
        perception = self._view.parameters("perception", [*keys, "stale_after", "pose_frames", "use_sim_time"])
        supervisor = self._view.parameters("supervisor", [*keys, "use_sim_time", "dry_run"])
        for key in keys:
            both = perception.get(key), supervisor.get(key)
            if None not in both and both[0] != both[1]:
                text = f"perception has {both[0]!r}, supervisor {both[1]!r}: give both the same parameter file"
                self.findings.append(Finding(FAIL, f"parameter {key}", text))
        if supervisor.get("dry_run"):
            self.findings.append(Finding(WARN, "supervisor", "runs dry: it plans, and never moves anything"))
        return supervisor | perception

    # what is looked at

    def _absent(self, counts: Counter[str]) -> list[str]:
        """The nodes that are not known to run, or do not offer their service."""
        space = self._view.node.get_namespace().rstrip("/")
        offered = [name for name in PLANNING_NODES if name not in SERVICES or self._view.service(SERVICES[name])]
        return [name for name in PLANNING_NODES if not counts.get(f"{space}/{name}") or name not in offered]

    def _nodes(self) -> None:
        counts = Counter(self._view.nodes())
        space = self._view.node.get_namespace().rstrip("/")
        for name in PLANNING_NODES:
            found = counts.get(f"{space}/{name}", 0)
            if found == 0:
                self.findings.append(Finding(FAIL, name, f"this node does not run: ros2 run hmap {name}"))
            elif found > 1:
                self.findings.append(Finding(FAIL, name, f"{found} nodes have this name; end all but one"))
            elif name in SERVICES and not self._view.service(SERVICES[name]):
                self.findings.append(Finding(FAIL, name, f"runs, but does not offer {SERVICES[name]}"))
            else:
                self.findings.append(state_finding(f"{space}/{name}", self._view.state(name)))

    def _times(self, told: Mapping[str, Any]) -> None:
        """Whether the nodes and /clock agree on whose time it is."""
        clock = self._view.refresh(self._view.watch("/clock", Clock))
        if told.get("use_sim_time") and not clock.messages:
            text = "nobody publishes it, though use_sim_time is set: no stamp can be judged, and nothing works"
            self.findings.append(Finding(FAIL, "/clock", text))
        if told and not told.get("use_sim_time") and clock.messages:
            text = "is published, though use_sim_time is not set: stamps are judged by another clock"
            self.findings.append(Finding(FAIL, "/clock", text))

    def _read_scene(self, topic: Topic) -> Scene | None:
        found = topic_findings(
            self._view.refresh(topic), kind_name(SceneMessage), "set the parameter task of perception, or start world"
        )
        if not found and topic.data is None:
            found = [Finding(FAIL, topic.name, f"no scene came within {self._seconds:g} s")]
        if not found:
            try:
                scene = scene_from_message(topic.data)
                self.findings.append(Finding(OK, topic.name, f"task {scene.task!r}, seed {scene.seed}"))
                return scene
            except (HmapError, ConversionError) as error:
                found = [Finding(FAIL, topic.name, str(error))]
        self.findings += found
        return None

    def _drivers_known(self, scene: Scene, names: Mapping[str, str]) -> bool:
        """Whether somebody offers what measures and moves the scene; discovery takes long on a busy machine."""
        bodies = [names["body_pose"].format(body=body) for body in movable_bodies(scene)]
        topics = all(self._view.node.count_publishers(topic) for topic in ("joint_states", *bodies))
        return topics and all(self._view.action(name)[1] for name, _, _ in _wanted_actions(scene, names))

    def _watch_scene(
        self, scene: Scene | None, names: Mapping[str, str]
    ) -> tuple[dict[str, Topic], dict[str, dict[str, Topic]]]:
        """Listen to poses of bodies and pictures; they by body and by camera."""
        if scene is None:
            return {}, {}
        poses = {
            name: self._view.watch(names["body_pose"].format(body=name), PoseStamped) for name in movable_bodies(scene)
        }
        spaces = {name: names["camera"].format(camera=name) for name in scene.cameras}
        cameras = {
            name: {part: self._view.watch(f"{space}/{part}", kind) for part, kind in CAMERA.items()}
            for name, space in spaces.items()
        }
        return poses, cameras

    def _look(
        self, topic: Topic, kind: type, remedy: str, now: float | None, stale: float, required: bool = True
    ) -> bool:
        """Whether a topic is as it should be."""
        found = topic_findings(self._view.refresh(topic), kind_name(kind), remedy, required)
        found = found or message_findings(topic, now, stale, self._seconds, required)
        self.findings += found or [Finding(OK, topic.name, f"{topic.messages / self._seconds:.0f} Hz")]
        return not found

    def _poses(
        self, scene: Scene, poses: Mapping[str, Topic], frames: list[str], now: float | None, stale: float
    ) -> None:
        for body, topic in poses.items():
            if self._look(topic, PoseStamped, MODELS.format("body_pose"), now, stale):
                measured: Any = topic.data
                p, q = measured.pose.position, measured.pose.orientation
                pose = np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w])
                known = all(self._tf.to_world(frame, frames) is not None for frame in topic.frames)
                planned = scene.bodies[body].pose[3:5]
                upright = float(planned @ planned) < 1e-6
                self.findings += pose_findings(topic, body, pose, frames, known, upright)

    def _cameras(self, cameras: Mapping[str, Mapping[str, Topic]], now: float | None, stale: float) -> None:
        """Pictures come rarely, and contacts are found without them, too: these are warnings."""
        for camera, parts in cameras.items():
            for part, topic in parts.items():
                remedy = f"start the driver of camera '{camera}' with aligned depth, or set names.camera"
                if "mask" in part:
                    remedy = "only a segmentation node shows objects that the scene does not have"
                found = topic_findings(self._view.refresh(topic), kind_name(CAMERA[part]), remedy, required=False)
                if not found and part.startswith("aligned_depth") and topic.data is not None:
                    encoding = getattr(topic.data, "encoding", DEPTH_ENCODING)
                    if encoding != DEPTH_ENCODING:
                        found = [Finding(FAIL, topic.name, f"has the encoding {encoding!r}, not {DEPTH_ENCODING}")]
                self.findings += found or [Finding(OK, topic.name)]

    def _actions(self, scene: Scene, names: Mapping[str, str]) -> None:
        for name, key, kind in _wanted_actions(scene, names):
            types, servers = self._view.action(name)
            found = action_findings(name, action_kind(kind), types, servers, MODELS.format(key))
            self.findings += found or [Finding(OK, name)]


def _wanted_actions(scene: Scene, names: Mapping[str, str]) -> list[tuple[str, str, type]]:
    """Name, parameter and type of each action by which the robots are moved."""
    wanted: list[tuple[str, str, type]] = []
    for robot, placed in scene.robots.items():
        wanted.append((names["arm_action"].format(robot=robot), "arm_action", FollowJointTrajectory))
        if placed.model.gripper:
            wanted.append((names["gripper_action"].format(robot=robot), "gripper_action", GripperCommand))
    return wanted


def _wire(scene: Scene, names: Mapping[str, str], robot: str) -> list[str]:
    """The names of a robot's joints in ``joint_states``."""
    model = scene.robots[robot].model
    fingers = model.gripper.joint_names if model.gripper else ()
    return [
        names[key].format(robot=robot, joint=joint, number=k + 1)
        for key, joints in (("arm_joint", model.joint_names), ("finger_joint", fingers))
        for k, joint in enumerate(joints)
    ]
