"""A tool that is attached in the middle of a plan: its tool grasp, and a plan that places it where it was picked."""

import numpy as np

from hmap_core import transforms
from hmap_core.kinematics.arm import load_arm
from hmap_core.planner.assembly import assemble, scene_at
from hmap_core.planner.interfaces import RobotContact, ToolGrasp
from hmap_core.planner.segments import place
from hmap_core.trajectory.samples import index_at
from hmap_core.types import ContactKind, ContactPoint, Plan, Scene, SceneState, Segment

APPROACHED = 0.02  # m of the way to a grip that tell its direction


def tools_used(plan: Plan) -> set[str]:
    """The bodies with which a plan moves others."""
    return {segment.manipulator for segment in plan.segments} & plan.scene.bodies.keys()


def grip_at(plan: Plan, robot: str, tool: str, sample: int, before: ToolGrasp | None = None) -> ToolGrasp | None:
    """The grasp with which a tool is attached to a robot at a sample of a plan; None where it is not.

    Args:
        plan: with the segments that pick, use and place the tool.
        robot, tool: names.
        sample: of the plan.
        before: the grasp with which the plan begins, if it does.
    """
    first = None
    for segment in reversed([s for s in plan.segments if s.robot == robot]):
        if index_at(plan.trajectory.time, segment.start) > sample:
            continue
        if not _holds(segment, tool):
            break
        first = segment
    if first is None:
        return None
    begin = index_at(plan.trajectory.time, first.start)
    if begin == 0 and before is not None and before.tool == tool:
        return before
    return _grip(plan, robot, tool, begin)


def plan_place(scene: Scene, state: SceneState, grip: ToolGrasp, seed: int, time_limit: float) -> Plan:
    """Plan how an attached tool is placed where it was picked, from the present state.

    Raises:
        MotionError: NO_MOTION.
    """
    rng = np.random.default_rng(seed)
    motion = place(scene, state, grip.contact, grip.tool, grip.T_place, rng, time_limit)
    return assemble(scene_at(scene, state), state, [motion], np.zeros((0, 7)), {})


def _holds(segment: Segment, tool: str) -> bool:
    return tool in (segment.object, segment.manipulator)


def _grip(plan: Plan, robot: str, tool: str, sample: int) -> ToolGrasp:
    """The hold that begins at a sample; a hand leaves it in the direction from which it came."""
    q, placed = plan.trajectory.joints[robot], plan.scene.robots[robot]
    T_place = plan.trajectory.objects[tool][sample]
    tips = transforms.multiply_all(placed.base_pose, load_arm(placed.model).end_effectors(q[: sample + 1]))
    T_obj_ee = transforms.multiply(transforms.inverse(T_place), tips[-1])
    way = tips[-1, :3] - tips[:, :3]
    far = np.flatnonzero(np.linalg.norm(way, axis=1) >= APPROACHED)
    approach = np.array([0.0, 0.0, 1.0])
    if len(far):
        approach = transforms.rotation_matrix(tips[-1]).T @ (way[far[-1]] / np.linalg.norm(way[far[-1]]))
    contact = ContactPoint(
        kind=ContactKind.GRASP,
        T_obj_ee=T_obj_ee,
        point=T_obj_ee[:3],
        normal=-transforms.rotation_matrix(T_obj_ee) @ approach,
        opening=float(plan.trajectory.gripper[robot][sample]),
        approach=approach,
    )
    return ToolGrasp(tool, RobotContact(robot, contact, 0, q[sample][None]), T_place)
