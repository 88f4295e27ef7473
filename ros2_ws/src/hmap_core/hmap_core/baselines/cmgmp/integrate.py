"""Forward integration: the object moves towards a pose as a contact mode and the balance of forces allow."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from hmap_core.baselines.cmgmp.forces import Balance
from hmap_core.baselines.cmgmp.modes import projected, rows, tangents
from hmap_core.baselines.cmgmp.problem import EnvironmentContact, ObjectProblem
from hmap_core.transforms import quaternion_multiply, rotation_matrix

STEP = 0.2  # of the object's size, longest step
TURN = 0.05  # rad, widest step
STEPS = 150  # at most
SLOWEST = 1e-3  # of the wanted velocity
CORRECTIONS = 3  # of the gaps of kept contacts after a step
GAP = 0.2  # of the tolerance that these may have
ARRIVED = 1e-3  # of the longest step: what is nearer is there
SMALLEST = 0.02  # of a step, where it is shortened before a new contact


@dataclass(frozen=True)
class Mode:
    """A contact mode at one pose.

    Attributes:
        contacts: of the object with obstacles; kept: (n,) which are kept.
        sticks: whether all kept ones stick; else they are free to slide.
    """

    contacts: list[EnvironmentContact]
    kept: np.ndarray
    sticks: bool

    def kept_pairs(self) -> set[tuple[int, int]]:
        """Pairs of which all contacts are kept: faces that stay in contact, whichever points they touch at."""
        all_of = {c.pair for c in self.contacts}
        return all_of - {c.pair for c, keep in zip(self.contacts, self.kept, strict=True) if not keep}


def wanted(T: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Twist (6,) in the object's frame that brings the object from T to goal (7,) in unit time."""
    R = rotation_matrix(T)
    turn = (Rotation.from_quat(T[3:]).inv() * Rotation.from_quat(goal[3:])).as_rotvec()
    return np.concatenate([R.T @ (goal[:3] - T[:3]), turn])


def moved(T: np.ndarray, twist: np.ndarray) -> np.ndarray:
    """The pose (7,) after a small motion (6,) in the object's frame."""
    quaternion = quaternion_multiply(T[3:], Rotation.from_rotvec(twist[3:]).as_quat())
    return np.concatenate([T[:3] + rotation_matrix(T) @ twist[:3], quaternion / np.linalg.norm(quaternion)])


