"""The manifold of one contact: the joints that keep the hand in contact, and the pose of the object that follows."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hmap_core.baselines.birrt.space import ObjectSpace
from hmap_core.contacts.feasibility import MAX_JUMP, ik_problem, reach_bounds
from hmap_core.komo.features import pose_params_all
from hmap_core.komo.ik import follow_ik
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.segment import Phase, bit
from hmap_core.planner.interfaces import ToolGrasp
from hmap_core.planner.transit import TransitChecks
from hmap_core.transforms import inverse, multiply, multiply_all
from hmap_core.types import ContactKind, ContactPoint, Scene

SLIDING = (ContactKind.PUSH, ContactKind.PRESS)  # contacts that serve in some directions only


@dataclass(frozen=True)
class Hand:
    """What touches the object: the bare hand of a robot, or the tool that it has grasped.

    Attributes:
        robot: its name.
        scene: the scene; the tool is part of the hand in it.
        manipulation: of the object by this hand, the other robots at home.
        clear: robots that have to go home before.
        grasp: on the tool; None for the bare hand.
    """

    robot: str
    scene: Scene
    manipulation: Manipulation
    clear: tuple[str, ...]
    grasp: ToolGrasp | None


class Manifold:
    """Configurations of a hand in one contact with the object.

    Args:
        hand: the hand.
        contact: its contact.
        space: of the object.
    """

    def __init__(self, hand: Hand, contact: ContactPoint, space: ObjectSpace):
        self.hand, self.contact = hand, contact
        self._space = space
        self._T_ee_obj = inverse(contact.T_obj_ee)

    @cached_property
    def _carrying(self):
        return ik_problem(self.hand.manipulation, self.hand.manipulation.carrying_collisions(self.contact), Phase.HOLD)

    @cached_property
    def _checks(self) -> TransitChecks:
        cols = self.hand.manipulation.carrying_collisions(self.contact).arrays()
        return TransitChecks(self.hand.manipulation.model.chain, cols, bit(Phase.HOLD))

    def object_pose(self, q: np.ndarray) -> np.ndarray:
        """Where (7,) the object is with the robot at q (n,)."""
        hand = self.hand.manipulation
        base = hand.scene.robots[hand.robot].base_pose
        return multiply(multiply(base, hand.arm.end_effector(q)), self._T_ee_obj)

    def along(self, q: np.ndarray, poses: np.ndarray, backwards: bool) -> tuple[np.ndarray, np.ndarray]:
        """Configurations (k, n) with the object at poses (k, 7), as far along poses (m + 1, 7) as all is free.

        Args:
            q: (n,) the configuration at poses[0].
            poses: of the object.
            backwards: whether the object will move from the last one to the first one.
        """
        poses = poses[: self._space.reached(poses) + 1]
        if self.contact.kind in SLIDING:
            poses = self._slid(poses, backwards)
        if len(poses) < 2:
            return q[None], poses[:1]
        targets = pose_params_all(self.hand.manipulation.T_tip_ee, multiply_all(poses[1:], self.contact.T_obj_ee))
        path = _continuous(np.concatenate([q[None], follow_ik(self._carrying, targets, q, MAX_JUMP)]))
        count = self._checks.reached(path) if len(path) > 1 else 0
        return path[: count + 1], poses[: count + 1]

    def towards(self, q: np.ndarray, goal: np.ndarray, backwards: bool) -> tuple[np.ndarray, np.ndarray]:
        """As :meth:`along`, straight in the joints towards goal (n,); each configuration is projected on the manifold.

        Projection by inverse kinematics: the object goes to the nearest pose that it can have.
        """
        line = self._checks.line(q, goal)
        path, poses = [q], [self.object_pose(q)]
        for k in range(1, len(line)):
            T = self._space.projected(self.object_pose(path[-1] + line[k] - line[k - 1]))
            target = pose_params_all(self.hand.manipulation.T_tip_ee, multiply_all(T[None], self.contact.T_obj_ee))
            found = follow_ik(self._carrying, target, path[-1] + line[k] - line[k - 1], MAX_JUMP)
            if not len(found):
                break
            path.append(found[0])
            poses.append(T)
        if self.contact.kind in SLIDING:
            poses = list(self._slid(np.array(poses), backwards))
        places = np.array(poses)
        ways = _continuous(np.array(path[: len(places)]))
        free = self._space.reached(places[: len(ways)])
        count = min(free, self._checks.reached(ways[: free + 1])) if free else 0
        return ways[: count + 1], places[: count + 1]

    def _slid(self, poses: np.ndarray, backwards: bool) -> np.ndarray:
        """The poses over which a contact that slides the object serves."""
        contact = [self.contact]
        if not backwards:
            return poses[: max(0, int(reach_bounds(self.hand.manipulation, contact, poses)[0])) + 1]
        whole = len(poses) - 1
        serves = whole > 0 and reach_bounds(self.hand.manipulation, contact, poses[::-1])[0] >= whole
        return poses if serves else poses[:1]


def _continuous(path: np.ndarray) -> np.ndarray:
    """The configurations (M, n) before the first jump of a joint."""
    jumps = (np.abs(np.diff(path, axis=0)) > MAX_JUMP).any(axis=1)
    return path[: int(np.append(jumps, True).argmax()) + 1]
