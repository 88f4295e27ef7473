"""hmap's side: a motion instance as a skeleton, built and solved as a user would."""

from dataclasses import replace

import numpy as np

from hmap_core.benchmark.instances import Answer, MotionInstance
from hmap_core.collision.convex import ConvexSet, from_hulls, hull_vertices
from hmap_core.komo.ik import solve_ik
from hmap_core.komo.options import IK_OPTIONS
from hmap_core.komo.skeleton import Skeleton, SkeletonEntry, Symbol
from hmap_core.komo.skeleton_problem import SkeletonProblem
from hmap_core.komo.workspace import Workspace
from hmap_core.transforms import apply, inverse, multiply
from hmap_core.types import Body


def prepare(instance: MotionInstance) -> Workspace:
    """Build the workspace, which does not change between two queries in a scene; not timed."""
    state = replace(instance.scene.start_state(), gripper=dict(instance.opening))
    shapes = {}
    if instance.rounding > 0.0:
        shapes = {name: rounded(body, instance.rounding) for name, body in instance.scene.bodies.items()}
    workspace = Workspace(instance.scene, state, shapes=shapes)
    _problem(instance, workspace)  # packs the arms among the fixed bodies once
    return workspace


def rounded(body: Body, radius: float) -> ConvexSet:
    """The boxes of a body with edges rounded by a radius (m): inset corners, swept by a sphere."""
    inset = []
    for shape, (vertices, _) in zip(body.shapes, map(hull_vertices, body.shapes), strict=True):
        corners = apply(inverse(shape.pose), vertices)
        inset.append((apply(shape.pose, corners - radius * np.sign(corners)), radius))
    return from_hulls(inset)


def skeleton(instance: MotionInstance) -> Skeleton:
    """The contacts, modes and targets of an instance."""
    entries = []
    for attachment in instance.attachments:
        hand = attachment.robot, attachment.object
        entries += [
            SkeletonEntry(attachment.first, attachment.first, Symbol.TOUCH, hand, attachment.T_obj_ee),
            SkeletonEntry(attachment.first, -1, Symbol.STABLE, hand),
        ]
        if attachment.support is not None:
            entries.append(SkeletonEntry(attachment.first, -1, Symbol.ABOVE, (attachment.object, attachment.support)))
    for target in instance.targets:
        time = target.phase + 1.0 - target.before / instance.steps_per_phase[target.phase]
        entries += [_target(instance, target, time)]
    return Skeleton([entry for entry in entries if entry is not None])


def _target(instance: MotionInstance, target, time: float) -> SkeletonEntry | None:
    """The entry of a target, for the hand or its attached object; None at the contact, which has its own entry."""
    for attachment in instance.attachments:
        if attachment.robot == target.robot and time == attachment.first:
            return None
        if attachment.robot == target.robot and time > attachment.first:
            goal = multiply(target.T_world_ee, inverse(attachment.T_obj_ee))
            return SkeletonEntry(time, time, Symbol.POSE_EQ, (attachment.object,), goal)
    for robot, body in instance.touching:
        if robot == target.robot and not instance.attachments:
            contact = multiply(inverse(instance.scene.bodies[body].pose), target.T_world_ee)
            return SkeletonEntry(time, time, Symbol.TOUCH, (robot, body), contact)
    return SkeletonEntry(time, time, Symbol.POSE_EQ, (target.robot,), target.T_world_ee)


def _problem(instance: MotionInstance, workspace: Workspace) -> SkeletonProblem:
    options = None if instance.path else IK_OPTIONS
    return SkeletonProblem(skeleton(instance), workspace, instance.steps_per_phase, options)


def solve(instance: MotionInstance, workspace: Workspace) -> Answer:
    """Build the problem from its skeleton and solve it; timed."""
    problem = _problem(instance, workspace)
    if not instance.path:
        return _configuration(instance, problem)
    rng = np.random.default_rng(instance.seed)
    result = problem.solve(workspace.start, restarts=instance.restarts, rng=rng)
    return Answer(result.feasible, np.concatenate([workspace.start[None], result.path]))


def _configuration(instance: MotionInstance, problem: SkeletonProblem) -> Answer:
    """Solve from the start, then from random configurations, until one is found."""
    chain, start = problem.chain, instance.start
    params = np.concatenate([o.feature.params for o in problem.objectives])
    q = solve_ik(problem, params, start[None])
    if q is None:
        rng = np.random.default_rng(instance.seed)
        q = solve_ik(problem, params, rng.uniform(chain.lower, chain.upper, (instance.restarts, len(start))))
    return Answer(q is not None, np.array([start, start if q is None else q]))
