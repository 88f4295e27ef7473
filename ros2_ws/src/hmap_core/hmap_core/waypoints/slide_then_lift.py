"""A spatial path whose first part is projected onto the support: the body slides first and is lifted later.

If no gripper can grasp a body where it stands, a push can move it to a place where one can. The body slides below the
given path as far as that is free, and then rises to the path.
"""

from dataclasses import replace

import numpy as np

from hmap_core.transforms import consistent
from hmap_core.waypoints.checker import Geometry, ObjectChecker, planar_projection
from hmap_core.waypoints.problem import ObjectPathProblem
from hmap_core.waypoints.resample import resample

LEAST_SLIDE = 0.02  # m, shortest slide
SAME = 1e-9  # m, or part of a quaternion, by which poses differ at most that are the same
LEAST_RISE = 1e-3  # m, smallest height difference of a path that is lifted


def slide_then_lift(problem: ObjectPathProblem, poses: np.ndarray) -> np.ndarray | None:
    """Replace the first part of a lifted path by a slide on the support.

    Args:
        problem: the body and its obstacles.
        poses: (M, 7) T_world_obj of a free path.

    Returns:
        Poses (K, 7) that slide below ``poses`` as far as possible and then rise to them. None if the path does not
        rise, or if the body does not stand at the start, cannot slide for LEAST_SLIDE, or cannot rise from there.
    """
    if np.ptp(poses[:, 2]) < LEAST_RISE:
        return None
    sliding = replace(problem, goal=problem.start, motion="planar", removable=frozenset())
    geometry = Geometry(sliding)
    ground = ObjectChecker(sliding, geometry, True, problem.min_distance)
    if ground.support is None:
        return None
    slid = [np.asarray(poses[0], float)]
    for T in poses[1:]:
        below = planar_projection(sliding, T)
        if not ground.motion_free(slid[-1], below):
            break
        slid.append(below)
    lift = ObjectChecker(problem, geometry, False, problem.min_distance)
    for last in range(len(slid) - 1, 0, -1):
        if np.linalg.norm(slid[last][:3] - slid[0][:3]) < LEAST_SLIDE:
            return None
        if lift.motion_free(slid[last], poses[last]):
            rise, _ = resample(np.array([slid[last], poses[last]]))
            found = np.concatenate([slid[:last], rise, poses[last + 1 :]])
            moves = np.linalg.norm(np.diff(found, axis=0), axis=1) > SAME  # none where the path goes straight up
            return consistent(found[np.append(True, moves)])
    return None
