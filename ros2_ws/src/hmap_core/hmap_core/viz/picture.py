"""Picture of a plan: robots at the first contact, ghosts at the other contacts, waypoints red, contacts yellow."""

from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np

from hmap_core import transforms
from hmap_core.exceptions import InputError
from hmap_core.simulation.world import SimulatedWorld
from hmap_core.trajectory.samples import index_at
from hmap_core.types import Camera, Plan, Segment, SegmentKind
from hmap_core.viz.layers import Canvas
from hmap_core.viz.view import camera_for

WIDTH, HEIGHT = 1000, 560  # pixels
OVERSAMPLING = 2  # rendered pixels for each pixel of the picture, along each axis
SPHERE_RADIUS = 0.014  # m
RED, YELLOW, GREEN = (0.86, 0.12, 0.12), (1.0, 0.82, 0.05), (0.1, 0.62, 0.25)
GREY = 0.45  # brightness that the object's ghosts are blended with
GHOST_ALPHA, GHOST_HIDDEN = 0.45, 0.16  # opacity of the object's ghosts where visible, and where occluded
ROBOT_ALPHA, ROBOT_HIDDEN = 0.22, 0.0  # opacity of the robots' ghosts where visible, and where occluded
SPHERE_HIDDEN = 0.55  # opacity of occluded spheres
OUTLINE = 2  # width in pixels of the picture


def render(plan: Plan, path: str | Path) -> None:
    """Renders a plan into a PNG file.

    Args:
        plan: the plan.
        path: the file.

    Raises:
        InputError: the file cannot be written.
    """
    pixels = draw(plan, WIDTH, HEIGHT)
    try:
        matplotlib.image.imsave(str(path), pixels, format="png")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error}") from error


def draw(plan: Plan, width: int, height: int) -> np.ndarray:
    """Renders a plan.

    Args:
        plan: the plan.
        width, height: pixels.

    Returns:
        The picture (height, width, 3), RGB, uint8.
    """
    camera = camera_for(plan, OVERSAMPLING * width, OVERSAMPLING * height)
    canvas = _base(plan, camera)
    _robot_ghosts(plan, camera, canvas)
    _object_ghosts(plan, camera, canvas)
    for pose in plan.waypoints:
        canvas.sphere(pose[:3], SPHERE_RADIUS, RED, SPHERE_HIDDEN)
    for segment in _contacts(plan):
        canvas.sphere(_contact_point(plan, segment), SPHERE_RADIUS, YELLOW, SPHERE_HIDDEN)
    shape = (height, OVERSAMPLING, width, OVERSAMPLING, 3)
    return (255.0 * canvas.color.reshape(shape).mean(axis=(1, 3))).round().astype(np.uint8)


def _contacts(plan: Plan) -> list[Segment]:
    return [s for s in plan.segments if s.kind is not SegmentKind.TRANSIT and s.contact_pose is not None]


def _contact_point(plan: Plan, segment: Segment) -> np.ndarray:
    k = index_at(plan.trajectory.time, segment.start)
    return transforms.multiply(plan.trajectory.objects[segment.contact_object][k], segment.T_obj_manipulator)[:3]


def _moment(plan: Plan, segment: Segment) -> int:
    """The sample at which a contact is made."""
    return index_at(plan.trajectory.time, segment.start)


def _place(plan: Plan, world: SimulatedWorld, robot: str, sample: int) -> None:
    trajectory = plan.trajectory
    world.robot(robot).place(trajectory.joints[robot][sample], float(trajectory.gripper[robot][sample]))


def _base(plan: Plan, camera: Camera) -> Canvas:
    """Renders the scene at the first contact."""
    sample = _moment(plan, _contacts(plan)[0]) if _contacts(plan) else 0
    with SimulatedWorld(plan.scene) as world:
        for name in plan.scene.robots:
            _place(plan, world, name, sample)
        for name, poses in plan.trajectory.objects.items():
            world.move_body(name, poses[sample])
        image = world.render(camera)
    return Canvas(camera, image.color, image.depth)


def _robot_ghosts(plan: Plan, camera: Camera, canvas: Canvas) -> None:
    """Draws ghosts of the robots at their other contacts."""
    for segment in _contacts(plan)[1:]:
        alone = replace(plan.scene, bodies={}, robots={segment.robot: plan.scene.robots[segment.robot]})
        with SimulatedWorld(alone) as world:
            _place(plan, world, segment.robot, _moment(plan, segment))
            image = world.render(camera)
            canvas.ghost(image.color / 255.0, image.depth, image.mask > 0, ROBOT_ALPHA, ROBOT_HIDDEN)


def _object_ghosts(plan: Plan, camera: Camera, canvas: Canvas) -> None:
    """Draws grey ghosts of the goal's object at its waypoints, and a green outline of its goal."""
    name = plan.scene.goal.object
    alone = replace(plan.scene, bodies={name: plan.scene.bodies[name]}, robots={})
    with SimulatedWorld(alone) as world:
        for pose in plan.waypoints:
            world.move_body(name, pose)
            image = world.render(camera)
            grey = np.repeat(image.color.mean(axis=2, keepdims=True) / 255.0, 3, axis=2) * 0.5 + GREY * 0.5
            canvas.ghost(grey, image.depth, image.mask > 0, GHOST_ALPHA, GHOST_HIDDEN)
        world.move_body(name, plan.scene.goal.pose)
        canvas.outline(world.render(camera).mask > 0, GREEN, OVERSAMPLING * OUTLINE)
