"""The feasibility half of Algorithm 3: which contacts a robot can reach, and how far they can carry the object.

Eq. (3) of the paper as a batch: for every candidate the contact pose and the pre-contact pose have to be reachable without
collision. For those that are, the robot is led along the object's path in small steps, which says how far the contact
serves: the waypoints are cut where contacts end, not at fixed distances.
"""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from hmap_core.komo.features import relative_pose
from hmap_core.komo.manipulation import Manipulation, Phase, free_opening, retreated
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.transcription import IK_OPTIONS, KomoProblem, follow_ik, solve_ik_batch
from hmap_core.transforms import IDENTITY, multiply
from hmap_core.types import ContactPoint

RESTARTS = 2  # random configurations tried after the home posture
MAX_JUMP = 0.5  # rad a joint may turn between two neighbouring poses of the object's path
RETREAT_STEP = 2  # poses by which the reach is shortened until the hand can leave
OPENING_RESOLUTION = 0.001  # m: contacts whose fingers open alike to this are checked together


def ik_problem(manipulation: Manipulation, collisions, phase: Phase) -> KomoProblem:
    """The one-step problem of bringing the end-effector to a pose in a phase."""
    problem = KomoProblem(manipulation.model.chain, (0,) * int(phase) + (1,), collisions, IK_OPTIONS)
    problem.add(Objective(relative_pose(manipulation.tip, IDENTITY, IDENTITY), ObjectiveType.EQ, [0]))
    return problem


def reachable(
    manipulation: Manipulation, contacts: Sequence[ContactPoint], T_world_obj: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which contacts can be taken with the object at T_world_obj (7,).

    Returns:
        (ok (K,), q (K, n) in contact, q_pre (K, n) at the pre-contact pose).
    """
    n = manipulation.model.n
    robot = manipulation.scene.robots[manipulation.robot]
    ok = np.zeros(len(contacts), bool)
    q, q_pre = np.zeros((len(contacts), n)), np.zeros((len(contacts), n))
    groups: dict[tuple, list[int]] = defaultdict(list)
    for k, contact in enumerate(contacts):
        groups[contact.kind, round(contact.opening / OPENING_RESOLUTION)].append(k)
    chain = manipulation.model.chain
    starts = [robot.model.home, *rng.uniform(chain.lower, chain.upper, (RESTARTS, n))]
    for members in groups.values():
        index = np.array(members)
        widest = max((contacts[k] for k in members), key=lambda c: free_opening(robot, c))
        problem = ik_problem(manipulation, manipulation.collisions(widest, T_world_obj), Phase.APPROACH)
        goal = np.array([manipulation.target(multiply(T_world_obj, contacts[k].T_obj_ee)) for k in members])
        before = np.array([manipulation.target(multiply(T_world_obj, retreated(contacts[k]))) for k in members])
        todo = np.arange(len(members))
        for start in starts:
            initial = np.tile(start, (len(todo), 1))
            found, feasible = solve_ik_batch(problem, goal[todo], initial, initial)
            chosen = todo[feasible]
            back, clear = solve_ik_batch(problem, before[chosen], found[feasible], found[feasible])
            clear &= np.abs(back - found[feasible]).max(1, initial=0.0) < 2 * MAX_JUMP
            done = chosen[clear]
            ok[index[done]], q[index[done]], q_pre[index[done]] = True, found[feasible][clear], back[clear]
            todo = np.setdiff1d(todo, done)
            if not len(todo):
                break
    return ok, q, q_pre


def carried(
    manipulation: Manipulation, contact: ContactPoint, q: np.ndarray, object_poses: np.ndarray
) -> np.ndarray:
    """Postures (m, n) of the robot that carries the object along object_poses (M, 7), as far as it can and can then leave.

    Args:
        q: (n,) posture in contact at the first pose.
    """
    holding = ik_problem(
        manipulation, manipulation.collisions(contact, object_poses[0], object_poses[-1]), Phase.HOLD
    )
    targets = np.array([manipulation.target(multiply(T, contact.T_obj_ee)) for T in object_poses])
    path = follow_ik(holding, targets, q, MAX_JUMP)
    for reach in range(len(path) - 1, 0, -RETREAT_STEP):
        T_end = object_poses[reach]
        leaving = ik_problem(manipulation, manipulation.collisions(contact, object_poses[0], T_end), Phase.RETREAT)
        target = manipulation.target(multiply(T_end, retreated(contact)))
        _, clear = solve_ik_batch(leaving, target[None], path[reach][None], path[reach][None])
        if clear[0]:
            return path[: reach + 1]
    return path[:0]
