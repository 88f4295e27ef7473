"""Bounds on the motion of links and bodies in each step, in the world and in the frame of one another.

Time s runs from 0 to 1 in a step. Joints and positions are linear in s, and bodies turn at a constant rate. Then

* a point at a distance r from the frame of a body that turns by an angle t has an acceleration of at most t^2 r;
* a point of a link has the acceleration sum_j (w_before_j + w_after_j) x u_j, with u_j the velocity that joint j alone
  gives it, and w_before_j, w_after_j the angular velocities of the links before and behind the joint (the second
  derivative of the forward kinematics; Featherstone, *Rigid Body Dynamics Algorithms*, 2008, chapter 2);
* a point with the acceleration a_B has in a frame A, which turns at the rate w, the acceleration
  a_B - a_A - 2 w x v, where a_A is that of the point of A at the same place and v the velocity in the frame.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from hmap_core.validation import rigid


class RelativeMotion(NamedTuple):
    """Bounds on the motion of all points of a part in the frame of another, in each of N-1 steps.

    Attributes:
        speed: (N-1,) bound on the speed, m per step.
        bend: (N-1,) bound on the acceleration, m per squared step. A coordinate deviates from its linear interpolation
            between the samples by at most an eighth of it.
    """

    speed: np.ndarray
    bend: np.ndarray


class Motion(Protocol):
    """How a link or body moves in each of N-1 steps."""

    @property
    def turn(self) -> np.ndarray:
        """Bound (N-1,) on the angular velocity, rad per step."""
        ...

    def speed(self, radius: np.ndarray | float) -> np.ndarray:
        """Bound (N-1,) on the speed of points within a radius (m) of the frame, m per step."""
        ...

    def acceleration(self, radius: np.ndarray | float) -> np.ndarray:
        """Bound (N-1,) on the acceleration of points within a radius (m) of the frame, m per squared step."""
        ...


@dataclass(frozen=True)
class BodyMotion:
    """The motion of a body.

    Attributes:
        moved: (N-1,) translation, m.
        turn: (N-1,) rotation, rad.
    """

    moved: np.ndarray
    turn: np.ndarray

    @classmethod
    def of(cls, poses: np.ndarray) -> "BodyMotion":
        """The motion along poses (N, 7)."""
        moved = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
        return cls(moved, rigid.angle_between(poses[:-1, 3:], poses[1:, 3:]))

    def speed(self, radius: np.ndarray | float) -> np.ndarray:
        """Bound (N-1,) on the speed of points within a radius (m) of the frame, m per step."""
        return self.moved + self.turn * radius

    def acceleration(self, radius: np.ndarray | float) -> np.ndarray:
        """Bound (N-1,) on the acceleration of points within a radius (m) of the frame, m per squared step."""
        return self.turn**2 * radius


@dataclass(frozen=True)
class LinkMotion:
    """The motion of a robot's link by J joints, base first.

    A joint that turns at a rate w moves a point by w times its distance from the axis. That distance is known at the
    first sample of a step. The speeds that the joints behind it give the point are added, since these can change it. So
    the bound on the speed by a joint is linear in the radius about the link's frame within which the points are.

    Attributes:
        joints: their names.
        base: (J, N-1) bound on the speed of the link's frame by each joint, m per step.
        gain: (J, N-1) increase of it with the radius, rad per step.
        spin: (J, N-1) bound on the sum of the angular velocities before and behind each joint, rad per step.
        turn: (N-1,) bound on the angular velocity of the link, rad per step.
    """

    joints: tuple[str, ...]
    base: np.ndarray
    gain: np.ndarray
    spin: np.ndarray
    turn: np.ndarray

    @classmethod
    def of(cls, joints: "JointMotions", rows: list[int], p: np.ndarray) -> "LinkMotion":
        """The motion of a link.

        Args:
            joints: the motion of the robot's joints.
            rows: those that move the link, base first.
            p: (N-1, 3) positions of the link's frame at the first sample of each step, m.
        """
        if not rows:
            none = np.zeros((0, len(p)))
            return cls((), none, none, none, np.zeros(len(p)))
        off_axis = joints.off_axis(rows, p)
        base, gain = joints.slid[rows], joints.turned[rows]
        behind, growth = np.zeros(len(p)), np.zeros(len(p))
        for j in reversed(range(len(rows))):
            base[j] += gain[j] * (off_axis[j] + behind)
            gain[j] += gain[j] * growth
            behind, growth = behind + base[j], growth + gain[j]
        names = tuple(joints.names[row] for row in rows)
        return cls(names, base, gain, joints.spin[rows], joints.turn[rows[-1]])

    def speeds(self, radius: np.ndarray | float) -> np.ndarray:
        """Bound (J, N-1) on the speed that each joint gives to points within a radius (m) of the frame, m per step."""
        return self.base + self.gain * radius

    def speed(self, radius: np.ndarray | float) -> np.ndarray:
        """Bound (N-1,) on the speed of points within a radius (m) of the frame, m per step."""
        return self._sums[0] + self._sums[1] * radius

    def acceleration(self, radius: np.ndarray | float) -> np.ndarray:
        """Bound (N-1,) on the acceleration of points within a radius (m) of the frame, m per squared step."""
        return self._sums[2] + self._sums[3] * radius

    @cached_property
    def _sums(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Speed and acceleration of the link's frame, and their increase with the radius."""
        base, gain = (self.base * self.spin).sum(axis=0), (self.gain * self.spin).sum(axis=0)
        return self.base.sum(axis=0), self.gain.sum(axis=0), base, gain


