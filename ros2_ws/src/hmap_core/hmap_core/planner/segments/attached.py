"""Bodies that are attached to a hand: they become part of the robot, and move along with it."""

from dataclasses import replace

import numpy as np

from hmap_core.kinematics.arm import load_arm
from hmap_core.planner.interfaces import SubTrajectory
from hmap_core.transforms import consistent, inverse, multiply, multiply_all, rotation_matrix
from hmap_core.types import AttachedBody, ContactPoint, Scene, Segment, SegmentKind, TaskMode


def attach_body(scene: Scene, robot: str, body: str, contact: ContactPoint, T_standing: np.ndarray) -> Scene:
    """The scene in which a body that stood at T_standing (7,) is part of a robot's hand."""
    own, placed = scene.bodies[body], scene.robots[robot]
    up = rotation_matrix(T_standing)[2]
    attached = AttachedBody(body, own.shapes, inverse(contact.T_obj_ee), contact.opening, own.friction, up, own.mass)
    robots = scene.robots | {robot: replace(placed, model=replace(placed.model, attached=attached))}
    bodies = {name: other for name, other in scene.bodies.items() if name != body}
    removable = {name: T for name, T in scene.removable.items() if name != body}
    return replace(scene, robots=robots, bodies=bodies, removable=removable)


def end_effector_poses(scene: Scene, robot: str, q: np.ndarray) -> np.ndarray:
    """World poses (N, 7) of a robot's end-effector at q (N, n)."""
    placed = scene.robots[robot]
    return multiply_all(placed.base_pose, load_arm(placed.model).end_effectors(q))


def with_attached(scene: Scene, part: SubTrajectory) -> SubTrajectory:
    """A part of a robot with the body that is attached to it: a transit carries that, a contact touches with it."""
    (segment,) = part.segments
    attached = scene.robots[segment.robot].model.attached
    if attached is None:
        return part
    T_ee_attached = attached.T_ee_body
    q = part.trajectory.joints[segment.robot]
    moved = consistent(multiply_all(end_effector_poses(scene, segment.robot, q), T_ee_attached))
    if segment.kind == SegmentKind.TRANSIT:
        pose = inverse(T_ee_attached)
        segment = replace(segment, kind=grasp_kind(scene), object=attached.name, contact_pose=pose)
    else:
        pose = multiply(segment.T_obj_manipulator, T_ee_attached)
        segment = replace(segment, manipulator=attached.name, contact_pose=pose)
    objects = part.trajectory.objects | {attached.name: moved}
    return SubTrajectory(replace(part.trajectory, objects=objects), (segment,))


def attached_at_rest(scene: Scene, part: SubTrajectory) -> tuple[Segment, ...]:
    """The segments in which the robots that do not move in a part keep what is attached to them."""
    (segment,) = part.segments
    return tuple(
        Segment(
            segment.start,
            segment.end,
            name,
            robot.model.end_effector_link,
            robot.model.attached.name,
            grasp_kind(scene),
            inverse(robot.model.attached.T_ee_body),
        )
        for name, robot in scene.robots.items()
        if robot.model.attached is not None and name != segment.robot
    )


def grasp_kind(scene: Scene) -> SegmentKind:
    """The kind of the segments in which a hand carries an attached body."""
    return SegmentKind.TOUCH if scene.mode == TaskMode.KINEMATIC else SegmentKind.GRASP
