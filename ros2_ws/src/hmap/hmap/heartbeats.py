"""Whether nodes live: each has a topic ``<node>/heartbeat``, whose liveliness DDS watches.

Nothing is published there. The middleware of a process asserts the liveliness of its publishers in a thread of its own,
so a node that computes for long counts as alive, and one whose process was killed or stopped is noticed within its
lease. Discovery alone takes a dead process for alive for about 20 s.
"""

import os
import threading
import time
from collections.abc import Callable

from rclpy.callback_groups import CallbackGroup
from rclpy.duration import Duration
from rclpy.event_handler import QoSLivelinessChangedInfo, SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import LivelinessPolicy, QoSProfile
from std_msgs.msg import Empty

from hmap.spinning import watch

LEASE = 2.0  # s without a sign of life after which a node counts as dead
MOTION_LEASE = 0.2  # s, of the supervisor: motions stop within 0.5 s of its death, with CONFIRM and braking
CONFIRM = 0.1  # s in which a sign of life may still come that a busy process has not read yet
# s that a node promises; the middleware gives signs after two thirds of it. Several of the supervisor's can be late
# before its motions stop. Each sign of a node wakes the processes of all others, so the rest give few.
SUPERVISOR_PROMISE, PROMISE = 0.09, 1.0
SETTLED = 0.9  # s after which a node that was seen to live, or not to, is believed to
YOUNG = 10.0  # s after its start in which a node looks for another one that was there before
PROBE, LONGEST_PROBE = 1.5, 20.0  # s to look for a node that runs already: where processors are free, and at most


def heartbeat_topic(role: str) -> str:
    """The topic of a node, by the name that it has where it is not renamed."""
    return f"{role}/heartbeat"


def offer_heartbeat(node: Node, role: str) -> Publisher:
    """Show others that a node lives.

    Args:
        node: that lives.
        role: its name where it is not renamed, such as ``komo_optimiser``.
    """
    promise = SUPERVISOR_PROMISE if role == "supervisor" else PROMISE
    return node.create_publisher(Empty, heartbeat_topic(role), _quality(promise))


class Heartbeat:
    """The other nodes of one role, as seen by a node.

    Attributes:
        role: the name of the nodes where they are not renamed.
        alive: how many of them live; the watching node itself is not counted.
        since: when the first of them was seen to live, in s of the steady clock; None where none does.
        lost: whether there was one, and none lives any more.
    """

    def __init__(
        self,
        node: Node,
        role: str,
        group: CallbackGroup | None = None,
        on_loss: Callable[[], None] = lambda: None,
        lease: float = LEASE,
    ):
        """
        Args:
            node: that watches; its executor calls back.
            role: of the watched nodes.
            group: of the callbacks.
            on_loss: called in a thread of its own when the last of them has died or ended, and CONFIRM has passed.
            lease: s without a sign of life after which one counts as dead; the role's promise or more.
        """
        self.role, self.alive, self.lost = role, 0, False
        self.since: float | None = None
        self._on_loss = on_loss
        self.subscription = node.create_subscription(
            Empty,
            heartbeat_topic(role),
            lambda _: None,
            _quality(lease),
            callback_group=group,
            event_callbacks=SubscriptionEventCallbacks(liveliness=self._changed, use_default_callbacks=False),
        )
        watch(self.subscription)

    def _changed(self, info: QoSLivelinessChangedInfo) -> None:
        before, self.alive = self.alive, int(info.alive_count)
        if self.alive == 0:
            self.since = None
        elif self.since is None:
            self.since = time.monotonic()
        self.lost = self.alive == 0 and (self.lost or before > 0)
        if self.alive == 0 and before > 0:
            confirming = threading.Timer(CONFIRM, self._confirm)
            confirming.daemon = True
            confirming.start()

    def _confirm(self) -> None:
        if self.lost:
            self._on_loss()


def probe_limit() -> float:
    """Seconds to look for a node that runs already: discovery takes as much longer as more processes wait."""
    waiting = os.getloadavg()[0] / (os.cpu_count() or 1)
    return min(LONGEST_PROBE, PROBE * max(1.0, waiting))


def runs_already(role: str, limit: float | None = None) -> bool:
    """Whether a node of a role lives; for a process that is about to become one, before it spins.

    Args:
        role: of the node.
        limit: s to look for it, all of it where there is none; None: :func:`probe_limit`.
    """
    limit = probe_limit() if limit is None else limit
    node = Node(f"{role}_probe", use_global_arguments=True, start_parameter_services=False)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    try:
        other, until = Heartbeat(node, role, lease=MOTION_LEASE), time.monotonic() + limit
        while (left := until - time.monotonic()) > 0.0 and not other.alive:
            executor.spin_once(left)
        return other.alive > 0 and _lives(executor, other)
    finally:
        executor.shutdown()
        node.destroy_node()


def _lives(executor: SingleThreadedExecutor, other: Heartbeat) -> bool:
    """Whether a node that was seen lives, and was not killed a moment ago.

    On a busy machine a sign of life can be late, so that the node counts as dead for a moment: it is what it stays.
    """
    began = since = time.monotonic()
    lives = other.alive > 0
    while (now := time.monotonic()) < since + SETTLED and now < began + LONGEST_PROBE:
        executor.spin_once(since + SETTLED - now)
        if (other.alive > 0) is not lives:
            lives, since = not lives, time.monotonic()
    return lives


def was_there_before(other: Heartbeat, began: float) -> bool:
    """Whether another node of one's own role ran already when this one started, although the search missed it.

    Args:
        other: the other nodes of the role.
        began: when this node started, in s of the steady clock.

    Returns:
        True for the younger of two; for both, where they started within YOUNG s.
    """
    since = other.since
    return since is not None and since < began + YOUNG and time.monotonic() > since + 2.0 * LEASE


def _quality(lease: float) -> QoSProfile:
    return QoSProfile(depth=1, liveliness=LivelinessPolicy.AUTOMATIC, liveliness_lease_duration=Duration(seconds=lease))
