"""Viewpoint of the pictures of a plan: of many cameras around it, the one that sees most of what matters.

What matters are the goal's object and its goal, the tools and objects in contact, and the hands that touch them.
Rays tell how much of these a camera sees. The camera also should see the scene large, and not far from the usual side:
beyond the object as seen from the robots, from above.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hmap_core import transforms
from hmap_core.simulation.camera import FAR
from hmap_core.types import BodyKind, Camera, Plan
from hmap_core.viz.key_frames import contact_at, key_samples
from hmap_core.viz.stage import Stage, corners, points_of

AZIMUTHS = 24
ELEVATIONS = tuple(np.deg2rad([12.0, 25.0, 38.0, 55.0]))
USUAL = 2  # index of the elevation that is preferred
FOVS_Y = tuple(np.deg2rad([30.0, 50.0, 70.0, 90.0]))  # the first that is wide enough
REACH = 0.9 * FAR  # m, largest distance between camera and scene
ROOM = 1.06  # distance relative to that at which everything just fits
MIN_LEVER = 0.05  # m, horizontal distance from robots to object below which it defines no direction
NEAR = 0.1  # m; fixed bodies this near to what moves are in the picture
WHOLE = 1.7  # relative to the extent of what moves; larger bodies may be cut off
OBJECT, GOAL, HAND = 1.0, 0.4, 0.6  # weights of how much is seen of these
SIZE = 0.5  # weight of the share of the picture that the motion spans, along its shorter side
ASIDE, STEEP = 0.06, 0.05  # weights of the deviation from the usual azimuth (half a turn) and elevation (one step)


@dataclass(frozen=True)
class Target:
    """Points (n, 3) in the world that should be seen, the names that a ray to them may hit, and a weight."""

    points: np.ndarray
    names: frozenset[str]
    weight: float


def camera_for(plan: Plan, width: int, height: int, samples: Sequence[int] | None = None) -> Camera:
    """Chooses the camera that sees most of what matters in a plan.

    Args:
        plan: the plan.
        width, height: pixels.
        samples: of the plan, that should be seen; None: the key frames.

    Returns:
        The camera.
    """
    samples = key_samples(plan) if samples is None else samples
    with Stage(plan) as stage:
        framed = _framed(stage, samples)
        usual = _usual_azimuth(plan, framed)
        cameras, preferences = [], []
        for turn in 2.0 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS:
            for step, elevation in enumerate(ELEVATIONS):
                cameras.append(camera_around(framed, usual + float(turn), width, height, elevation))
                preferences.append(-ASIDE * (1.0 - np.cos(turn)) / 2.0 - STEEP * abs(step - USUAL))
        moving = _moving(stage, samples)
        scores = np.array(preferences) + SIZE * np.array([_extent(camera, moving) for camera in cameras])
        scores += _visibility(stage, samples, cameras)
    return cameras[int(scores.argmax())]


def camera_around(
    points: np.ndarray, azimuth: float, width: int, height: int, elevation: float = ELEVATIONS[USUAL]
) -> Camera:
    """The camera that looks down at points from a direction, so that all are visible.

    Args:
        points: (N, 3) m, world frame.
        azimuth: rad, direction from the points to the camera in the horizontal plane.
        width, height: pixels.
        elevation: rad, of that direction above the horizontal plane.

    Returns:
        The camera.
    """
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    outward = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    R = _rotation(-outward)
    local = (points - center) @ R
    for fov_y in FOVS_Y:
        tan = np.tan(0.5 * fov_y) * np.array([width / height, 1.0])
        distance = float((np.abs(local[:, :2]) / tan - local[:, 2:]).max()) * ROOM
        if distance <= REACH:
            break
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = R, center + distance * outward
    return Camera("picture", transforms.from_matrix(matrix), width, height, float(fov_y))


def project(camera: Camera, points: np.ndarray) -> np.ndarray:
    """Where points (n, 3) are in a picture: (n, 2), -1 to 1 between its edges; nan behind the camera."""
    local = transforms.apply(transforms.inverse(camera.pose), points)
    tan = np.tan(0.5 * camera.fov_y) * np.array([camera.width / camera.height, 1.0])
    depth = np.where(local[:, 2:] > 0.0, local[:, 2:], np.nan)
    return local[:, :2] / depth / tan


def _moving(stage: Stage, samples: Sequence[int]) -> np.ndarray:
    """Points (n, 3) of what moves, where it is at the samples: objects, tools, hands, and the goal."""
    plan, found = stage.plan, [_at_goal(stage.plan)]
    for k in samples:
        stage.show(k)
        for name in stage.shown(k):
            found.append(transforms.apply(stage.world.body_pose(name), points_of(plan.scene.bodies[name], 1.0)))
        contact = contact_at(plan, k)
        if contact is not None:
            found.append(stage.hand(contact.robot))
    return np.concatenate(found)


def _framed(stage: Stage, samples: Sequence[int]) -> np.ndarray:
    """Points (n, 3) that must be in the picture: what moves, fixed bodies around it, and the robots' bases."""
    plan = stage.plan
    found = [_moving(stage, samples)]
    low, high = corners(found)
    extent = float(np.linalg.norm(high - low))
    for body in plan.scene.bodies.values():
        points = transforms.apply(body.pose, points_of(body, 1.0))
        own_low, own_high = corners([points])
        near = np.all((own_low < high + NEAR) & (own_high > low - NEAR))
        if body.kind is BodyKind.FIXED and near and np.linalg.norm(own_high - own_low) <= WHOLE * extent:
            found.append(points)
    found += [robot.base_pose[None, :3] for robot in plan.scene.robots.values()]
    return np.concatenate(found)


