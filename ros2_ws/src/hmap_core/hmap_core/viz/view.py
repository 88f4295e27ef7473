"""Viewpoint of the picture of a plan, chosen so that robots, waypoints and goal are visible."""

import numpy as np

from hmap_core import transforms
from hmap_core.types import Camera, Plan, Shape

ELEVATION = np.deg2rad(38.0)
TWIST = np.deg2rad(-12.0)  # azimuth relative to the line from the robots to the object, so that depth is visible
FOV_Y = np.deg2rad(30.0)
ROBOT_HEIGHT = 0.55  # m, height up to which the robots are visible
MIN_DISTANCE = 1.06  # relative to the distance at which everything just fits
MIN_LEVER = 0.05  # m, horizontal distance from robots to object below which it defines no direction


def camera_for(plan: Plan, width: int, height: int) -> Camera:
    """Chooses the camera: beyond the object as seen from the robots, looking down at it.

    Args:
        plan: the plan.
        width, height: pixels.

    Returns:
        The camera.
    """
    points = _points(plan)
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    bases = np.array([robot.base_pose[:3] for robot in plan.scene.robots.values()] or [center])
    goal_object = plan.trajectory.objects[plan.scene.goal.object]
    forward = (goal_object[:, :3].mean(axis=0) - bases.mean(axis=0)) * [1.0, 1.0, 0.0]
    # perpendicular to the line through the bases of several robots
    if len(bases) > 1:
        line = (bases[-1] - bases[0]) * [1.0, 1.0, 0.0]
        line /= max(np.linalg.norm(line), 1e-9)
        forward = forward - line * (forward @ line)
    forward = forward / np.linalg.norm(forward) if np.linalg.norm(forward) > MIN_LEVER else np.array([0.0, -1.0, 0.0])
    return camera_around(points, float(np.arctan2(forward[1], forward[0])) + TWIST, width, height)


def camera_around(points: np.ndarray, azimuth: float, width: int, height: int) -> Camera:
    """The camera that looks down at points from a direction, so that all are visible.

    Args:
        points: (N, 3) m, world frame.
        azimuth: rad, direction from the points to the camera in the horizontal plane.
        width, height: pixels.

    Returns:
        The camera.
    """
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    outward = np.array([np.cos(ELEVATION) * np.cos(azimuth), np.cos(ELEVATION) * np.sin(azimuth), np.sin(ELEVATION)])
    R = _rotation(-outward)
    local = (points - center) @ R
    tan = np.tan(0.5 * FOV_Y) * np.array([width / height, 1.0])
    distance = float((np.abs(local[:, :2]) / tan - local[:, 2:]).max()) * MIN_DISTANCE
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = R, center + distance * outward
    return Camera("picture", transforms.from_matrix(matrix), width, height, float(FOV_Y))


def _points(plan: Plan) -> np.ndarray:
    """Points (N, 3) that must be visible, world frame: the object at start, waypoints and goal, and the robots."""
    body = plan.scene.bodies[plan.scene.goal.object]
    corners = np.array([transforms.apply(shape.pose, _corners(shape)) for shape in body.shapes]).reshape(-1, 3)
    poses = [body.pose, *plan.waypoints, plan.scene.goal.pose]
    points = [transforms.apply(pose, corners) for pose in poses]
    for robot in plan.scene.robots.values():
        points.append(robot.base_pose[:3] + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, ROBOT_HEIGHT]]))
    return np.concatenate(points)


def _corners(shape: Shape) -> np.ndarray:
    size = np.asarray(shape.size, float)
    half = 0.5 * size if len(size) == 3 else np.full(3, size.max())
    return np.array(np.meshgrid(*np.stack([-half, half], axis=1))).reshape(3, -1).T


def _rotation(forward: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) of a camera with optical axis ``forward`` (3,) and level horizon: x right, y down, z forward."""
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(forward, right), forward])
