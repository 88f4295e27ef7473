"""Whether a plan that is under way stays clear of bodies that it does not know of: fast enough to be asked at once.

The planner's own collision model, for robots and for what the plan moves, against the new bodies only.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from hmap_core import transforms
from hmap_core.collision.scene_model import CollisionModel
from hmap_core.kinematics.arm import load_arm
from hmap_core.kinematics.model import KinematicModel, PlacedArm
from hmap_core.komo.min_distances import ROBOT_CLEARANCE
from hmap_core.komo.path_collisions import path_violations
from hmap_core.komo.shapes import body_set
from hmap_core.planner.resampling import by_length, pose_steps
from hmap_core.types import Body, BodyKind, Plan, Robot
from hmap_core.waypoints.checker import ObstacleShapes
from hmap_core.waypoints.kernels import clearances

STEP = 0.01  # m that any link may move between two samples that are looked at
OBJECT_STEP = 0.005  # m that a moved body's origin may move between two of its poses
OBJECT_TURN = 0.03  # rad, the same for its rotation
BINS = 16  # openings of a gripper that are told apart
SAME_PLACE, SAME_TURN = 1e-3, 0.005  # m, rad; a body that has moved less is where it was


@dataclass(frozen=True)
class Conflict:
    """The first place where a plan comes too near to a body that it does not know of.

    Attributes:
        time: planned time, s.
        what: the robot's link, or the moved body.
        body: the new body.
    """

    time: float
    what: str
    body: str


def unknown_bodies(plan: Plan, bodies: Mapping[str, Body]) -> dict[str, Body]:
    """The bodies that the plan does not know, or knows in another place although they are fixed."""
    found = {}
    for name, body in bodies.items():
        known = plan.scene.bodies.get(name)
        if known is None:
            found[name] = body
        elif known.kind is BodyKind.FIXED:
            moved, turned = transforms.distance(known.pose, body.pose)
            if moved > SAME_PLACE or turned > SAME_TURN:
                found[name] = body
    return found


def first_conflict(
    plan: Plan,
    bodies: Mapping[str, Body],
    start: float = 0.0,
    end: float = np.inf,
    objects: Collection[str] | None = None,
    robots: Collection[str] | None = None,
) -> Conflict | None:
    """The first conflict of a plan with bodies at their poses, from a planned time on (s); None where all is free.

    Between two samples that are looked at no link moves farther than STEP, which the minimum distance makes up for
    in half.

    Args:
        objects, robots: those of the plan that are looked at; None: all.
    """
    if not bodies:
        return None
    time = plan.trajectory.time
    rows = np.flatnonzero((time >= start - 1e-9) & (time <= end + 1e-9))
    robots = plan.scene.robots if robots is None else robots
    objects = plan.trajectory.objects if objects is None else objects
    found = [_robot_conflict(plan, plan.scene.robots[name], bodies, rows) for name in robots]
    found += [_object_conflict(plan, name, bodies, rows) for name in objects]
    conflicts = [conflict for conflict in found if conflict is not None]
    return min(conflicts, key=lambda conflict: conflict.time, default=None)


def _robot_conflict(plan: Plan, robot: Robot, bodies: Mapping[str, Body], rows: np.ndarray) -> Conflict | None:
    kinematics = KinematicModel([PlacedArm(robot.name, load_arm(robot.model), robot.base_pose)])
    q = plan.trajectory.joints[robot.name][rows]
    kept = by_length(np.concatenate([[0.0], np.abs(np.diff(q, axis=0)) @ kinematics.chain.reach]), STEP)
    opening = plan.trajectory.gripper.get(robot.name, np.zeros(len(plan.trajectory.time)))[rows][kept]
    levels, bins = np.unique(np.round(opening / _resolution(opening)), return_inverse=True)
    model = _model(kinematics, robot.name, bodies, levels * _resolution(opening))
    masks = np.left_shift(1, bins.ravel()).astype(np.int64)
    violation, pair = path_violations(np.ascontiguousarray(q[kept]), masks, kinematics.chain, model.arrays(), 0.0)
    hit = np.flatnonzero(pair >= 0)
    if not len(hit):
        return None
    names = model.pair_name(int(pair[hit[0]]))
    return Conflict(float(plan.trajectory.time[rows[kept[hit[0]]]]), *names)


def _resolution(opening: np.ndarray) -> float:
    return max(float(np.ptp(opening)) / (BINS - 1), 1e-6)


def _model(kinematics: KinematicModel, robot: str, bodies: Mapping[str, Body], openings: np.ndarray) -> CollisionModel:
    """The links of an arm, what moves with its gripper in phase k at the k-th opening, kept away from the bodies."""
    model, min_distance = CollisionModel(), ROBOT_CLEARANCE + 0.5 * STEP
    others = []
    for body in bodies.values():
        shapes = body_set(body)
        others += [
            model.add(body.name, transforms.apply(body.pose, shapes.hull(s)), shapes.radius[s], 0)
            for s in range(len(shapes))
        ]
    for hull in kinematics.arms[robot].arm.hulls:
        if hull.frame == 0:
            continue
        frame, name = kinematics.frame(robot, hull.frame), f"{robot}/{hull.link}"
        moves = hull.motion is not None
        for k, opening in enumerate(openings if moves else openings[:1]):
            number = model.add(name, hull.at(opening), hull.radius, frame, hull.sphere_at(opening))
            model.keep_apart([number], others, min_distance, 1 << k if moves else -1)
    return model


def _object_conflict(plan: Plan, name: str, bodies: Mapping[str, Body], rows: np.ndarray) -> Conflict | None:
    poses = plan.trajectory.objects[name][rows]
    moved, turned = pose_steps(poses, OBJECT_STEP, OBJECT_TURN)
    kept = by_length(np.concatenate([[0.0], moved + turned]))
    own = body_set(plan.scene.bodies[name])
    for body in bodies.values():
        free = object_clearances(own, poses[kept], body)
        # what stands beside a new body is no conflict of the plan as long as it is not moved nearer
        hit = np.flatnonzero((free < OBJECT_STEP) & (free < free[0] - SAME_PLACE))
        if len(hit):
            return Conflict(float(plan.trajectory.time[rows[kept[hit[0]]]]), name, body.name)
    return None


def object_clearances(own, poses: np.ndarray, body: Body, cap: float = 0.1) -> np.ndarray:
    """Distances (M,) in metres, at most ``cap``, of a convex set at poses (M, 7) from a body at its own pose."""
    around = ObstacleShapes.of((body,))
    arrays = own.vertices, own.start, own.radius, own.center, own.bound
    return clearances(np.ascontiguousarray(poses), *arrays, *around.arrays, np.ones(len(around.radius), bool), cap)
