"""The node ``perception``: combines measurements into ``world_state`` and clouds of the objects."""

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, Image, JointState
from tf2_msgs.msg import TFMessage

from hmap.conversions import cloud_to_message, scene_from_message, scene_to_message, state_to_message
from hmap.naming import Naming
from hmap.node import LATCHED, HmapNode, run
from hmap.perception.detected_objects import DetectedObjects
from hmap.perception.frames import Frames
from hmap.perception.fusion import Fusion
from hmap.perception.pictures import WITHOUT_MASK, Picture, PictureParts
from hmap.perception.pose_filter import POSE_NOISE
from hmap.perception.standard_topics import StandardTopics
from hmap.supervision.watchdog import MotionWatchdog
from hmap_core.contacts.camera import Cloud
from hmap_core.contacts.cloud import cloud_from_depth, merge_clouds
from hmap_core.exceptions import Code, InputError
from hmap_core.scenes import load_scene
from hmap_core.transforms import multiply
from hmap_core.types import BodyKind, Scene
from hmap_msgs.msg import BodyArray, InstanceNames, ObjectClouds, WorldState
from hmap_msgs.msg import Scene as SceneMessage
from hmap_msgs_py.bodies import body_to_message
from hmap_msgs_py.checks import ConversionError, frame
from hmap_msgs_py.measurements import ReceiverClock
from hmap_msgs_py.poses import pose_from_message
from hmap_msgs_py.times import seconds_from_message, time_to_message

if TYPE_CHECKING:
    from hmap.perception.segmentation import Segmentation

FRAME = "world"
TF = QoSProfile(depth=100)
TF_STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
AUTO, MASK, GEOMETRY = SEGMENTATIONS = ("auto", "mask", "geometry")
SEGMENTATION = (
    f"of depth pictures: {MASK}: by the camera's instance masks; {GEOMETRY}: by the known shapes at their measured "
    f"poses; {AUTO}: by masks where a node publishes them, else by shapes"
)
SEGMENTATION_PERIOD = 0.5  # s between two pictures of a camera that are segmented by geometry, at least
CAMERA_TOPICS = {
    "depth": ("aligned_depth_to_color/image_raw", Image),
    "info": ("aligned_depth_to_color/camera_info", CameraInfo),
    "mask": ("instance_mask/image_raw", Image),
    "names": ("instance_mask/names", InstanceNames),
}


@dataclass
class Watched:
    """A scene that is seen, and what was measured in it."""

    fusion: Fusion
    detected: DetectedObjects

    @cached_property
    def segmentation(self) -> "Segmentation":
        """Labels pictures that come without masks."""
        from hmap.perception.segmentation import Segmentation  # reads meshes, which masks make needless

        return Segmentation(self.fusion.scene)


