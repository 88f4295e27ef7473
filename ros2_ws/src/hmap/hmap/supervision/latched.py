"""Latched topics for other programs, whose messages are made once somebody listens."""

import threading
from collections.abc import Callable
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherMatchedInfo

from hmap.node import LATCHED, HmapNode


class LatchedOnDemand:
    """A latched topic. Until it has a first subscriber, no message is made.

    A subscriber that comes later gets the newest message, as of any latched topic, within EVENT_PERIOD of
    :mod:`hmap.spinning`.
    """

    def __init__(self, node: HmapNode, message_type: type, topic: str):
        """
        Args:
            node: that publishes.
            message_type: of the topic.
            topic: its name.
        """
        self._lock = threading.Lock()
        self._make: Callable[[], Any] | None = None  # the newest message, if nobody has got it
        self._wanted = False  # whether there has been a subscriber
        events = PublisherEventCallbacks(matched=self._matched)
        self._publisher = node.create_publisher(
            message_type, topic, LATCHED, callback_group=node.group, event_callbacks=events
        )

    def publish(self, make: Callable[[], Any]) -> None:
        """Publish the message that a function makes, at once or when somebody listens."""
        with self._lock:
            self._make = make
            self._wanted = self._wanted or self._publisher.get_subscription_count() > 0
        self._tell()

    def _matched(self, info: QoSPublisherMatchedInfo) -> None:
        if info.current_count > 0:
            with self._lock:
                self._wanted = True
            self._tell()

    def _tell(self) -> None:
        with self._lock:
            if self._wanted and self._make is not None:
                make, self._make = self._make, None
                self._publisher.publish(make())
