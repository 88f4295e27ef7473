"""Conversions of trajectories, segments, waypoints and plans."""

import array
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import KeyValue
from geometry_msgs.msg import Pose
from std_msgs.msg import Header

from hmap_msgs.msg import ObjectPath, Plan, PlanTrajectory, RobotPath, Scene, Segment, Waypoint, Waypoints
from hmap_msgs_py.checks import ConversionError, field, finite, one_of, poses
from hmap_msgs_py.poses import pose_from_message, pose_to_message, poses_to_messages
from hmap_msgs_py.world import WORLD_FRAME, scene_from_message

SEGMENT_KINDS = (Segment.TRANSIT, Segment.TOUCH, Segment.GRASP, Segment.PUSH, Segment.PRESS)
TYPED_KEYS = ("trajectory", "segments", "waypoints", "stats")  # entries of a plan file with their own fields


def trajectory_to_message(trajectory: Any, joint_names: Mapping[str, Sequence[str]]) -> PlanTrajectory:
    """Convert timed samples.

    Args:
        trajectory: has ``time`` (N,), ``joints`` {robot: (N, n)}, ``gripper`` {robot: (N,)} and
            ``objects`` {name: (N, 7)}.
        joint_names: robot -> the names of its n joints, in the order of the columns.

    Raises:
        ConversionError: a value is not allowed.
    """
    time = _increasing(field(trajectory, "time"))
    gripper = field(trajectory, "gripper")
    robots = []
    for robot, positions in field(trajectory, "joints").items():
        names = list(joint_names[robot])
        rows = finite(f"joints of {robot!r}", positions, (len(time), len(names)))
        opening = finite(f"gripper of {robot!r}", gripper[robot], (len(time),))
        robots.append(RobotPath(robot=robot, joint_names=names, positions=_doubles(rows), gripper=_doubles(opening)))
    objects = [
        ObjectPath(object=name, poses=_doubles(poses(f"path of {name!r}", path, len(time))))
        for name, path in field(trajectory, "objects").items()
    ]
    return PlanTrajectory(time=_doubles(time), robots=robots, objects=objects)


def trajectory_from_message(
    message: PlanTrajectory, joint_names: Mapping[str, Sequence[str]] | None = None
) -> dict[str, Any]:
    """Convert to ``{time, joints, gripper, objects}``, as in :func:`trajectory_to_message`.

    Args:
        message: the message.
        joint_names: robot -> joint names in the wanted order of the columns; default: as in the message.

    Raises:
        ConversionError: a value is not allowed.
    """
    time = _increasing(message.time)
    joints, gripper = {}, {}
    for path in message.robots:
        names = list(path.joint_names)
        rows = _rows(f"positions of {path.robot!r}", path.positions, len(time), len(names))
        if joint_names is not None and path.robot in joint_names:
            rows = rows[:, _columns(path.robot, names, joint_names[path.robot])]
        joints[path.robot] = rows
        gripper[path.robot] = finite(f"gripper of {path.robot!r}", path.gripper, (len(time),))
    objects = {}
    for path in message.objects:
        name = f"path of {path.object!r}"
        objects[path.object] = poses(name, _rows(name, path.poses, len(time), 7))
    return {"time": time, "joints": joints, "gripper": gripper, "objects": objects}


def segment_to_message(segment: Any) -> Segment:
    """Convert a segment, a time interval with one contact mode.

    Args:
        segment: has ``start``, ``end``, ``robot``, ``manipulator``, ``object``, ``kind`` and ``contact_pose``,
            and a press ``force`` (N).

    Raises:
        ConversionError: a value is not allowed.
    """
    contact = field(segment, "contact_pose", None)
    return Segment(
        start=float(finite("start of segment", field(segment, "start"), ())),
        end=float(finite("end of segment", field(segment, "end"), ())),
        robot=field(segment, "robot"),
        manipulator=field(segment, "manipulator"),
        object=field(segment, "object", None) or "",
        kind=one_of("kind of segment", field(segment, "kind"), SEGMENT_KINDS),
        has_contact=contact is not None,
        contact_pose=Pose() if contact is None else pose_to_message(contact, "contact pose"),
        force=float(finite("force of segment", field(segment, "force", None) or 0.0, ())),
    )


def segment_from_message(message: Segment) -> dict[str, Any]:
    """Convert to the keys of :func:`segment_to_message`; object and contact_pose are None in transit, and only a press
    has a force.

    Raises:
        ConversionError: a value is not allowed.
    """
    fields: dict[str, Any] = {
        "start": float(finite("start of segment", message.start, ())),
        "end": float(finite("end of segment", message.end, ())),
        "robot": message.robot,
        "manipulator": message.manipulator,
        "object": message.object or None,
        "kind": one_of("kind of segment", message.kind, SEGMENT_KINDS),
        "contact_pose": pose_from_message(message.contact_pose, "contact pose") if message.has_contact else None,
    }
    if message.kind == Segment.PRESS:
        fields["force"] = float(finite("force of segment", message.force, ()))
    return fields


