"""A plan as markers: waypoints red, contacts yellow, the goal's object as a grey ghost at every waypoint."""

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Vector3
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from hmap_core import transforms
from hmap_core.trajectory.samples import index_at
from hmap_core.types import Plan, SegmentKind, Shape, ShapeKind
from hmap_msgs_py.poses import pose_to_message

WAYPOINT_DIAMETER = 0.03  # m
CONTACT_DIAMETER = 0.03  # m
RED = (0.9, 0.1, 0.1, 1.0)
YELLOW = (1.0, 0.85, 0.0, 1.0)
GHOST = (0.6, 0.6, 0.6, 0.25)
MARKER_OF = {ShapeKind.BOX: Marker.CUBE, ShapeKind.SPHERE: Marker.SPHERE, ShapeKind.CYLINDER: Marker.CYLINDER}


def markers_of(plan: Plan, stamp: Time, frame: str) -> MarkerArray:
    """All markers of a plan; the first deletes those of the plan before."""
    header = Header(stamp=stamp, frame_id=frame)
    made = [Marker(header=header, action=Marker.DELETEALL)]
    for i, pose in enumerate(plan.waypoints):
        made.append(_sphere(header, "waypoints", i, pose, WAYPOINT_DIAMETER, RED))
        for shape in plan.scene.bodies[plan.scene.goal.object].shapes:
            ghost = _shape(header, len(made), transforms.multiply(pose, shape.pose), shape)
            made += [ghost] if ghost else []
    for i, pose in enumerate(contact_poses(plan)):
        made.append(_sphere(header, "contacts", i, pose, CONTACT_DIAMETER, YELLOW))
    return MarkerArray(markers=made)


def contact_poses(plan: Plan) -> list[np.ndarray]:
    """``T_world_manipulator`` (7,) of every contact, where it is made."""
    poses = []
    for segment in plan.segments:
        if segment.kind is SegmentKind.TRANSIT or segment.object is None or segment.contact_pose is None:
            continue
        k = index_at(plan.trajectory.time, segment.start)
        poses.append(transforms.multiply(plan.trajectory.objects[segment.object][k], segment.contact_pose))
    return poses


def _sphere(header: Header, namespace: str, number: int, pose: np.ndarray, diameter: float, color) -> Marker:
    scale = Vector3(x=diameter, y=diameter, z=diameter)
    return _marker(header, namespace, number, Marker.SPHERE, pose, scale, color)


def _extents(shape: Shape) -> tuple[float, float, float]:
    """Scale of the marker of a box, sphere or cylinder, m."""
    if shape.kind is ShapeKind.BOX:
        x, y, z = map(float, shape.size)
        return x, y, z
    diameter = 2.0 * float(shape.size[0])
    return diameter, diameter, diameter if shape.kind is ShapeKind.SPHERE else float(shape.size[1])


def _shape(header: Header, number: int, pose: np.ndarray, shape: Shape) -> Marker | None:
    if shape.kind not in MARKER_OF:
        return None
    x, y, z = _extents(shape)
    return _marker(header, "ghosts", number, MARKER_OF[shape.kind], pose, Vector3(x=x, y=y, z=z), GHOST)


def _marker(header: Header, namespace: str, number: int, kind: int, pose, scale: Vector3, color) -> Marker:
    r, g, b, a = color
    return Marker(
        header=header,
        ns=namespace,
        id=number,
        type=kind,
        action=Marker.ADD,
        pose=pose_to_message(pose),
        scale=scale,
        color=ColorRGBA(r=r, g=g, b=b, a=a),
    )
