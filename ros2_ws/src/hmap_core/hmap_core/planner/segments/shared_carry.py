"""Two robots carry one object by two grasps: a closed chain, planned over the joints of both arms."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from hmap_core.exceptions import MotionError
from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.allowances import relaxed, verification
from hmap_core.komo.clearances import VERIFIED_ONLY
from hmap_core.komo.segment import shared_skeleton
from hmap_core.komo.skeleton_problem import SkeletonProblem
from hmap_core.komo.workspace import Workspace
from hmap_core.planner.interfaces import RobotContact, SubTrajectory
from hmap_core.planner.segments.attached import end_effector_poses
from hmap_core.planner.segments.carried import grasped
from hmap_core.planner.segments.motion_sequence import MotionSequence, held_still
from hmap_core.planner.segments.motions import FINENESS, come, leave
from hmap_core.planner.segments.object_steps import thinned
from hmap_core.planner.segments.timing import HOLD_ACCELERATION, HOLD_SPEED, timed_together
from hmap_core.planner.segments.transits import path_options
from hmap_core.planner.segments.verification import Masks, executed_spline, worst_between_steps
from hmap_core.planner.transit import find_transit
from hmap_core.planner.transit_search import FindTransit
from hmap_core.transforms import consistent, distance, inverse, multiply, multiply_all
from hmap_core.types import Scene, SceneState, Segment, SegmentKind, Trajectory

TORN = (5e-4, float(np.deg2rad(0.25)))  # m, rad by which a hand may move against the other; the judge allows twice that
CARRYING = 1 | VERIFIED_ONLY  # phases of the closed chain, for verification


Planned = TypeVar("Planned")


def carry_together(
    scene: Scene,
    state: SceneState,
    object: str,
    contacts: Sequence[RobotContact],
    object_poses: np.ndarray,
    rng: np.random.Generator,
    time_limit: float,
    find: FindTransit = find_transit,
) -> SubTrajectory:
    """Plan the motion in which robots grasp an object one after the other, carry it together, and let it go.

    Args:
        scene, state: the world, and where everything is.
        object: name of the object.
        contacts: of each robot, with its configurations at all of the poses.
        object_poses: (K, 7) path of the object.
        rng: the only source of randomness.
        time_limit: s.
        find: searches a transit where the optimiser finds none.

    Raises:
        MotionError: NO_MOTION.
    """
    deadline = time.monotonic() + time_limit

    def both_come(order: Sequence[RobotContact]) -> tuple[MotionSequence, list[RobotContact]]:
        motions, made = MotionSequence(state), list[RobotContact]()
        away = [name for contact in contacts for name in contact.clear if name != order[0].robot]
        for contact in order:
            contact = replace(contact, clear=() if made else tuple(away))
            coming = come(scene, motions.state, contact, object, rng, deadline - time.monotonic(), find)
            motions.add(_held(scene, coming, object, made))
            made.append(_as_grasped(scene, motions.state, object, contact))
        return motions, made

    motions, made = _first_order(contacts, both_come)
    motions.add(_closed_chain(scene, motions.state, object, made, object_poses))

    def both_leave(order: Sequence[RobotContact]) -> list[SubTrajectory]:
        last, found = MotionSequence(motions.state), []
        for k, contact in enumerate(order):
            released = replace(contact, keyframes=last.state.q[contact.robot][None], reach=0)
            found.append(_held(scene, leave(scene, last.state, released, object), object, order[k + 1 :]))
            last.add(found[-1])
        return found

    for leaving in _first_order(made, both_leave):
        motions.add(leaving)
    return motions.joined()


def _first_order(contacts: Sequence[RobotContact], plan: Callable[[Sequence[RobotContact]], Planned]) -> Planned:
    """What can be planned for the contacts in the first order that works.

    Raises:
        MotionError: no order works.
    """
    failure = MotionError("no order was tried")
    for order in (contacts, contacts[::-1]):
        try:
            return plan(order)
        except MotionError as error:
            failure = error
    raise failure


def _held(scene: Scene, motion: SubTrajectory, object: str, holders: Sequence[RobotContact]) -> SubTrajectory:
    for holder in holders:
        motion = held_still(scene, motion, object, holder)
    return motion


def _as_grasped(scene: Scene, state: SceneState, object: str, contact: RobotContact) -> RobotContact:
    """The contact exactly as the robot has it in a state."""
    placed = scene.robots[contact.robot]
    T_ee = multiply(placed.base_pose, load_arm(placed.model).end_effector(state.q[contact.robot]))
    own = replace(contact.contact, T_obj_ee=multiply(inverse(state.poses[object]), T_ee))
    return replace(contact, contact=own)


def _closed_chain(
    scene: Scene, state: SceneState, object: str, contacts: Sequence[RobotContact], object_poses: np.ndarray
) -> SubTrajectory:
    """The motion of the closed chain, with finer steps where coarse ones tear the grasps or hit something."""
    failure = MotionError("no fineness was tried")
    for fineness in FINENESS:
        try:
            path = _solved(scene, state, object, contacts, object_poses, fineness)
            return _timed(scene, state, object, contacts, path)
        except MotionError as error:
            failure = error
    raise failure


def _solved(
    scene: Scene,
    state: SceneState,
    object: str,
    contacts: Sequence[RobotContact],
    object_poses: np.ndarray,
    fineness: float,
) -> np.ndarray:
    """The verified path (M, n) of the joints of all robots, from where they are."""
    robots = [contact.robot for contact in contacts]
    poses, keyframes = thinned(object_poses, np.hstack([contact.keyframes for contact in contacts]), fineness)
    workspace = Workspace(scene, state, robots)
    skeleton = shared_skeleton(robots, object, [contact.contact for contact in contacts], poses[1:])
    steps = len(poses) - 1
    problem = SkeletonProblem(skeleton, workspace, (steps,), path_options(steps))
    chain, start = problem.chain, workspace.start
    cols = relaxed(chain, relaxed(chain, problem.arrays(), start, 1), keyframes[-1], 1)
    result = problem.keeping(cols).solve(start, keyframes[1:])
    who = " and ".join(f"'{name}'" for name in robots)
    if not result.feasible:
        raise MotionError(f"{who} find no motion in which they carry '{object}' together: {result.worst}")
    path = np.concatenate([start[None], result.path])
    amount, pair = worst_between_steps(chain, verification(cols), executed_spline(chain, path), Masks(CARRYING))
    if pair >= 0:
        names = " and ".join(problem.collisions.pair_name(pair))
        raise MotionError(f"{who} cannot carry '{object}' together: {names} are {amount * 1e3:.1f} mm too close")
    return path


def _timed(
    scene: Scene, state: SceneState, object: str, contacts: Sequence[RobotContact], path: np.ndarray
) -> SubTrajectory:
    """The trajectory along a path (M, n) of all joints, as slow as the slowest arm needs.

    Raises:
        MotionError: the hands would tear the object apart.
    """
    models = [scene.robots[contact.robot].model for contact in contacts]
    leader, joints_of_leader = contacts[0], len(models[0].joint_names)
    T_ee_obj, opening = inverse(leader.contact.T_obj_ee), leader.contact.opening
    alone = grasped(scene, leader.robot, scene.bodies[object], T_ee_obj, opening)
    carried = replace(alone, position=lambda q: alone.position(q[:, :joints_of_leader]))
    robots = [contact.robot for contact in contacts]
    timed = timed_together(scene, robots, path, HOLD_SPEED, HOLD_ACCELERATION, carried)
    joints = {name: own.q for name, own in timed.items()}
    hands = {name: end_effector_poses(scene, name, own) for name, own in joints.items()}
    first, *others = hands.values()
    for name, own in zip(list(hands)[1:], others, strict=True):
        relative = [multiply(inverse(a), b) for a, b in zip(first, own, strict=True)]
        off = np.array([distance(T, relative[0]) for T in relative]).max(axis=0)
        if (off > TORN).any():
            amount = f"{off[0] * 1e3:.2f} mm and {np.rad2deg(off[1]):.2f} deg"
            raise MotionError(f"the hand of '{name}' would move by {amount} on '{object}' against the other one")
    poses = _mean([multiply_all(hands[own.robot], inverse(own.contact.T_obj_ee)) for own in contacts])
    times = timed[leader.robot].time
    openings = {contact.robot: np.full(len(times), state.gripper[contact.robot]) for contact in contacts}
    segments = tuple(
        Segment(
            0.0,
            float(times[-1]),
            contact.robot,
            model.end_effector_link,
            object,
            SegmentKind.GRASP,
            contact.contact.T_obj_ee,
        )
        for contact, model in zip(contacts, models, strict=True)
    )
    return SubTrajectory(Trajectory(times, joints, openings, {object: poses}), segments)


def _mean(poses: Sequence[np.ndarray]) -> np.ndarray:
    """Mean (N, 7) of several pose sequences (N, 7) that are close to each other."""
    first = consistent(poses[0])
    signs = [np.sign(np.einsum("ni,ni->n", first[:, 3:], other[:, 3:]))[:, None] for other in poses]
    total = sum(np.hstack([other[:, :3], sign * other[:, 3:]]) for other, sign in zip(poses, signs, strict=True))
    mean = np.asarray(total) / len(poses)
    mean[:, 3:] /= np.linalg.norm(mean[:, 3:], axis=1, keepdims=True)
    return mean
