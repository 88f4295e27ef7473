"""What is wrong with a graph, from what was seen of it; knows no ROS."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

FAIL, WARN, OK = "FAIL", "WARN", "OK"
ACTIVE, NEXT = "active", {"unconfigured": "configure", "inactive": "activate"}  # states -> the next transition
UPRIGHT = np.deg2rad(5.0)  # of tilt; more needs a support that is tilted, too
STANDS = 0.05  # rad/s; a robot that moves faster should not be taken over


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        level: FAIL, nothing would work, or something wrong would be used; WARN, something works less well; OK.
        what: was looked at, such as a topic.
        text: what is wrong, and what to do.
    """

    level: str
    what: str
    text: str = ""


@dataclass(frozen=True)
class Endpoint:
    """A publisher or subscription.

    Attributes:
        node: full name.
        reliable: whether it offers or asks for reliable delivery.
        latched: whether it offers or asks for the last messages of before.
    """

    node: str
    reliable: bool
    latched: bool


@dataclass
class Topic:
    """What was seen of a topic.

    Attributes:
        name: full name.
        types: that are in use.
        publishers, subscribers: of it.
        messages: how many came.
        stamps: s, of the first and the newest one; None where they have none.
        arrived: s of the graph's clock when the newest came.
        data: the newest message.
        frames: frame_ids.
    """

    name: str
    types: tuple[str, ...] = ()
    publishers: tuple[Endpoint, ...] = ()
    subscribers: tuple[Endpoint, ...] = ()
    messages: int = 0
    stamps: tuple[float, float] | None = None
    arrived: float = 0.0
    data: object = None
    frames: set[str] = field(default_factory=set)


def topic_findings(topic: Topic, kind: str, remedy: str, required: bool = True) -> list[Finding]:
    """Whether a topic is published, with the right type and with a quality of service that its subscribers receive.

    Args:
        topic: as seen.
        kind: the type that is expected, such as ``sensor_msgs/msg/JointState``.
        remedy: what to do where nobody publishes it.
        required: whether nothing works without it.
    """
    bad = FAIL if required else WARN
    if not topic.publishers:
        other = f"; its type is {', '.join(topic.types)}, but {kind} is expected" if _other(topic, kind) else ""
        return [Finding(bad, topic.name, f"nobody publishes it{other}: {remedy}")]
    if _other(topic, kind):
        nodes = ", ".join(end.node for end in topic.publishers)
        return [Finding(bad, topic.name, f"has the type {', '.join(topic.types)}, not {kind} (published by {nodes})")]
    return [Finding(bad, topic.name, text) for text in incompatible(topic)]


def _other(topic: Topic, kind: str) -> bool:
    return bool(topic.types) and set(topic.types) != {kind}


def incompatible(topic: Topic) -> list[str]:
    """Which subscribers do not receive which publishers, since one asks for more than the other offers."""
    found = []
    for end in {end.node for end in topic.subscribers}:
        asks = [one for one in topic.subscribers if one.node == end]
        for offer in topic.publishers:
            if any((offer.reliable or not a.reliable) and (offer.latched or not a.latched) for a in asks):
                continue
            lacks = "reliable delivery" if any(a.reliable and not offer.reliable for a in asks) else "the last message"
            found.append(
                f"quality of service: {end} asks for {lacks}, which {offer.node} does not offer, so nothing arrives"
            )
    return found


def message_findings(
    topic: Topic, now: float | None, stale: float, seconds: float, required: bool = True
) -> list[Finding]:
    """Whether messages come, and with stamps of now.

    Args:
        topic: as seen.
        now: s of the graph's clock; None: it has none.
        stale: s that a stamp may be old or ahead.
        seconds: for which messages were waited for.
        required: whether nothing works without them.
    """
    bad = FAIL if required else WARN
    if not topic.messages:
        return [Finding(bad, topic.name, f"no message came within {seconds:g} s, though it is published")]
    if topic.stamps is None or now is None:
        return []
    newest = topic.stamps[1]
    age = topic.arrived - newest
    if newest == 0.0:
        return [Finding(bad, topic.name, "its stamps are 0: does its driver set them?")]
    if age > stale:
        text = f"stale: the newest stamp is {age:.2f} s old on arrival, {stale:g} s are allowed: do the clocks agree?"
        return [Finding(bad, topic.name, text)]
    if age < -stale:
        text = f"its stamps are {-age:.2f} s ahead of the clock: are the clocks synchronised (chrony, PTP)?"
        return [Finding(bad, topic.name, text)]
    return []


