"""A plan that is blocked ahead: how far it may still be followed, and how a hand lets go where it has to stop."""

from collections.abc import Mapping, Sequence

import numpy as np

from hmap_core import transforms
from hmap_core.contacts.feasibility import drawn_back_path, ik_problem
from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.segment import GRASP_RETREAT, Phase, free_opening
from hmap_core.planner.conflicts import Conflict
from hmap_core.planner.planned_contacts import PlannedContact, contact_of, planned_contacts
from hmap_core.planner.segments import FREE_ACCELERATION, FREE_SPEED, HOLD_ACCELERATION, HOLD_SPEED, timed_together
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.trajectory.samples import index_at, state_at
from hmap_core.types import JointTrajectory, Plan, Scene, SceneState
from hmap_core.waypoints import stable_poses

AT_THE_RETREAT = 0.002  # m short of where the hand draws back to
THERE = 1e-4  # rad; a joint that has less to go is there
CORNER = 0.02  # rad between points of a way back
CAUTION = 0.3  # s of the plan before a conflict at which everything has to stand


def contacts(plan: Plan) -> list[PlannedContact]:
    """Every contact of a plan in order."""
    handled = dict.fromkeys(segment.object for segment in plan.segments if segment.object is not None)
    return sorted((kept for name in handled for kept in planned_contacts(plan, name)), key=lambda kept: kept.begin)


def good_until(plan: Plan, now: float, conflict: Conflict) -> float | None:
    """Planned time (s) up to which a plan is still followed that meets a conflict ahead; None: it has to stop at once.

    It is good up to the last place before the conflict at which a hand has just drawn back from a contact, so that a
    contact that has been made is left in good order.

    Args:
        now: planned time (s) at which it is being followed.
    """
    ends = [float(plan.trajectory.time[kept.last]) for kept in contacts(plan)]
    return max((end for end in ends if now < end <= conflict.time - CAUTION), default=None)


def contact_at(plan: Plan, at: float) -> PlannedContact | None:
    """The contact that a planned time (s) belongs to, the ways there and back included."""
    k = index_at(plan.trajectory.time, at)
    return next((kept for kept in contacts(plan) if kept.first <= k <= kept.last), None)


def grasps_at(plan: Plan, at: float, robots: Sequence[str], body: str) -> list[PlannedContact]:
    """The contacts of some robots with a body that a planned time (s) lies in, the ways there and back excluded."""
    k = index_at(plan.trajectory.time, at)
    own = [one for one in contacts(plan) if one.segment.object == body and one.begin <= k <= one.end]
    return [next(one for one in own if one.segment.robot == name) for name in robots]


def clear_sample(plan: Plan, contact: PlannedContact, at: float) -> int:
    """The last sample, at the planned time ``at`` (s) or before it, at which the hand is not yet round the object."""
    arm = load_arm(plan.scene.robots[contact.segment.robot].model)
    q = plan.trajectory.joints[contact.segment.robot]
    rows = np.arange(contact.first, index_at(plan.trajectory.time, at) + 1)
    tips = arm.end_effectors(q[rows])[:, :3]
    away = np.linalg.norm(tips - arm.end_effector(q[contact.begin])[:3], axis=1)
    far = np.flatnonzero(away >= GRASP_RETREAT - AT_THE_RETREAT)
    return int(rows[far[-1]]) if len(far) else contact.first


def stable_sample(plan: Plan, contact: PlannedContact, at: float) -> int:
    """The nearest sample, at the planned time ``at`` (s) or before it in the contact, at which the object stands."""
    rows = np.arange(contact.begin, index_at(plan.trajectory.time, at) + 1)
    name = contact.segment.contact_object
    poses = plan.trajectory.objects[name][rows]
    others = placed_bodies(plan.scene, state_at(plan, int(rows[-1])), name)
    stands = np.flatnonzero(stable_poses(plan.scene.bodies[name], poses, others))
    return int(rows[stands[-1]]) if len(stands) else contact.begin


def back_to(
    plan: Plan, robots: Sequence[str], sample: int, q: Mapping[str, np.ndarray], at: float
) -> dict[str, JointTrajectory]:
    """The way of robots from their configurations at the planned time ``at`` back to a sample, as they came.

    What they hold comes along, so they move as slowly as with an object, and together. Empty where they are there.

    Args:
        plan: that was followed.
        robots: names.
        sample: of the plan.
        q: robot -> where (n,) it is.
        at: planned time, s.
    """
    until = index_at(plan.trajectory.time, at)
    rows = np.hstack([plan.trajectory.joints[name][sample : until + 1] for name in robots])[::-1]
    start = np.concatenate([q[name] for name in robots])
    if np.abs(rows[-1] - start).max() < THERE:
        return {}
    moved = np.cumsum(np.abs(np.diff(rows, axis=0)).max(axis=1, initial=0.0), axis=0)
    corners = np.flatnonzero(np.diff(np.floor(moved / CORNER)) > 0.0) + 1
    path = np.concatenate([start[None], rows[corners], rows[-1:]])
    return _timed(plan.scene, robots, path, HOLD_SPEED, HOLD_ACCELERATION)


def release(
    scene: Scene, state: SceneState, plan: Plan, contact: PlannedContact
) -> tuple[float, JointTrajectory | None]:
    """How a hand lets go of what it holds, where it is: the opening (m), then the way straight back.

    It goes back as far as it can without touching something; None where that is nowhere. With its fingers open it is
    free of the object there, too.

    Args:
        scene: with every body that is known now.
        state: where everything stands.
        plan: that the contact is of.
    """
    robot, name = contact.segment.robot, contact.segment.object
    point = contact_of(plan, contact)
    manipulation = Manipulation(scene, state, robot, name)
    T_obj = held_pose(scene, state, contact)
    problem = ik_problem(manipulation, manipulation.collisions(point, T_obj, T_obj), Phase.RETREAT)
    path = drawn_back_path(manipulation, problem, point, T_obj, state.q[robot])
    opening = free_opening(scene.robots[robot], point)
    if not len(path):
        return opening, None
    path = np.concatenate([state.q[robot][None], path])
    return opening, _timed(scene, (robot,), path, FREE_SPEED, FREE_ACCELERATION)[robot]


def held_pose(scene: Scene, state: SceneState, contact: PlannedContact) -> np.ndarray:
    """T_world_obj (7,) of an object that is where the hand of the contact has it."""
    robot = scene.robots[contact.segment.robot]
    T_world_ee = transforms.multiply(robot.base_pose, load_arm(robot.model).end_effector(state.q[robot.name]))
    return transforms.multiply(T_world_ee, transforms.inverse(contact.segment.T_obj_manipulator))


def _timed(
    scene: Scene, robots: Sequence[str], path: np.ndarray, speed: float, acceleration: float
) -> dict[str, JointTrajectory]:
    """The motions of robots along a path (M, n) of all their joints, as slow as the slowest of them."""
    timed = timed_together(scene, robots, path, speed, acceleration)
    return {
        name: JointTrajectory(scene.robots[name].model.joint_names, own.time, own.q, own.qd)
        for name, own in timed.items()
    }
