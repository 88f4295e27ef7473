"""Forward kinematics of a robot at all samples of a plan."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from hmap_core.validation import rigid, urdf
from hmap_core.validation.document import RobotData
from hmap_core.validation.files import invalid_plan
from hmap_core.validation.motion import JointMotions, LinkMotion

Frames = dict[str, tuple[np.ndarray, np.ndarray]]  # link -> rotations (N, 3, 3), positions (N, 3)


@dataclass(frozen=True)
class Arm:
    """The kinematic tree of a robot, matched to the joint names of the plan.

    Attributes:
        data: the robot as the plan file describes it.
        tree: its URDF.
    """

    data: RobotData
    tree: urdf.Urdf

    def values(self, joints: np.ndarray, openings: np.ndarray) -> dict[str, np.ndarray]:
        """Values of all moving joints; a joint that the plan does not name is zero or follows its ``mimic`` element.

        Args:
            joints: (N, n) arm joints, rad or m.
            openings: (N,) gripper openings, m.

        Returns:
            Joint name -> values (N,).

        Raises:
            InputError: INVALID_PLAN_FILE; joints mimic each other in a cycle.
        """
        values = {name: joints[:, i] for i, name in enumerate(self.data.joint_names)}
        gripper = self.data.gripper
        if gripper is not None:
            travel = gripper.travel(openings)
            each = zip(gripper.joint_names, gripper.at_zero, gripper.per_joint, strict=True)
            values |= {name: start + travel * slope for name, start, slope in each}
        left = {j.name: j for j in self.tree.joints if j.kind in urdf.MOVING and j.name not in values}
        while left:
            ready = [name for name, joint in left.items() if joint.mimic is None or joint.mimic[0] not in left]
            if not ready:
                raise invalid_plan(f"robot {self.data.name!r}: the joints {', '.join(left)} mimic each other")
            for name in ready:
                source, multiplier, offset = left.pop(name).mimic or ("", 0.0, 0.0)
                values[name] = multiplier * values.get(source, np.zeros(len(joints))) + offset
        return values

    def frames(self, values: dict[str, np.ndarray]) -> Frames:
        """World frames of all links at joint values (N,), as :meth:`values` returns them."""
        N = len(next(iter(values.values()))) if values else 1
        R0, p0 = rigid.matrices(self.data.base_pose[3:]), self.data.base_pose[:3]
        frames = {self.tree.root: (np.broadcast_to(R0, (N, 3, 3)), np.broadcast_to(p0, (N, 3)))}
        for joint in self.tree.joints:
            R, p = frames[joint.parent]
            p = p + rigid.apply(R, joint.origin_p)
            R = rigid.apply(R, joint.origin_R)
            if joint.kind in ("revolute", "continuous"):
                R = rigid.rotated(R, joint.axis, values[joint.name])
            elif joint.kind == "prismatic":
                p = p + rigid.apply(R, joint.axis) * values[joint.name][:, None]
            frames[joint.child] = (R, p)
        return frames

    def end_effector(self, frames: Frames) -> tuple[np.ndarray, np.ndarray]:
        """World frame of the end effector.

        Args:
            frames: of the links, as :meth:`frames` returns them.

        Returns:
            Rotations (N, 3, 3) and positions (N, 3).
        """
        R, p = frames[self.data.end_effector_link]
        T = self.data.T_link_ee
        return rigid.apply(R, rigid.matrices(T[3:])), p + rigid.apply(R, T[:3])

    def fingers(self) -> tuple[str, ...]:
        """The links that may touch an object: the fingers, or the end-effector link of an arm without gripper.

        If that link has no shapes, the nearest link towards the base that has some replaces it.
        """
        if self.data.gripper is not None:
            return self.data.gripper.finger_links
        link = self.data.end_effector_link
        while link not in self.tree.shaped and (joint := self.tree.joint_to(link)) is not None:
            link = joint.parent
        return (link,)

    def moving(self, link: str) -> tuple[urdf.Joint, ...]:
        """The moving joints between the base and a link, base first."""
        return self.tree.moving[link]

    def adjacent(self, link_a: str, link_b: str) -> bool:
        """Whether two links are rigidly connected or share a joint, so that their hulls always overlap at the joint."""
        a, b = self.moving(link_a), self.moving(link_b)
        if [joint.name for joint in a] == [joint.name for joint in b]:
            return True
        return self._carrier(link_a) == link_b or self._carrier(link_b) == link_a

    def _carrier(self, link: str) -> str | None:
        """The nearest link towards the base that has shapes."""
        joint = self.tree.joint_to(link)
        while joint is not None and joint.parent not in self.tree.shaped:
            joint = self.tree.joint_to(joint.parent)
        return None if joint is None else joint.parent

    def motions(self, links: Iterable[str], values: dict[str, np.ndarray], frames: Frames) -> dict[str, LinkMotion]:
        """Bounds on the motion of some links in each of the N-1 steps.

        Args:
            links: the links.
            values: joint values (N,), see :meth:`values`.
            frames: link frames, see :meth:`frames`.
        """
        joints = [joint for joint in self.tree.joints if joint.kind in urdf.MOVING]
        rows = {joint.name: j for j, joint in enumerate(joints)}
        chains = [self.moving(joint.child) for joint in joints]
        before = [rows[chain[-2].name] if len(chain) > 1 else -1 for chain in chains]
        steps = len(frames[self.tree.root][0]) - 1
        moved, axes, origins = (np.empty((*shape, len(joints), steps)) for shape in ((), (3,), (3,)))
        for j, joint in enumerate(joints):
            R, origin = frames[joint.child]
            moved[j] = np.diff(values[joint.name])
            axes[:, j], origins[:, j] = rigid.apply(R[:-1], joint.axis).T, origin[:-1].T
        turns = np.array([joint.kind != "prismatic" for joint in joints], bool)
        motions = JointMotions([joint.name for joint in joints], before, turns, moved, axes, origins)
        return {
            link: LinkMotion.of(motions, [rows[joint.name] for joint in self.moving(link)], frames[link][1][:-1])
            for link in links
        }


def build(data: RobotData) -> Arm:
    """Builds a robot of the plan file from its URDF.

    Args:
        data: the robot as the plan file describes it.

    Returns:
        The robot.

    Raises:
        InputError: INVALID_PLAN_FILE; the URDF is missing or invalid, or lacks a joint or link that the plan names.
    """
    tree = urdf.load(data.urdf)
    joints = {joint.name for joint in tree.joints if joint.kind in urdf.MOVING}
    gripper_joints = data.gripper.joint_names if data.gripper else ()
    fingers = data.gripper.finger_links if data.gripper else ()
    for name in (*data.joint_names, *gripper_joints):
        if name not in joints:
            there = ", ".join(sorted(joints))
            raise invalid_plan(f"robot {data.name!r}: no moving joint {name!r} in its URDF; it has {there}")
    for link in (data.end_effector_link, *fingers):
        if link not in tree.links:
            raise invalid_plan(f"robot {data.name!r}: no link {link!r} in its URDF; it has {', '.join(tree.links)}")
    return Arm(data, tree)
