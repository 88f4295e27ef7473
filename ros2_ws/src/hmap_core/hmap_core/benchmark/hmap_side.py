"""hmap's side: a motion instance as a skeleton, built and solved as a user would."""

from dataclasses import replace

import numpy as np

from hmap_core.benchmark.instances import Answer, Attachment, MotionInstance, Target
from hmap_core.collision.convex import ConvexSet, from_hulls, hull_vertices
from hmap_core.komo.ik import solve_ik
from hmap_core.komo.options import IK_OPTIONS
from hmap_core.komo.segment import contact_entries
from hmap_core.komo.skeleton import TO_THE_END, Skeleton, SkeletonEntry, Symbol
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
    problem(instance, workspace)  # packs the arms among the fixed bodies once
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
    for held in instance.attachments:
        contact = held.T_obj_ee if held.contact is None else held.contact
        entries += contact_entries(held.robot, held.object, contact, held.first, TO_THE_END)
        if held.support is not None:
            entries.append(SkeletonEntry(held.first, TO_THE_END, Symbol.ABOVE, (held.object, held.support)))
    left = list(instance.targets)
    for held in instance.attachments:
        for phase in range(held.first, len(instance.steps_per_phase)):
            path = [t for t in left if t.robot == held.robot and t.phase == phase]
            if len(path) == instance.steps_per_phase[phase] > 1:
                entries.append(_prescribed(held, phase, path))
                left = [t for t in left if not (t.robot == held.robot and t.phase == phase)]
    entries += [entry for target in left if (entry := _target(instance, target)) is not None]
    return Skeleton(entries)


def _prescribed(held: Attachment, phase: int, path: list[Target]) -> SkeletonEntry:
    """The path of an attached object that has a target at every step of a phase."""
    poses = np.array([_object_pose(held, target) for target in sorted(path, key=lambda t: -t.before)])
    return SkeletonEntry(phase, phase + 1, Symbol.POSE_EQ, (held.object,), poses)


def _object_pose(held: Attachment, target: Target) -> np.ndarray:
    """World pose (7,) of an attached object at a target of the hand."""
    return multiply(target.T_world_ee, inverse(held.T_obj_ee))


def _target(instance: MotionInstance, target: Target) -> SkeletonEntry | None:
    """The entry of a target, for the hand or its attached object; None at the contact, which has its own entry."""
    time = target.phase + 1.0 - target.before / instance.steps_per_phase[target.phase]
    for held in instance.attachments:
        if held.robot == target.robot and time == held.first:
            return None
        if held.robot == target.robot and time > held.first:
            return SkeletonEntry(time, time, Symbol.POSE_EQ, (held.object,), _object_pose(held, target))
    for robot, body in instance.touching:
        if robot == target.robot and not instance.attachments:
            contact = multiply(inverse(instance.scene.bodies[body].pose), target.T_world_ee)
            return SkeletonEntry(time, time, Symbol.TOUCH, (robot, body), contact)
    return SkeletonEntry(time, time, Symbol.POSE_EQ, (target.robot,), target.T_world_ee)


def problem(instance: MotionInstance, workspace: Workspace) -> SkeletonProblem:
    """The problem of an instance, of the same parts as the planner's."""
    options = None if instance.path else IK_OPTIONS
    return SkeletonProblem(skeleton(instance), workspace, instance.steps_per_phase, options)


def solve(instance: MotionInstance, workspace: Workspace) -> Answer:
    """Build the problem from its skeleton and solve it; timed."""
    asked = problem(instance, workspace)
    if not instance.path:
        return _configuration(instance, asked)
    rng = np.random.default_rng(instance.seed)
    result = asked.solve(workspace.start, restarts=instance.restarts, rng=rng)
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
