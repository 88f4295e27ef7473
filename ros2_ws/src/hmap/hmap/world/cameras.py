"""Simulated depth cameras: the topics of realsense2_camera, and an instance mask."""

import numpy as np
from builtin_interfaces.msg import Time
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from hmap.naming import OPTICAL_FRAME
from hmap.node import LATCHED, HmapNode
from hmap_core.simulation.camera import CameraImage, intrinsics
from hmap_core.types import Camera
from hmap_msgs.msg import InstanceNames
from hmap_msgs_py.images import image_to_message

DEPTH_UNIT = 0.001  # m, of 16UC1 depth images
NO_DEPTH = 0
TOPICS = {
    "color": ("color/image_raw", Image),
    "color_info": ("color/camera_info", CameraInfo),
    "depth": ("aligned_depth_to_color/image_raw", Image),
    "depth_info": ("aligned_depth_to_color/camera_info", CameraInfo),
    "mask": ("instance_mask/image_raw", Image),
    "names": ("instance_mask/names", InstanceNames),
}


class CameraPublisher:
    """Publishes the pictures of one camera.

    The topics are latched: pictures are rare, and a late subscriber needs one.

    Args:
        node: the node that publishes.
        camera: the camera.
        namespace: of the topics.
    """

    def __init__(self, node: HmapNode, camera: Camera, namespace: str):
        self.camera = camera
        self._frame = OPTICAL_FRAME.format(camera=camera.name)
        self._publishers = {
            key: node.create_publisher(kind, f"{namespace}/{topic}", LATCHED) for key, (topic, kind) in TOPICS.items()
        }
        self._node = node

    def publish(self, image: CameraImage, stamp: Time) -> None:
        """Publish one picture."""
        depth = np.nan_to_num(image.depth / DEPTH_UNIT, nan=NO_DEPTH).round().clip(0, 65535).astype(np.uint16)
        pictures = {"color": (image.color, "rgb8"), "depth": (depth, "16UC1"), "mask": (image.mask, "16UC1")}
        info = self._info(stamp)
        for key, (pixels, encoding) in pictures.items():
            pixels = pixels.astype(np.uint8 if key == "color" else np.uint16)
            self._publishers[key].publish(image_to_message(pixels, encoding, self._frame, stamp))
        names = InstanceNames(header=info.header, numbers=list(image.names), names=list(image.names.values()))
        self._publishers["names"].publish(names)
        self._publishers["color_info"].publish(info)
        self._publishers["depth_info"].publish(info)

    def destroy(self) -> None:
        """Remove the topics."""
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)

    def _info(self, stamp: Time) -> CameraInfo:
        K = intrinsics(self.camera)
        return CameraInfo(
            header=Header(stamp=stamp, frame_id=self._frame),
            height=self.camera.height,
            width=self.camera.width,
            distortion_model="plumb_bob",
            d=[0.0] * 5,
            k=K.ravel().tolist(),
            r=np.eye(3).ravel().tolist(),
            p=np.c_[K, np.zeros(3)].ravel().tolist(),
        )