def joint_findings(
    topic: Topic, seen: Mapping[str, tuple[float, float]], wanted: Mapping[str, Sequence[str]]
) -> list[Finding]:
    """Whether all joints are measured, finite, and at rest.

    Args:
        topic: ``joint_states``.
        seen: joint -> position and velocity, as they came.
        wanted: robot -> names of its joints on the wire.
    """
    found = []
    for robot, names in wanted.items():
        missing = [name for name in names if name not in seen]
        if missing:
            others = ", ".join(sorted(seen)) or "no joint"
            text = f"lacks {', '.join(missing)} of '{robot}'; it has {others}: set names.arm_joint, names.finger_joint"
            found.append(Finding(FAIL, topic.name, text))
        bad = [name for name in names if name in seen and not np.isfinite(seen[name][0])]
        if bad:
            found.append(Finding(FAIL, topic.name, f"positions of {', '.join(bad)} are not finite"))
        moving = [name for name in names if name in seen and abs(seen[name][1]) > STANDS]
        if moving:
            text = f"'{robot}' moves ({', '.join(moving)}), though no goal is worked on: who moves it?"
            found.append(Finding(WARN, topic.name, text))
    return found


def pose_findings(
    topic: Topic, body: str, pose: np.ndarray, frames: Sequence[str], tf_knows: bool, stands: bool
) -> list[Finding]:
    """Whether a measured pose can be right.

    Args:
        topic: of the pose.
        body: its name.
        pose: (7,) as it came.
        frames: that mean the world frame.
        tf_knows: whether tf knows the pose's own frame.
        stands: whether the body stands upright where the task has it, on its own faces.
    """
    strange = sorted(frame for frame in topic.frames if frame.removeprefix("/") not in frames)
    if strange and not tf_knows:
        text = f"is in frame {', '.join(map(repr, strange))}, which neither pose_frames nor tf connects with the world"
        return [
            Finding(FAIL, topic.name, f"{text}: add it to pose_frames if it is the world frame, or publish tf_static")
        ]
    norm = float(np.linalg.norm(pose[3:]))
    if not np.isfinite(pose).all():
        return [Finding(FAIL, topic.name, f"the pose of '{body}' is not finite: {np.round(pose, 4).tolist()}")]
    if abs(norm - 1.0) > 1e-3:
        return [Finding(FAIL, topic.name, f"the quaternion of '{body}' has the norm {norm:.4f}; 1 is needed")]
    if stands and _tilt(pose[3:]) > UPRIGHT and _tilt(np.roll(pose[3:], -1)) <= UPRIGHT:
        tilt = np.rad2deg(_tilt(pose[3:]))
        text = (
            f"'{body}' is tilted by {tilt:.0f} deg, and would stand upright if the quaternion were written "
            "w, x, y, z: does its driver send w first?"
        )
        return [Finding(FAIL, topic.name, text)]
    return []


def _tilt(q: np.ndarray) -> float:
    """Angle (rad) between the vertical axes of the world and of a body with the quaternion q (x, y, z, w)."""
    x, y = float(q[0]), float(q[1])
    return float(np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0)))


def action_findings(name: str, kind: str, types: Sequence[str], servers: int, remedy: str) -> list[Finding]:
    """Whether one server offers an action with the right type."""
    if not servers:
        return [Finding(FAIL, name, f"no controller offers this action: {remedy}")]
    if types and set(types) != {kind}:
        return [Finding(FAIL, name, f"has the type {', '.join(types)}, not {kind}")]
    if servers > 1:
        return [Finding(FAIL, name, f"{servers} nodes offer this action; commands would reach both")]
    return []


def state_finding(node: str, state: str) -> Finding:
    """What is said of a node that runs.

    Args:
        node: its whole name.
        state: of its lifecycle; empty where it has none.
    """
    name = node.rpartition("/")[2]
    if state in ("", ACTIVE):
        return Finding(OK, name, "runs")
    if state not in NEXT:
        return Finding(FAIL, name, f"is {state}: start it anew")
    return Finding(FAIL, name, f"is {state}, and refuses all work: ros2 lifecycle set {node} {NEXT[state]}")
