"""Picture of a robot: at its home configuration, with its gripper open."""

from pathlib import Path

import matplotlib.image
import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.kinematics.arm import load_arm
from hmap_core.simulation.world import SimulatedWorld
from hmap_core.transforms import IDENTITY, to_matrix
from hmap_core.types import Goal, Robot, RobotModel, Scene, TaskMode
from hmap_core.viz.layers import Canvas
from hmap_core.viz.view import camera_around

WIDTH, HEIGHT = 800, 800  # pixels
OVERSAMPLING = 2  # rendered pixels for each pixel of the picture, along each axis
AZIMUTH = np.deg2rad(-50.0)  # of the camera, from the robot's x axis: the front and the right side are visible
AXIS_LENGTH, AXIS_POINTS, AXIS_RADIUS = 0.1, 24, 0.004  # m, number, m: the axes of the end-effector frame
COLORS = ((0.86, 0.12, 0.12), (0.1, 0.62, 0.25), (0.15, 0.3, 0.85))  # of x, y and z
HIDDEN = 0.55  # opacity of an axis where the robot occludes it


def render_robot(model: RobotModel, path: str | Path) -> None:
    """Renders a robot and the axes of its end-effector frame (x red, y green, z blue) into a PNG file.

    Args:
        model: the robot.
        path: the file.

    Raises:
        InputError: the robot cannot be loaded by the simulation, or the file cannot be written.
    """
    robot = Robot("robot", model, IDENTITY, model.home)
    scene = Scene("robot", 0, TaskMode.PHYSICAL, {}, {"robot": robot}, {}, Goal("", IDENTITY))
    camera = camera_around(_points(model), AZIMUTH, OVERSAMPLING * WIDTH, OVERSAMPLING * HEIGHT)
    with SimulatedWorld(scene) as world:
        image = world.render(camera)
        frame = world.robot("robot").end_effector_pose()
    canvas = Canvas(camera, image.color, image.depth)
    _axes(canvas, frame)
    pixels = canvas.color.reshape(HEIGHT, OVERSAMPLING, WIDTH, OVERSAMPLING, 3).mean(axis=(1, 3))
    try:
        matplotlib.image.imsave(str(path), (255.0 * pixels).round().astype(np.uint8), format="png")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error}") from error


def _points(model: RobotModel) -> np.ndarray:
    """Vertices (N, 3) of all links at home, and the base's origin, m."""
    arm = load_arm(model)
    R, p = arm.frames(model.home)
    opening = model.gripper.open_opening if model.gripper else 0.0
    points = [hull.at(opening) @ R[hull.frame].T + p[hull.frame] for hull in arm.hulls]
    return np.concatenate([np.zeros((1, 3)), p, *points])


def _axes(canvas: Canvas, frame: np.ndarray) -> None:
    """Draws the axes of a frame (7,) as rows of spheres."""
    T = to_matrix(frame)
    for axis, color in zip(T[:3, :3].T, COLORS, strict=True):
        for share in np.linspace(0.0, 1.0, AXIS_POINTS):
            canvas.sphere(T[:3, 3] + share * AXIS_LENGTH * axis, AXIS_RADIUS, color, HIDDEN)
