"""Conversions of the inputs and results of H-MaP's three phases."""

import numpy as np

from hmap.conversions import known_robots
from hmap_core.planner.interfaces import RobotContact, SubTrajectory
from hmap_core.types import ContactKind, ContactPoint, Scene, Segment, SegmentKind, Trajectory
from hmap_core.waypoints import ObjectPath
from hmap_msgs import msg
from hmap_msgs_py import contacts, plans
from hmap_msgs_py.checks import ConversionError


def path_to_response(path: ObjectPath, name: str, response) -> None:
    """Fill a PlanWaypoints response."""
    response.path = msg.ObjectPath(object=name, poses=path.poses.ravel().tolist())
    response.cuts = [int(i) for i in path.cuts]
    response.clearance = path.clearance.tolist()
    response.motion = path.motion
    first = np.concatenate([path.poses[:1], path.waypoints])
    response.waypoints = plans.waypoints_to_message(name, first)


def path_from_response(response) -> ObjectPath:
    """Convert the response of :func:`path_to_response` to a path."""
    poses = np.array(response.path.poses).reshape(-1, 7)
    return ObjectPath(poses, np.array(response.cuts, int), np.array(response.clearance), response.motion)


def contact_to_message(contact: RobotContact, name: str) -> msg.ContactCandidate:
    """Convert a feasible contact, with its reach and configurations."""
    return contacts.contact_to_message(
        contact.contact, contact.robot, name, int(contact.reach), contact.keyframes, contact.clear
    )


def point_from_message(message: msg.ContactCandidate) -> ContactPoint:
    """Convert to the contact of a candidate, without its reach."""
    fields = contacts.contact_from_message(message)
    return ContactPoint(**fields | {"kind": ContactKind(fields["kind"])})


def contact_from_message(scene: Scene, message: msg.ContactCandidate) -> RobotContact:
    """Convert to a feasible contact of a robot of the scene."""
    known_robots(scene, [message.robot])
    return feasible_contact(scene, message.robot, point_from_message(message), message)


def feasible_contact(
    scene: Scene, robot: str, contact: ContactPoint, message: msg.ContactCandidate | msg.ContactFeasibility
) -> RobotContact:
    """The contact with the reach, configurations and robots to clear that a message has.

    Raises:
        ConversionError: the number of configurations differs from reach + 1.
    """
    keyframes = contacts.keyframes_from_message(message, len(scene.robots[robot].model.joint_names))
    if len(keyframes) != message.reach + 1:
        raise ConversionError(f"keyframes of {robot!r} has {len(keyframes)} rows; reach is {message.reach}")
    clear = tuple(known_robots(scene, message.clear)) if message.clear else ()
    return RobotContact(robot, contact, int(message.reach), keyframes, clear)


def motion_to_response(scene: Scene, motion: SubTrajectory, response) -> None:
    """Fill a SolveSegment response."""
    names = {name: robot.model.joint_names for name, robot in scene.robots.items()}
    response.trajectory = plans.trajectory_to_message(motion.trajectory, names)
    response.segments = [plans.segment_to_message(segment) for segment in motion.segments]


def motion_from_response(scene: Scene, response) -> SubTrajectory:
    """Convert the response of :func:`motion_to_response` to a sub-trajectory."""
    names = {name: robot.model.joint_names for name, robot in scene.robots.items()}
    trajectory = Trajectory(**plans.trajectory_from_message(response.trajectory, names))
    return SubTrajectory(trajectory, tuple(_segment(message) for message in response.segments))


def _segment(message: msg.Segment) -> Segment:
    fields = plans.segment_from_message(message)
    return Segment(**fields | {"kind": SegmentKind(fields["kind"])})