class Perception(HmapNode):
    """Publishes the state of the world while measurements are up to date."""

    waits = False

    def __init__(self):
        super().__init__("perception")
        self._naming = Naming(self, "arm_joint", "finger_joint", "arm_action", "camera", "body_pose")
        task = self.parameter("task", "", "task whose scene is seen; empty: the scene that is published on `scene`")
        seed = self.parameter("seed", 0, "of its randomisation", 0, 2**31 - 1)
        rate = self.parameter("rate", 10.0, "of world_state, Hz of real time", 0.1, 1000.0)
        text = "s; measurements that are older, or stamped farther ahead of the clock, are not published"
        self._stale_after = self.parameter("stale_after", 1.0, text, 0.01, 3600.0)
        frames = "frame_ids that mean the world frame; poses in other frames are transformed by tf"
        self._frames = set(self.parameter("pose_frames", ["world", "vicon"], frames))
        text = "m, standard deviation of measured positions; poses of bodies that stand are averaged; 0: they are not"
        self._noise = self.parameter("pose_noise", POSE_NOISE, text, 0.0, 0.1)
        self._segmentation = self.parameter("segmentation", AUTO, SEGMENTATION)
        if self._segmentation not in SEGMENTATIONS:
            allowed = ", ".join(SEGMENTATIONS)
            raise InputError(f"the parameter 'segmentation' is '{self._segmentation}'; allowed: {allowed}")
        simulated = self.get_parameter("use_sim_time").value  # then `world` stops the arms itself
        self._watchdog = None if simulated else MotionWatchdog(self.get_namespace(), self.get_logger().warning)
        self._sensor_clock = ReceiverClock(self.now, self._stale_after)
        self._restarts = 0  # of the clock, that are dealt with
        self._state = self.create_publisher(WorldState, "world_state", 10)
        self._clouds = self.create_publisher(ObjectClouds, "object_clouds", LATCHED)
        self._new = self.create_publisher(BodyArray, "new_object", LATCHED)
        about = "publish tf, robot descriptions, markers of bodies and a cloud for RViz, Foxglove and others"
        self._standard = StandardTopics(self) if self.parameter("standard_topics", True, about) else None
        self._watched: Watched | None = None
        self._announced: set[str] = set()  # bodies that `scene` has announced since it was loaded
        self._reported = False  # whether the last message of `new_object` has bodies
        self._scene_subscriptions: list[Subscription] = []
        self._segmented: dict[str, float] = {}  # camera -> time of its newest picture segmented by geometry, s
        self._seen: dict[str, dict[str, Cloud]] = {}  # object -> camera -> its cloud
        self._unplaced: dict[str, Picture] = {}  # camera -> its newest picture, where that shows bodies without a pose
        self._clouds_time = -math.inf  # s; of the newest picture in it
        self._tf = Frames()
        for topic, qos in (("/tf_static", TF_STATIC), ("/tf", TF)):
            self.subscribe(TFMessage, topic, self._tf.add, qos)
        # broadcasters of some drivers offer best effort only, which a reliable subscription does not receive
        events = SubscriptionEventCallbacks(incompatible_qos=self._take_best_effort)
        self._best_effort: Subscription | None = None
        self.subscribe(JointState, "joint_states", self._take_joints, event_callbacks=events)
        if task:
            self._offered = self.create_publisher(SceneMessage, "scene", LATCHED)
            scene = load_scene(task, seed)
            self._offered.publish(scene_to_message(scene))
            self._take_scene(scene)
        else:
            self.subscribe(
                SceneMessage, "scene", lambda message: self._take_scene(scene_from_message(message)), LATCHED
            )
        self.every(1.0 / rate, self._publish_state)

    def close(self) -> None:
        """End the watchdog, too."""
        super().close()
        if self._watchdog is not None:
            self._watchdog.close()

    # the scene

    def _take_scene(self, scene: Scene) -> None:
        previous = self._watched
        models = {name: robot.model for name, robot in scene.robots.items()}
        arms = {name: self._naming.arm_joints(name, model) for name, model in models.items()}
        fingers = {name: self._naming.finger_joints(name, model) for name, model in models.items()}
        fusion = Fusion(scene, arms, fingers, self._sensor_clock, self._noise)
        if self._watchdog is not None:
            self._watchdog.watch([self._naming.arm_action(name) for name in scene.robots])
        if previous is not None and _bodies_changed(previous.fusion.scene, scene):
            fusion.copy_measurements(previous.fusion)
            previous.detected.scene = scene
            self._announced |= scene.bodies.keys() - previous.fusion.scene.bodies.keys()
            watched = Watched(fusion, previous.detected)
        else:
            watched = Watched(fusion, DetectedObjects(scene))
            self._announced = set()
        self._watched = watched
        self._seen, self._unplaced, self._clouds_time = {}, {}, -math.inf
        for subscription in self._scene_subscriptions:
            self.destroy_subscription(subscription)
        self._scene_subscriptions = [self._subscribe_to_body(fusion, name) for name in fusion.tracked]
        for camera in scene.cameras.values():
            parts = PictureParts(camera, self._sensor_clock)
            unmasked = PictureParts(camera, self._sensor_clock, WITHOUT_MASK)
            for part, (topic, kind) in CAMERA_TOPICS.items():
                name = f"{self._naming.camera(camera.name)}/{topic}"
                self._subscribe_to_camera(kind, name, partial(self._take_part, watched, parts, unmasked, part))
        self._report_new(watched)
        if self._standard is not None:
            self._standard.load(scene, self.get_clock().now().to_msg())
        self.set_status("waiting for measurements", task=scene.task, seed=scene.seed)

    def _subscribe_to_body(self, fusion: Fusion, name: str) -> Subscription:
        take = partial(self._take_pose, fusion, name)
        return self.subscribe(PoseStamped, self._naming.body_pose(name), take, qos_profile_sensor_data)

    def _subscribe_to_camera(self, kind: type, name: str, take: Callable) -> None:
        """Subscribe to a latched topic, or without latching if the publisher does not offer it.

        ``world`` keeps its last picture for late subscribers; most drivers keep none.
        """
        volatile: list[Subscription] = []

        def subscribe_volatile(_) -> None:
            if not volatile:
                volatile.append(self.subscribe(kind, name, take, qos_profile_sensor_data))
                self._scene_subscriptions.extend(volatile)

        events = SubscriptionEventCallbacks(incompatible_qos=subscribe_volatile)
        self._scene_subscriptions.append(self.subscribe(kind, name, take, LATCHED, event_callbacks=events))

    def _report_new(self, watched: Watched, stamp: Time | None = None) -> None:
        """Publish all new bodies since the scene was loaded: announced on `scene`, or only detected by cameras."""
        known = watched.fusion.scene.bodies
        announced = [body for name, body in known.items() if name in self._announced]
        seen = [body for name, body in watched.detected.bodies.items() if name not in known]
        if not announced and not seen and not self._reported:
            return
        self._reported = bool(announced or seen)
        message = BodyArray(bodies=[body_to_message(body) for body in (*announced, *seen)])
        message.header.stamp, message.header.frame_id = stamp or self.get_clock().now().to_msg(), FRAME
        self._new.publish(message)

    # the sensors

    def _take_best_effort(self, _) -> None:
        if self._best_effort is None:
            self._best_effort = self.subscribe(JointState, "joint_states", self._take_joints, qos_profile_sensor_data)

    def _take_joints(self, message: JointState) -> None:
        if self._watched is None:
            return
        time = seconds_from_message(message.header.stamp)
        try:
            problems = self._watched.fusion.add_joints(time, message.name, message.position, message.velocity)
        except (InputError, ConversionError) as error:
            problems = [str(error)]
        # several drivers may publish on the topic, each the states of its own joints
        self.problems.update(("joint_states", *message.name), problems, "joint_states")

    def _take_pose(self, fusion: Fusion, name: str, message: PoseStamped) -> None:
        pose = pose_from_message(message.pose, f"the pose of {name!r}")
        if message.header.frame_id.removeprefix("/") not in self._frames:
            T_world_frame = self._tf.to_world(message.header.frame_id, sorted(self._frames))
            if T_world_frame is None:  # nor does tf know it
                frame(f"the pose of {name!r}", message.header.frame_id, self._frames)
            else:
                pose = multiply(T_world_frame, pose)
        fusion.add_pose(seconds_from_message(message.header.stamp), name, pose)

    def _take_part(
        self, watched: Watched, parts: PictureParts, unmasked: PictureParts, part: str, message: Any
    ) -> None:
        if not self._by_geometry(parts.camera.name):
            self._take_picture(watched, parts, part, message)
        elif part in WITHOUT_MASK:
            last = self._segmented.get(parts.camera.name, -math.inf)
            if not 0.0 <= seconds_from_message(message.header.stamp) - last < SEGMENTATION_PERIOD:
                self._take_picture(watched, unmasked, part, message)

    def _by_geometry(self, camera: str) -> bool:
        if self._segmentation != AUTO:
            return self._segmentation == GEOMETRY
        return self.count_publishers(f"{self._naming.camera(camera)}/{CAMERA_TOPICS['mask'][0]}") == 0

    def _segmented_by_geometry(self, watched: Watched, picture: Picture) -> Picture | None:
        """The picture with a mask; None where the state at its time is not known."""
        self._segmented[picture.camera.name] = picture.time
        try:
            state = watched.fusion.state()[1]
        except InputError:  # which _publish_state reports
            return None
        poses = {name: watched.fusion.pose_at(name, picture.time) for name in watched.fusion.tracked}
        measured = {name: pose for name, pose in poses.items() if pose is not None}
        return watched.segmentation.label(picture, replace(state, poses=state.poses | measured))

    def _take_picture(self, watched: Watched, parts: PictureParts, part: str, message: Any) -> None:
        source = f"camera '{parts.camera.name}'"  # whichever of its topics completes the picture
        try:
            picture = parts.add(part, message)
        except (InputError, ConversionError) as error:
            self.problems.update(source, [str(error)])
            return
        if picture is not None and parts.needed == WITHOUT_MASK:
            picture = self._segmented_by_geometry(watched, picture)
        if picture is None:
            return
        self.problems.update(source, picture.problems)
        forgotten = self._follow_clock(watched)
        if watched.detected.update(picture) or forgotten:
            self._report_new(watched, time_to_message(picture.time))
        self._update_clouds(watched.fusion, picture)

    def _follow_clock(self, watched: Watched) -> bool:
        """Forget what the cameras saw before the clock jumped back; whether it did."""
        if self._restarts == self._sensor_clock.restarts:
            return False
        self._restarts = self._sensor_clock.restarts
        self._seen, self._unplaced, self._clouds_time = {}, {}, -math.inf
        watched.detected = DetectedObjects(watched.detected.scene)
        return True

    def _update_clouds(self, fusion: Fusion, picture: Picture) -> None:
        self._unplaced.pop(picture.camera.name, None)
        for name, number in picture.names.items():
            body = fusion.scene.bodies.get(name)
            pose = fusion.pose_at(name, picture.time)
            if body is None or body.kind is BodyKind.FIXED:
                continue
            if pose is None:  # while nothing moves, no other picture may come
                self._unplaced[picture.camera.name] = picture
                continue
            mask = picture.mask == number
            cloud = cloud_from_depth(picture.depth, mask, picture.intrinsics, picture.camera.pose, pose)
            self._seen.setdefault(name, {})[picture.camera.name] = cloud
        # several cameras: the message is as new as the newest picture in it
        self._clouds_time = time = max(self._clouds_time, picture.time)
        stamp = time_to_message(time)
        message = ObjectClouds()
        message.header.stamp, message.header.frame_id = stamp, FRAME
        shown: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]] = {}
        for name, seen in self._seen.items():
            cloud = merge_clouds([cloud for cloud in seen.values() if len(cloud)])
            pose = fusion.pose_at(name, time)
            if len(cloud) and pose is not None:
                message.clouds.append(cloud_to_message(name, pose, cloud, stamp))
                shown[name] = pose, cloud.points, cloud.normals
        self._clouds.publish(message)
        if self._standard is not None:
            self._standard.show_points(shown, stamp)

    # the state

    def _publish_state(self) -> None:
        if self._watched is None:
            self.set_status("waiting for a scene", DiagnosticStatus.WARN)
            return
        fusion = self._watched.fusion
        try:
            time, state, velocity = fusion.state()
            self._check_age(time, fusion.oldest()[1])
        except InputError as error:
            self.set_status(error.reason, DiagnosticStatus.WARN)
            return
        for picture in list(self._unplaced.values()):
            self._update_clouds(fusion, picture)
        stamp = time_to_message(time)
        self._state.publish(state_to_message(fusion.scene, state, stamp, velocity))
        if self._standard is not None:
            self._standard.show(fusion.scene, state, stamp)
        self.set_status("measuring", task=fusion.scene.task, seed=fusion.scene.seed)

    def _check_age(self, time: float, name: str = "") -> None:
        now = self.now()
        if now is None:  # the age could not be computed
            raise InputError("use_sim_time is set, but no time has come on /clock", Code.STALE_STATE)
        age, of = now - time, f", of {name}," if name else ""
        if not age <= self._stale_after:
            unset = "; its stamp is 0: does its driver set stamps?" if time == 0.0 else ""
            raise InputError(
                f"the oldest measurement{of} is {age:.2f} s old; {self._stale_after:g} s are allowed{unset}",
                Code.STALE_STATE,
            )
        if age < -self._stale_after:
            raise InputError(
                f"the oldest measurement{of} is stamped {-age:.2f} s ahead of the clock; "
                f"{self._stale_after:g} s are allowed",
                Code.STALE_STATE,
            )


def _bodies_changed(previous: Scene, scene: Scene) -> bool:
    """Whether bodies of a scene were added, removed or moved; false for another scene, or for one that was reset."""
    same = (previous.task, previous.seed) == (scene.task, scene.seed)
    return same and scene_to_message(previous).text != scene_to_message(scene).text


def main(args: list[str] | None = None) -> int:
    """Run the node; the exit code."""
    return run(Perception, args)


if __name__ == "__main__":
    sys.exit(main())