class Integration:
    """Integrates the motion of an object.

    Args:
        problem: the object.
        balance: of its forces.
    """

    def __init__(self, problem: ObjectProblem, balance: Balance):
        self._problem, self._balance = problem, balance

    def fixed(self, T: np.ndarray) -> np.ndarray:
        """Rows (k, 6) of twists that the problem forbids at T (7,): none, or all that leave the plane."""
        if not self._problem.planar:
            return np.zeros((0, 6))
        R = rotation_matrix(T).T  # columns: the world's axes
        zero = np.zeros(3)
        return np.array([np.concatenate(pair) for pair in ((R[:, 2], zero), (zero, R[:, 0]), (zero, R[:, 1]))])

    def velocity(self, T: np.ndarray, goal: np.ndarray, mode: Mode) -> np.ndarray | None:
        """The twist (6,) nearest to the wanted one that the mode allows; None where nothing separates."""
        twist = wanted(T, goal)
        found = projected(twist, self._constraints(T, mode), self._problem.size)
        size = self._problem.size
        if np.linalg.norm(found[:3]) + size * np.linalg.norm(found[3:]) < SLOWEST * (
            np.linalg.norm(twist[:3]) + size * np.linalg.norm(twist[3:])
        ):
            return None
        apart = [c for c, keep in zip(mode.contacts, mode.kept, strict=True) if not keep]
        if apart:
            leaving = rows(np.array([c.point for c in apart]), np.array([c.normal for c in apart])) @ found
            if (leaving < -1e-9).any():
                return None
        return found

    def _constraints(self, T: np.ndarray, mode: Mode) -> np.ndarray:
        kept = [c for c, keep in zip(mode.contacts, mode.kept, strict=True) if keep]
        found = [self.fixed(T)]
        if kept:
            points, normals = np.array([c.point for c in kept]), np.array([c.normal for c in kept])
            found.append(rows(points, normals))
            if mode.sticks:
                found += [rows(points, across) for across in tangents(normals)]
        return np.concatenate(found)

    def balanced(self, T: np.ndarray, twist: np.ndarray, mode: Mode, fingers: np.ndarray) -> bool:
        """Whether fingers, by the generators (6, k) of their wrenches, and kept contacts hold the object."""
        generators = np.concatenate(
            [fingers, self._balance.obstacles(mode.contacts, mode.kept, twist, mode.sticks)], axis=1
        )
        return self._balance.holds(generators, self._balance.gravity(T))

    def run(
        self,
        T: np.ndarray,
        goal: np.ndarray,
        mode: Mode,
        fingers: np.ndarray,
        free: Callable[[np.ndarray], bool],
    ) -> np.ndarray:
        """Poses (m, 7) from T (7,) on towards a goal, until a contact is made or lost, or forces do not balance.

        Args:
            fingers: (6, k) generators of their wrenches.
            free: whether the fingers are free with the object at a pose (7,).
        """
        problem, poses, last = self._problem, [T], None
        for _ in range(STEPS):
            twist = self.velocity(T, goal, mode)
            if twist is None or not self.balanced(T, twist, mode, fingers):
                break
            if last is not None and float(twist @ last) < 0.0:
                break
            far, turn = float(np.linalg.norm(twist[:3])), float(np.linalg.norm(twist[3:]))
            length = max(far / (STEP * problem.size), turn / TURN)
            if length < ARRIVED:
                break
            share = min(1.0, 1.0 / length)
            new = self._step(T, share * twist, mode)
            while new is None and share * length > SMALLEST:
                share *= 0.5
                new = self._step(T, share * twist, mode)
            if new is None or not free(new[0]):
                break
            T, after, ends = new
            poses.append(T)
            if ends:
                break
            mode, last = after, twist
        return np.array(poses)

    def _step(self, T: np.ndarray, motion: np.ndarray, mode: Mode) -> tuple[np.ndarray, Mode, bool] | None:
        """The pose after a step, the mode there, and whether the mode ends; None where the step is too long."""
        R = rotation_matrix(T)
        normals = {c.pair: R @ c.normal for c in mode.contacts}
        T = moved(T, motion)
        touching = self._problem.contacts(T, normals)
        contacts = touching.contacts
        pairs = mode.kept_pairs()
        labels = {c.label for c, keep in zip(mode.contacts, mode.kept, strict=True) if keep}
        for _ in range(CORRECTIONS):
            kept = [c for c in contacts if c.pair in pairs or c.label in labels]
            if not kept or max(abs(c.gap) for c in kept) <= GAP * self._problem.tolerance:
                break
            T = moved(T, self._closing(T, kept))
            touching = self._problem.contacts(T, normals)
            contacts = touching.contacts
        if touching.gap < self._problem.deepest:
            return None
        keep = np.array([c.pair in pairs or c.label in labels for c in contacts], bool)
        touched = {c.pair for c in contacts}
        lost = bool(pairs - touched) or self._lost(mode, contacts)
        known = {c.label for c in mode.contacts}
        made = any(not k and c.label not in known and c.pair not in pairs for c, k in zip(contacts, keep, strict=True))
        if lost:
            return None
        return T, Mode(contacts, keep, mode.sticks), made

    @staticmethod
    def _lost(mode: Mode, contacts: list[EnvironmentContact]) -> bool:
        """Whether a contact of a pair that is kept in part is there no more."""
        there, pairs = {c.label for c in contacts}, mode.kept_pairs()
        return any(
            keep and c.pair not in pairs and c.label not in there
            for c, keep in zip(mode.contacts, mode.kept, strict=True)
        )

    def _closing(self, T: np.ndarray, kept: list[EnvironmentContact]) -> np.ndarray:
        """The small motion (6,) that closes the gaps of kept contacts."""
        size = self._problem.size
        scale = np.array([1.0, 1.0, 1.0, size, size, size])
        points, normals = np.array([c.point for c in kept]), np.array([c.normal for c in kept])
        fixed = self.fixed(T)
        matrix = np.concatenate([rows(points, normals), fixed]) / scale
        gaps = np.concatenate([-np.array([c.gap for c in kept]), np.zeros(len(fixed))])
        return np.linalg.lstsq(matrix, gaps, rcond=1e-6)[0] / scale
