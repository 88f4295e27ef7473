"""The feasibility check of contacts in this process (eq. 3 of the paper, for many contacts at once)."""

from collections.abc import Sequence

import numpy as np

from hmap_core.contacts.feasibility import feasible_contacts, promising
from hmap_core.contacts.grasp_torque import weight_torque_ratio
from hmap_core.contacts.grip_force import lifting_problem, sliding_problem, weight_ratio
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.shapes import body_set
from hmap_core.planner.interfaces import RobotContact
from hmap_core.planner.protocols import ContactQuery
from hmap_core.planner.sampled_contacts import TURNING_SHARE
from hmap_core.planner.surroundings import away_from_home, placed_bodies
from hmap_core.transforms import rotation_matrix
from hmap_core.types import Body, ContactKind, ContactPoint, Scene, SceneState, TaskMode
from hmap_core.waypoints import stable_poses

ENOUGH = 2  # feasible contacts per robot after which only better ones are searched
MIN_REACH = 2  # poses a contact has to serve, unless the path is shorter
LIFTED = 0.001  # m that a path has to rise or sink for the object to be lifted


class LocalContactChecker:
    """Implements :class:`hmap_core.planner.protocols.ContactChecker`.

    The other robots are assumed at home. Those that are not have to go there first (``RobotContact.clear``).

    Args:
        enough: feasible contacts per robot after which only better ones are searched.
    """

    def __init__(self, enough: int = ENOUGH):
        self.enough = enough
        # the last answer of `_standing`: all robots have the same question
        self._stands: tuple[tuple, np.ndarray] = ((), np.zeros(0, bool))

    def check(self, query: ContactQuery, contacts: Sequence[ContactPoint], beyond: int = -1) -> list[RobotContact]:
        """Return the feasible contacts with how far they serve, in the order in which they were found."""
        contacts = self._lifting(query, contacts)
        if not contacts:
            return []
        manipulation, away = cleared(query.scene, query.state, query.object, query.robot)
        poses, release = query.object_poses, self.release(query.scene, query.state, query.object, query.object_poses)
        least = max(least_reach(poses), beyond + 1)
        return [
            RobotContact(query.robot, contacts[f.index], len(f.keyframes) - 1, f.keyframes, away)
            for f in feasible_contacts(
                manipulation, contacts, poses, release, query.rng, least, self.enough, query.deadline
            )
        ]

    def promising(self, query: ContactQuery, contacts: Sequence[ContactPoint], beyond: int = -1) -> list[ContactPoint]:
        """Return the contacts for which :meth:`check` would solve inverse kinematics, in that order."""
        contacts = self._lifting(query, contacts)
        if not contacts:
            return []
        manipulation, _ = cleared(query.scene, query.state, query.object, query.robot)
        poses, release = query.object_poses, self.release(query.scene, query.state, query.object, query.object_poses)
        order, _ = promising(manipulation, contacts, poses, release, max(least_reach(poses), beyond + 1))
        return [contacts[k] for k in order]

    def release(self, scene: Scene, state: SceneState, object: str, object_poses: np.ndarray) -> np.ndarray:
        """At which of its poses (M, 7) an object stands by itself, so that it may be released there: (M,) of bool."""
        return self._standing(scene.bodies[object], object_poses, placed_bodies(scene, state, object))

    def _lifting(self, query: ContactQuery, contacts: Sequence[ContactPoint]) -> list[ContactPoint]:
        """The contacts that can carry the object's weight, if it is lifted along its poses, or slide it otherwise."""
        poses = query.object_poses
        if not contacts:
            return []
        if not is_lifted(poses):
            robot = query.scene.robots[query.robot]
            kinematic = query.scene.mode == TaskMode.KINEMATIC
            stays = not kinematic and sliding_problem(query.scene.bodies[query.object], query.robot, robot.model)
            return [] if stays else list(contacts)
        return secure_grasps(query.scene, query.object, query.robot, contacts, poses[0])

    def _standing(self, body: Body, poses: np.ndarray, obstacles: Sequence[Body]) -> np.ndarray:
        key = id(body_set(body)), poses.tobytes(), *((id(body_set(b)), b.pose.tobytes()) for b in obstacles)
        if key != self._stands[0]:
            self._stands = key, stable_poses(body, poses, obstacles)
        return self._stands[1]


def is_lifted(object_poses: np.ndarray) -> bool:
    """Whether an object leaves its support along its poses (M, 7)."""
    return bool(np.ptp(object_poses[:, 2]) > LIFTED)


def least_reach(object_poses: np.ndarray) -> int:
    """Index of the pose, of object_poses (M, 7), that a contact has to reach at least."""
    return min(MIN_REACH, len(object_poses) - 1)


def cleared(scene: Scene, state: SceneState, object: str, robot: str) -> tuple[Manipulation, tuple[str, ...]]:
    """A robot about to handle an object with all others at home, and those that have to go there first."""
    away = away_from_home(scene, state, robot)
    there = state.copy()
    for name in away:
        there.q[name] = scene.robots[name].model.home.copy()
    return Manipulation(scene, there, robot, object), away


def secure_grasps(
    scene: Scene, body: str, robot: str, contacts: Sequence[ContactPoint], T_body: np.ndarray
) -> list[ContactPoint]:
    """The contacts in which a body neither slips nor turns between the fingers when it is lifted from T_body (7,).

    The pads' friction and the arm's payload carry its weight, whose moment about the closing axis uses at most
    TURNING_SHARE of the friction of two soft fingers.
    """
    model = scene.robots[robot].model
    if model.gripper is None or scene.mode == TaskMode.KINEMATIC:
        return list(contacts)
    load, up = scene.bodies[body], rotation_matrix(T_body)[2]
    if lifting_problem(load, robot, model):
        return [contact for contact in contacts if contact.kind != ContactKind.GRASP]
    share = weight_torque_ratio(load, contacts, model.gripper, up) / TURNING_SHARE
    worst = np.maximum(share, weight_ratio(load, contacts, model, up))
    return [contact for contact, used in zip(contacts, worst, strict=True) if used <= 1.0]
