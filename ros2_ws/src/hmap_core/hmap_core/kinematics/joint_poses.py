"""Poses of a robot's links relative to their parents, the fingers included: what tf and viewers need."""

import numpy as np

from hmap_core.robot_description import load_robot_description
from hmap_core.transforms import IDENTITY, multiply
from hmap_core.types import RobotModel


class JointPoses:
    """The tree of a robot's links.

    Args:
        model: the robot.

    Attributes:
        root: name of the base link.
        parents: link -> its parent; parents come before their children.
        fixed: link -> ``T_parent_link`` (7,) of those that never move.

    Raises:
        InputError: INVALID_SCENE; the robot description has errors.
    """

    def __init__(self, model: RobotModel):
        description = load_robot_description(model.urdf).require_valid()
        self.root = description.root
        self._model, self._tree = model, description.tree
        children: dict[str, list] = {}
        for joint in description.joints.values():
            children.setdefault(joint.parent, []).append(joint)
        self.parents: dict[str, str] = {}
        self.fixed: dict[str, np.ndarray] = {}
        self._moving = []
        waiting = [self.root]
        while waiting:
            for joint in children.get(waiting.pop(0), ()):
                self.parents[joint.child] = joint.parent
                waiting.append(joint.child)
                if joint.moves:
                    self._moving.append(joint)
                else:
                    self.fixed[joint.child] = joint.T_parent_joint

    def moving(self, q: np.ndarray, opening: float) -> dict[str, np.ndarray]:
        """``T_parent_link`` (7,) of the links that joints move.

        Args:
            q: (n,) of the arm, rad or m.
            opening: of the gripper, m.
        """
        values = dict(zip(self._model.joint_names, np.asarray(q, float).tolist(), strict=True))
        gripper = self._model.gripper
        if gripper is not None:
            values |= dict(zip(gripper.joint_names, gripper.joints(opening), strict=True))
        return {
            joint.child: multiply(joint.T_parent_joint, _motion(joint, self._tree.value(joint.name, values)))
            for joint in self._moving
        }


def _motion(joint, value: float) -> np.ndarray:
    """Pose (7,) of the child link in the joint frame at a value (rad or m)."""
    if joint.kind == "prismatic":
        return np.concatenate([value * joint.axis, IDENTITY[3:]])
    half = 0.5 * value
    return np.concatenate([np.zeros(3), np.sin(half) * joint.axis, [np.cos(half)]])
