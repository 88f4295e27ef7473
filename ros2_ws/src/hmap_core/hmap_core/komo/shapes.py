"""Convex shapes of bodies and of robots that stand still."""

import numpy as np

from hmap_core.collision.convex import ConvexSet, convex_set
from hmap_core.kinematics.arm import load_arm
from hmap_core.transforms import apply, multiply, pose
from hmap_core.types import Body, Robot, Shape, ShapeKind


def body_set(body: Body) -> ConvexSet:
    """Convex set of a body in its own frame; computed once per geometry."""
    return convex_set(body.shapes)


def box_round(points: np.ndarray, radius: float, T: np.ndarray) -> Shape:
    """The box round a hull with vertices (n, 3), swept by a sphere, in the axes of its frame, which is at T (7,)."""
    lower, upper = points.min(axis=0) - radius, points.max(axis=0) + radius
    return Shape(ShapeKind.BOX, tuple(upper - lower), multiply(T, pose(0.5 * (lower + upper))))


def posed_links(robot: Robot, q: np.ndarray, opening: float):
    """Links of a robot standing at q (n,) as (name, world vertices (m, 3), radius, bounding sphere, edges)."""
    arm = load_arm(robot.model)
    R, p = arm.frames(q)
    posed = []
    for hull in arm.hulls:
        center, bound = hull.sphere_at(opening)
        vertices = apply(robot.base_pose, hull.at(opening) @ R[hull.frame].T + p[hull.frame])
        center = apply(robot.base_pose, R[hull.frame] @ center + p[hull.frame])
        posed.append((hull.link, vertices, hull.radius, (center, bound), hull.edges))
    return posed