def _usual_azimuth(plan: Plan, framed: np.ndarray) -> float:
    """Direction from the robots' bases to the object, perpendicular to the line through several bases, rad."""
    bases = np.array([robot.base_pose[:3] for robot in plan.scene.robots.values()] or [framed.mean(axis=0)])
    goal_object = plan.trajectory.objects.get(plan.scene.goal.object)
    middle = framed.mean(axis=0) if goal_object is None else goal_object[:, :3].mean(axis=0)
    forward = (middle - bases.mean(axis=0)) * [1.0, 1.0, 0.0]
    if len(bases) > 1:
        line = (bases[-1] - bases[0]) * [1.0, 1.0, 0.0]
        line /= max(np.linalg.norm(line), 1e-9)
        forward = forward - line * (forward @ line)
    if np.linalg.norm(forward) < MIN_LEVER:
        return -0.5 * float(np.pi)
    return float(np.arctan2(forward[1], forward[0]))


def _visibility(stage: Stage, samples: Sequence[int], cameras: Sequence[Camera]) -> np.ndarray:
    """How much of what matters each camera sees, on average over the samples: (C,), from 0 to 1."""
    seen = np.zeros(len(cameras))
    for k in samples:
        stage.show(k)
        targets = _targets(stage, k)
        points = np.concatenate([target.points for target in targets])
        total = sum(target.weight for target in targets)
        for i, camera in enumerate(cameras):
            hits = iter(stage.world.first_hits(camera.pose[:3], points))
            for target in targets:
                free = [(hit := next(hits)) == "" or hit in target.names for _ in target.points]
                seen[i] += target.weight * float(np.mean(free)) / total / len(samples)
    return seen


def _targets(stage: Stage, sample: int) -> list[Target]:
    """What should be seen at a sample, which is shown."""
    plan, bodies = stage.plan, stage.plan.scene.bodies
    contact = contact_at(plan, sample)
    shown = stage.shown(sample)
    targets = [Target(_at_goal(plan, inside=True), frozenset({plan.scene.goal.object}), GOAL)]
    for name in sorted(shown):
        points = transforms.apply(stage.world.body_pose(name), points_of(bodies[name]))
        targets.append(Target(points, frozenset({name}), OBJECT))
    if contact is not None:
        targets.append(Target(stage.hand(contact.robot), frozenset({contact.robot, *shown}), HAND))
    return targets


def _at_goal(plan: Plan, inside: bool = False) -> np.ndarray:
    """Points (n, 3) of the goal's object at its goal."""
    body = plan.scene.bodies[plan.scene.goal.object]
    return transforms.apply(plan.scene.goal.pose, points_of(body) if inside else points_of(body, 1.0))


def _extent(camera: Camera, points: np.ndarray) -> float:
    """The shorter side of the box around points in a picture, as a share of the picture's."""
    places = project(camera, points)
    return float((places.max(axis=0) - places.min(axis=0)).min() / 2.0)


def _rotation(forward: np.ndarray) -> np.ndarray:
    """Rotation (3, 3) of a camera with optical axis ``forward`` (3,) and level horizon: x right, y down, z forward."""
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.column_stack([right, np.cross(forward, right), forward])
