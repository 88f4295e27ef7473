"""Straight up from a support and down to it, with what is attached to the hand."""

import numpy as np

from hmap_core.collision.scene_model import CollisionModel
from hmap_core.contacts.feasibility import MAX_JUMP, ik_problem
from hmap_core.komo.allowances import relaxed, verification
from hmap_core.komo.features import pose_params_all
from hmap_core.komo.ik import follow_ik
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.segment import Phase
from hmap_core.planner.interfaces import SubTrajectory
from hmap_core.planner.segments.parts import at_rest
from hmap_core.planner.segments.timing import timed_transit
from hmap_core.planner.segments.verification import is_free
from hmap_core.transforms import multiply, pose
from hmap_core.types import Scene, SceneState

LIFTS = (0.06, 0.03, 0.015)  # m that what was picked is lifted by, where there is room
LIFT_STEP = 0.01  # m between two configurations of that


def lift_path(scene: Scene, state: SceneState, robot: str, q: np.ndarray) -> np.ndarray:
    """Configurations (m, n) straight up from q (n,), what is attached standing there, as far as there is room; q
    first."""
    manipulation = Manipulation(scene, state, robot, None)
    chain = manipulation.model.chain
    cols = verification(relaxed(chain, manipulation.standing_collisions().arrays(), q, 1))
    T = multiply(scene.robots[robot].base_pose, manipulation.arm.end_effector(q))
    free = ik_problem(manipulation, CollisionModel(), Phase.TRANSIT)
    for height in LIFTS:
        steps = int(np.ceil(height / LIFT_STEP))
        ups = [pose((0.0, 0.0, height * k / steps)) for k in range(1, steps + 1)]
        targets = pose_params_all(manipulation.T_tip_ee, np.array([multiply(up, T) for up in ups]))
        path = follow_ik(free, targets, q, MAX_JUMP)
        if len(path) == steps:
            path = np.concatenate([q[None], path])
            if is_free(chain, cols, path):
                return path
    return q[None]


def vertical(scene: Scene, state: SceneState, robot: str, path: np.ndarray, down: bool = False) -> SubTrajectory:
    """The motion up along such a path (m, n), or down along it; one sample where there is no room to lift."""
    samples = timed_transit(scene, robot, path) if len(path) > 1 else path
    return at_rest(scene, robot, samples[::-1] if down else samples, state.gripper[robot])
