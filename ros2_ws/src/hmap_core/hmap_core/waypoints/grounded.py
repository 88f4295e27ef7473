"""A path through the air whose head is put down on the support: slide first, lift later.

A body that no hand can grip where it stands may be pushed to where one can. Below the path that was found for it, it
slides as far as it is free there, then rises to the path.
"""

from dataclasses import replace

import numpy as np

from hmap_core.transforms import consistent
from hmap_core.waypoints.checker import Geometry, ObjectChecker, flattened
from hmap_core.waypoints.problem import ObjectPathProblem
from hmap_core.waypoints.resample import resample

LEAST_SLIDE = 0.02  # m that have to be gained
LEAST_RISE = 1e-3  # m of height that a path through the air takes


def slid_first(problem: ObjectPathProblem, poses: np.ndarray) -> np.ndarray | None:
    """Poses (K, 7) that slide below the free path ``poses`` (M, 7) as far as they can and rise to it from there.

    None where the path does not rise, or the body does not stand at the start, cannot slide for LEAST_SLIDE, or cannot
    rise from there.
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
        below = flattened(sliding, T)
        if not ground.motion_free(slid[-1], below):
            break
        slid.append(below)
    air = ObjectChecker(problem, geometry, False, problem.min_distance)
    for last in range(len(slid) - 1, 0, -1):
        if np.linalg.norm(slid[last][:3] - slid[0][:3]) < LEAST_SLIDE:
            return None
        if air.motion_free(slid[last], poses[last]):
            rise, _ = resample(np.array([slid[last], poses[last]]))
            return consistent(np.concatenate([slid[:last], rise, poses[last + 1 :]]))
    return None
