"""The node ``recorder``: writes an MCAP bag of the run that can be read without ROS and without hmap."""

import re
import sys
import threading
from importlib import import_module
from pathlib import Path
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.typesys.store import Typestore

from hmap.bags.writer import BagWriter
from hmap.node import HmapNode, run
from hmap_core.exceptions import InputError
from hmap_msgs_py.definitions import typestore

DEPTH = 100  # messages in the queue of a subscription
FLUSH_PERIOD = 0.4  # s; a kill costs what came since
MEGABYTE = 10**6
DISCOVERY_PERIOD = 0.5  # s between two searches for new topics
TOPICS = [
    "clock",
    "diagnostics",
    "joint_states",
    "markers",
    "new_object",
    "object_clouds",
    "plan",
    "planned_path",
    "planned_trajectory",
    "planner_status",
    "points",
    "scene",
    "scene_markers",
    "tf",
    "tf_static",
    "world_state",
    "vicon/.*",
    ".*/robot_description",
]


class ContinuousTime:
    """The times of a bag, which never go back: readers sort messages by them.

    When the clock jumps back, as it does when a simulation is started anew, the times go on from the last one. The
    stamps in the messages stay as they are.

    Attributes:
        offset: ns by which the times of the bag are ahead of the clock.
    """

    def __init__(self):
        self.offset, self._last = 0, 0

    def of(self, now: int) -> int:
        """The time in the bag for a time of the clock, both in ns."""
        if now + self.offset < self._last:
            self.offset = self._last - now
        self._last = now + self.offset
        return self._last


class Recorder(HmapNode):
    """Writes every message of the chosen topics unchanged."""

    waits = False

    def __init__(self):
        super().__init__("recorder")
        path = Path(self.parameter("path", "bag", "folder of the bag; must not exist yet"))
        patterns = self.parameter("topics", TOPICS, "topics relative to the namespace, as regular expressions")
        compress = self.parameter("compress", False, "by zstd, chunk by chunk")
        size = self.parameter("split_size", 0, "MB after which another file of the bag is begun; 0: never", 0, 10**6)
        duration = self.parameter("split_duration", 0.0, "the same in s; 0: never", 0.0, 1e6)
        try:
            self._wanted = [re.compile(self.resolve_topic_name("x").removesuffix("x") + text) for text in patterns]
        except re.error as error:
            raise InputError(f"parameter topics: {error} in {error.pattern!r}") from error
        if path.exists():
            raise InputError(f"parameter path: {path} exists already; the bag needs a new folder")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"parameter path: {path}: its folder cannot be made: {error}") from error
        self._types: Typestore = typestore()
        self._lock = threading.Lock()
        self._writer = BagWriter(path, compress, size * MEGABYTE, duration)
        self._open = True
        self._topics: set[str] = set()
        self._count = 0
        self._bag_time = ContinuousTime()
        self.every(DISCOVERY_PERIOD, self._discover)
        self.every(FLUSH_PERIOD, self._flush)

    def close(self) -> None:
        """Close the bag."""
        super().close()
        with self._lock:
            if self._open:
                self._open = False
                self._writer.close()

    def _flush(self) -> None:
        with self._lock:
            if self._open:
                self._writer.flush()

    def _discover(self) -> None:
        for topic, kinds in self.get_topic_names_and_types():
            # the quality of service is unknown without a publisher
            chosen = topic not in self._topics and any(pattern.fullmatch(topic) for pattern in self._wanted)
            if chosen and self.count_publishers(topic):
                self._topics.add(topic)
                self._record(topic, kinds[0])
        back = self._bag_time.offset * 1e-9
        values: dict[str, Any] = {"clock_went_back_s": round(back, 3)} if back else {}
        self.set_status("recording", topics=len(self._topics), messages=self._count, files=self._writer.files, **values)

    def _record(self, topic: str, kind: str) -> None:
        if kind not in self._types.fielddefs:
            self.get_logger().warning(f"{topic}: the definition of {kind} is not known; not recorded")
            return
        package, _, name = kind.split("/")
        message_type = getattr(import_module(f"{package}.msg"), name)
        qos = self._qos(topic)
        with self._lock:
            if not self._open:
                return
            connection = self._writer.add(topic, kind, self._types)

        def write(data: bytes) -> None:
            with self._lock:
                if self._open:
                    self._writer.write(connection, self._bag_time.of(self.get_clock().now().nanoseconds), data)
                    self._count += 1

        guarded = self.guarded(write, topic)
        self.create_subscription(message_type, topic, guarded, qos, callback_group=self.group, raw=True)

    def _qos(self, topic: str) -> QoSProfile:
        """A quality of service that all publishers of the topic are compatible with."""
        offered = [info.qos_profile for info in self.get_publishers_info_by_topic(topic)]
        reliable = all(qos.reliability == ReliabilityPolicy.RELIABLE for qos in offered)
        latched = all(qos.durability == DurabilityPolicy.TRANSIENT_LOCAL for qos in offered)
        return QoSProfile(
            depth=DEPTH,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )


def main(args: list[str] | None = None) -> int:
    """Run the node; the exit code."""
    return run(Recorder, args)


if __name__ == "__main__":
    sys.exit(main())
