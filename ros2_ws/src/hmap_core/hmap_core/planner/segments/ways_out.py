"""Ways out of overlaps: where a robot stands in something by no more than is allowed, or touches it.

A search by trees hardly ever finds them, for most motions overlap more at first. So the hand is moved straight in the
directions of its own axes and of the world's, as out of a grasp; then the joints slide along what they touch.
"""

from collections.abc import Iterator

import numpy as np

from hmap_core.collision.scene_model import PER_PAIR, CollisionModel, Collisions
from hmap_core.komo.allowances import OVERLAP_ALLOWED, relaxed
from hmap_core.komo.features import pose_params_all
from hmap_core.komo.ik import follow_ik
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.path_collisions import path_violations, standing_min_distances
from hmap_core.komo.segment import Phase
from hmap_core.planner.segments.verification import is_free
from hmap_core.transforms import multiply, pose, rotation_matrix

DISTANCES = (0.03, 0.06, 0.12)  # m that the hand is moved
HAND_STEP = 0.004  # m between two configurations of that; in between the hand leaves the line by 0.01 mm
MAX_JUMP = 0.1  # rad a joint may turn between two of them
SLIDES = 24  # ways of the joints that are tried
SLIDE_STEP, SLIDE_STEPS = 0.02, 30  # rad, and how many of them
DIFFERENCE = 1e-5  # rad, for the derivatives of distances
RESOLUTION = 2e-5  # m that a pair may come nearer between two looks
MEASURED = 1.0  # m up to which distances are measured
TOUCHES = 0.0  # m; what stands nearer at an end of a motion is left by a way out


def is_tight(cols: Collisions, at_ends: Collisions) -> bool:
    """Whether pairs (``cols``) touch or overlap at the ends of a motion, whose distances ``at_ends`` has."""
    return bool((at_ends.min_distance < np.minimum(cols.min_distance, TOUCHES)).any())


def way_out(manipulation: Manipulation, cols: Collisions, q: np.ndarray, rng: np.random.Generator) -> np.ndarray | None:
    """Configurations (m, n) from q (n,), the first, to one that keeps all minimum distances.

    What overlaps at q may overlap by OVERLAP_ALLOWED on the way.

    Args:
        manipulation: the robot.
        cols: all pairs, with the minimum distances of a transit.
        q: where it touches something, or overlaps with it.
        rng: the only source of randomness.

    Returns:
        The way; None if none was found.
    """
    chain = manipulation.model.chain
    near = relaxed(chain, cols, q, 1)
    tight = near.min_distance < cols.min_distance
    eased = near._replace(
        min_distance=np.where(tight, np.minimum(near.min_distance, -OVERLAP_ALLOWED), near.min_distance)
    )
    for path in (*_straight(manipulation, q), *_slides(manipulation, cols, eased, tight, q, rng)):
        if _keeps(manipulation, cols, path[-1]) and is_free(chain, eased, path, resolution=RESOLUTION):
            return path
    return None


def _keeps(manipulation: Manipulation, cols: Collisions, q: np.ndarray) -> bool:
    """Whether all pairs keep their minimum distances at q (n,)."""
    return bool(path_violations(q[None], np.ones(1, np.int64), manipulation.model.chain, cols, 0.0)[1][0] < 0)


def _straight(manipulation: Manipulation, q: np.ndarray) -> Iterator[np.ndarray]:
    """Ways (m, n) on which the hand moves straight: back, up, and to all sides."""
    T = multiply(manipulation.scene.robots[manipulation.robot].base_pose, manipulation.arm.end_effector(q))
    own, world = rotation_matrix(T).T, np.eye(3)
    directions = [-own[2], world[2]]
    directions += [sign * axis for axis in (*own[:2], *world[:2]) for sign in (1.0, -1.0)] + [-world[2], own[2]]
    problem = manipulation.ik_problem(CollisionModel(), Phase.TRANSIT)
    for distance in DISTANCES:
        steps = int(np.ceil(distance / HAND_STEP))
        for direction in directions:
            poses = np.array([multiply(pose(distance * k / steps * direction), T) for k in range(1, steps + 1)])
            path = follow_ik(problem, pose_params_all(manipulation.T_tip_ee, poses), q, MAX_JUMP)
            if len(path) == steps:
                yield np.concatenate([q[None], path])


def _slides(
    manipulation: Manipulation,
    cols: Collisions,
    eased: Collisions,
    tight: np.ndarray,
    q: np.ndarray,
    rng: np.random.Generator,
) -> Iterator[np.ndarray]:
    """Ways (m, n) of the joints in random directions, turned so that the tight pairs (P,) come no nearer."""
    chain = manipulation.model.chain
    own = cols._replace(**{name: getattr(cols, name)[tight] for name in PER_PAIR})
    own = own._replace(min_distance=np.full_like(own.min_distance, MEASURED))
    for _ in range(SLIDES):
        path, way = [q], rng.standard_normal(len(q))
        for _ in range(SLIDE_STEPS):
            slopes = _slopes(manipulation, own, path[-1])
            nearer = slopes @ way < 0.0
            step = way - np.linalg.pinv(slopes[nearer]) @ (slopes[nearer] @ way) if nearer.any() else way
            size = np.abs(step).max()
            if size < DIFFERENCE:
                break
            path.append(np.clip(path[-1] + SLIDE_STEP / size * step, chain.lower, chain.upper))
            if not _keeps(manipulation, eased, path[-1]):
                break
            if _keeps(manipulation, cols, path[-1]):
                yield np.array(path)
                break


def _slopes(manipulation: Manipulation, cols: Collisions, q: np.ndarray) -> np.ndarray:
    """Derivatives (P, n) of the distances of all pairs by the joints."""
    chain = manipulation.model.chain
    here = standing_min_distances(q, np.int64(1), chain, cols, 0.0)
    moved = [standing_min_distances(q + e, np.int64(1), chain, cols, 0.0) for e in DIFFERENCE * np.eye(len(q))]
    return (np.array(moved) - here).T / DIFFERENCE