def waypoints_to_message(object_name: str, values: np.ndarray, stamp: Time | None = None) -> Waypoints:
    """Convert the sub-goals T_world_obj (I, 7) of an object.

    Raises:
        PoseError: a pose is malformed.
    """
    return Waypoints(
        header=Header(stamp=stamp or Time(), frame_id=WORLD_FRAME),
        waypoints=[
            Waypoint(object=object_name, index=i, pose=pose)
            for i, pose in enumerate(poses_to_messages(values, f"waypoints of {object_name!r}"))
        ],
    )


def waypoints_from_message(message: Waypoints) -> np.ndarray:
    """Convert to sub-goals T_world_obj (I, 7).

    Raises:
        PoseError: a pose is malformed.
    """
    values = [pose_from_message(waypoint.pose, f"waypoint {waypoint.index}") for waypoint in message.waypoints]
    return np.array(values).reshape(-1, 7)


def statistics_to_messages(statistics: Mapping[str, Any]) -> list[KeyValue]:
    """Convert statistics to names and JSON values."""
    return [KeyValue(key=str(key), value=json.dumps(value)) for key, value in statistics.items()]


def statistics_from_messages(messages: Iterable[KeyValue]) -> dict[str, Any]:
    """Convert to the dict that :func:`statistics_to_messages` takes.

    Raises:
        ConversionError: a value is no JSON.
    """
    return {message.key: _statistic(message) for message in messages}


def _statistic(message: KeyValue) -> Any:
    try:
        return json.loads(message.value)
    except (ValueError, RecursionError) as error:
        raise ConversionError(f"statistic {message.key!r}: {message.value[:40]!r} is no JSON: {error}") from error


def plan_to_message(plan: Mapping[str, Any], stamp: Time | None = None) -> Plan:
    """Convert a plan in the form of its file.

    Raises:
        ConversionError: a value is not allowed.
    """
    header = Header(stamp=stamp or Time(), frame_id=WORLD_FRAME)
    rest = {key: value for key, value in plan.items() if key not in TYPED_KEYS}
    joint_names = {name: robot["joint_names"] for name, robot in plan["robots"].items()}
    return Plan(
        header=header,
        scene=Scene(task=plan["task"], seed=int(plan["seed"]), mode=str(plan["mode"]), text=json.dumps(rest)),
        trajectory=trajectory_to_message(plan["trajectory"], joint_names),
        segments=[segment_to_message(segment) for segment in plan["segments"]],
        waypoints=waypoints_to_message(plan["goal"]["object"], plan["waypoints"], header.stamp),
        statistics=statistics_to_messages(plan.get("stats", {})),
    )


def plan_from_message(message: Plan) -> dict[str, Any]:
    """Convert to the form of a plan file, with JSON values only.

    Raises:
        ConversionError: a value is not allowed.
    """
    plan = scene_from_message(message.scene)
    trajectory = trajectory_from_message(message.trajectory)
    plan["trajectory"] = {"time": trajectory["time"].tolist()} | {
        key: {name: samples.tolist() for name, samples in trajectory[key].items()}
        for key in ("joints", "gripper", "objects")
    }
    plan["segments"] = [segment_from_message(segment) for segment in message.segments]
    for segment in plan["segments"]:
        if segment["contact_pose"] is not None:
            segment["contact_pose"] = segment["contact_pose"].tolist()
    plan["waypoints"] = waypoints_from_message(message.waypoints).tolist()
    plan["stats"] = statistics_from_messages(message.statistics)
    return plan


def _doubles(values: np.ndarray) -> array.array:
    return array.array("d", np.ascontiguousarray(values, np.float64).tobytes())


def _increasing(values: Any) -> np.ndarray:
    """Check times (N,) in seconds."""
    time = finite("time", values, (None,))
    if np.any(np.diff(time) <= 0.0):
        raise ConversionError(f"time must increase; it does not after sample {int(np.argmax(np.diff(time) <= 0.0))}")
    return time


def _rows(name: str, values: Any, rows: int, columns: int) -> np.ndarray:
    if len(values) != rows * columns:
        raise ConversionError(f"{name} has {len(values)} values; it must have {rows} rows of {columns}")
    return finite(name, values).reshape(rows, columns)


def _columns(robot: str, given: Sequence[str], wanted: Sequence[str]) -> list[int]:
    if sorted(given) != sorted(wanted):
        raise ConversionError(f"the joints of {robot!r} are {', '.join(given)}; they must be {', '.join(wanted)}")
    return [list(given).index(name) for name in wanted]
