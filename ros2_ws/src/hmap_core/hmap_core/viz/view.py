"""Where to look at a plan from, so that everything that matters is in the picture."""

import numpy as np

from hmap_core import transforms
from hmap_core.types import Camera, Plan

ELEVATION = np.deg2rad(38.0)
TWIST = np.deg2rad(-12.0)  # off the line from the robots to the work, so that depth can be seen
FOV_Y = np.deg2rad(30.0)
ROBOT_HEIGHT = 0.55  # m; the robots are in the picture up to here
MIN_DISTANCE = 1.06  # of the distance at which everything just fits
MIN_LEVER = 0.05  # m; robots nearer to the work than this say nothing about a direction


def camera_for(plan: Plan, width: int, height: int) -> Camera:
    """A camera on the far side of the work, looking down on it towards the robots."""
    points = _points(plan)
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    bases = np.array([robot.base_pose[:3] for robot in plan.scene.robots.values()] or [center])
    goal_object = plan.trajectory.objects[plan.scene.goal.object]
    forward = (goal_object[:, :3].mean(axis=0) - bases.mean(axis=0)) * [1.0, 1.0, 0.0]
    # across the line on which several robots stand, rather than along it
    if len(bases) > 1:
        line = (bases[-1] - bases[0]) * [1.0, 1.0, 0.0]
        line /= max(np.linalg.norm(line), 1e-9)
        forward = forward - line * (forward @ line)
    forward = forward / np.linalg.norm(forward) if np.linalg.norm(forward) > MIN_LEVER else np.array([0.0, -1.0, 0.0])
    azimuth = np.arctan2(forward[1], forward[0]) + TWIST
    outward = np.array([np.cos(ELEVATION) * np.cos(azimuth), np.cos(ELEVATION) * np.sin(azimuth), np.sin(ELEVATION)])
    R = _rotation(-outward)
    local = (points - center) @ R
    tan = np.tan(0.5 * FOV_Y) * np.array([width / height, 1.0])
    distance = float((np.abs(local[:, :2]) / tan - local[:, 2:]).max()) * MIN_DISTANCE
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = R, center + distance * outward
    return Camera("picture", transforms.from_matrix(matrix), width, height, float(FOV_Y))


def _points(plan: Plan) -> np.ndarray:
    """What has to be in the picture (N, 3): the object along its way, the robots."""
    body = plan.scene.bodies[plan.scene.goal.object]
    corners = np.array([transforms.apply(shape.pose, _corners(shape)) for shape in body.shapes]).reshape(-1, 3)
    poses = [body.pose, *plan.waypoints, plan.scene.goal.pose]
    points = [transforms.apply(pose, corners) for pose in poses]
    for robot in plan.scene.robots.values():
        points.append(robot.base_pose[:3] + np.array([[0.0, 0.0, 0.0], [0.0, 0.0, ROBOT_HEIGHT]]))
    return np.concatenate(points)


def _corners(shape) -> np.ndarray:
    size = np.asarray(shape.size, float)
    half = 0.5 * size if len(size) == 3 else np.full(3, size.max())
    return np.array(np.meshgrid(*np.stack([-half, half], axis=1))).reshape(3, -1).T


def _rotation(forward: np.ndarray) -> np.ndarray:
    """Columns x right, y down, z forward of a camera that looks along ``forward`` with the horizon level."""
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(forward, right), forward])