class JointMotions:
    """The motion of a robot's J joints in each of N-1 steps, with bounds on the angular velocities.

    Args:
        names: of the joints, each after the one before it.
        before: row of the next joint towards the base; -1 of the first ones.
        turns: (J,) whether a joint turns; it slides otherwise.
        moved: (J, N-1) change of each joint, rad or m.
        axes: (3, J, N-1) unit vectors along the joints at the first sample of each step, world frame.
        origins: (3, J, N-1) points on these axes, m.

    Attributes:
        names: as above.
        turned, slid: (J, N-1) rotation and translation, without sign, rad and m; one of them is zero.
        spin: (J, N-1) bound on the sum of the angular velocities before and behind each joint, rad per step.
        turn: (J, N-1) bound on the angular velocity behind each joint, rad per step.
    """

    def __init__(
        self,
        names: list[str],
        before: list[int],
        turns: np.ndarray,
        moved: np.ndarray,
        axes: np.ndarray,
        origins: np.ndarray,
    ):
        self.names = names
        self._axes, self._origins = axes, origins
        self.turned, self.slid = (
            np.where(turns[:, None], np.abs(moved), 0.0),
            np.where(turns[:, None], 0.0, np.abs(moved)),
        )
        # The angular velocity behind each joint at the first sample. Later each axis has turned with the joints before.
        rates = np.where(turns[:, None], moved, 0.0) * axes
        sums, total, drift = rates.copy(), self.turned.copy(), np.zeros_like(moved)
        drifts = np.zeros_like(moved)
        for j, i in enumerate(before):
            if i >= 0:
                rates[:, j] += rates[:, i]
                sums[:, j] = rates[:, j] + rates[:, i]
                drift[j] = drift[i] + self.turned[j] * total[i]
                drifts[j] = drift[j] + drift[i]
                total[j] += total[i]
        self.spin, self.turn = _length(sums) + drifts, _length(rates) + drift

    def off_axis(self, rows: list[int], p: np.ndarray) -> np.ndarray:
        """Distances (n, N-1) of positions (N-1, 3) from the axes of n joints at the first sample of each step, m."""
        x, y, z = self._axes[:, rows]
        a, b, c = p.T[:, None] - self._origins[:, rows]
        return _length(np.array([y * c - z * b, z * a - x * c, x * b - y * a]))


def _length(vectors: np.ndarray) -> np.ndarray:
    """Lengths (...) of vectors (3, ...)."""
    x, y, z = vectors
    return np.sqrt(x * x + y * y + z * z)


def relative(frame: Motion, part: Motion, poses: tuple[np.ndarray, np.ndarray], radius: float) -> RelativeMotion:
    """Bounds on the motion of a part in a frame.

    Args:
        frame: motion of the frame.
        part: motion of the part.
        poses: rotations (N, 3, 3) and positions (N, 3) of the part in the frame.
        radius: of the part about its own frame, m.

    Returns:
        The bounds; infinite in a step in which the frame turns by a radian or more.
    """
    R, p = poses
    moved = np.linalg.norm(np.diff(p, axis=0), axis=1) + rigid.step_angles(R) * radius  # of any point, in a step
    apart = np.linalg.norm(p, axis=1)
    far = np.maximum(apart[:-1], apart[1:]) + radius + 0.5 * (part.speed(radius) + frame.speed(0.0))
    # v is at most ``moved`` and half of the acceleration, so that this stands on both sides
    known = part.acceleration(radius) + frame.acceleration(far) + 2.0 * frame.turn * moved
    rest = 1.0 - frame.turn
    bend = np.where(rest > 0.0, known / np.where(rest > 0.0, rest, 1.0), np.inf)
    return RelativeMotion(moved + 0.5 * bend, bend)
