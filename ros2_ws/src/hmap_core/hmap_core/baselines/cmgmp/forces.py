"""Quasi-static balance: whether forces in the friction cones of a mode hold the object, as a linear program."""

import math

import numpy as np
from scipy.optimize import linprog, nnls

from hmap_core.baselines.cmgmp.modes import SLIDES, cross, rows, tangents
from hmap_core.baselines.cmgmp.problem import EnvironmentContact, ObjectProblem
from hmap_core.transforms import rotation_matrix

SIDES = 8  # of the pyramid in a friction cone
IMBALANCE = 1e-4  # of the weight that may be left
MOST_FORCE = 50.0  # weights; the sum of all normal forces, so that nothing jams


class Balance:
    """The balance of an object's weight, contact forces of obstacles and of fingers.

    Args:
        problem: the object with its friction.
    """

    def __init__(self, problem: ObjectProblem):
        self._problem = problem
        self._scale = np.array([1.0, 1.0, 1.0, *[1.0 / problem.size] * 3])

    def gravity(self, T: np.ndarray) -> np.ndarray:
        """Wrench (6,) of the weight with the object at T (7,), object frame."""
        force = rotation_matrix(T).T @ np.array([0.0, 0.0, -self._problem.weight])
        return rows(self._problem.centre[None], force[None])[0]

    def fingers(self, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
        """Generators (6, k) of the wrenches of fingers at points (n, 3) with outward normals (n, 3)."""
        return _cones(points, -normals, self._problem.finger_friction)

    def obstacles(
        self, contacts: list[EnvironmentContact], kept: np.ndarray, twist: np.ndarray, sticks: bool
    ) -> np.ndarray:
        """Generators (6, k) of the wrenches of kept contacts (n,); those that slide have friction against the motion.

        Args:
            contacts: all contacts.
            kept: (n,) which of them are kept.
            twist: (6,) of the object.
            sticks: whether none of them slides.
        """
        own = [contact for contact, keep in zip(contacts, kept, strict=True) if keep]
        if not own:
            return np.zeros((6, 0))
        friction = self._problem.friction
        points, normals = np.array([c.point for c in own]), np.array([c.normal for c in own])
        speed = _length(twist[:3]) + self._problem.size * _length(twist[3:])
        velocity = twist[:3] + cross(twist[None, 3:], points)
        velocity -= normals * (normals * velocity).sum(axis=1)[:, None]
        length = np.sqrt((velocity**2).sum(axis=1))
        slides = ~(length <= SLIDES * speed) & (not sticks)
        sliding = normals[slides] - friction * velocity[slides] / length[slides, None]
        still = _cones(points[~slides], normals[~slides], friction)
        return np.concatenate([still, rows(points[slides], sliding).T], axis=1)

    def holds(self, generators: np.ndarray, gravity: np.ndarray) -> bool:
        """Whether non-negative multiples of generators (6, k) balance a wrench (6,): the program's feasibility.

        Asked some thousand times in a search; non-negative least squares (Lawson and Hanson, 1974) answers in a
        hundredth of the time of a solver of linear programs. :meth:`forces` has the last word.
        """
        if not generators.shape[1]:
            return False
        load = -gravity * self._scale
        _, residual = nnls(generators * self._scale[:, None], load)
        return bool(residual <= IMBALANCE * np.linalg.norm(load))

    def forces(self, generators: np.ndarray, gravity: np.ndarray) -> np.ndarray | None:
        """The smallest forces (k,) along generators (6, k) that balance a wrench (6,), by HiGHS; None for none.

        Their sum is at most MOST_FORCE times the weight.
        """
        matrix, load = generators * self._scale[:, None], -gravity * self._scale
        weight = float(np.linalg.norm(load))
        k = matrix.shape[1]
        slack = IMBALANCE * weight
        found = linprog(
            np.ones(k),
            A_ub=np.concatenate([matrix, -matrix, np.ones((1, k))]),
            b_ub=np.concatenate([load + slack, slack - load, [MOST_FORCE * weight]]),
            method="highs",
        )
        return found.x if found.status == 0 else None


def _cones(points: np.ndarray, normals: np.ndarray, friction: float) -> np.ndarray:
    """Generators (6, n SIDES) of the wrenches of sticking contacts (n, 3); the pyramids lie in the cones."""
    if not len(points):
        return np.zeros((6, 0))
    first, second = tangents(normals)
    around = _COSINES[:, None] * first[:, None] + _SINES[:, None] * second[:, None]
    directions = (normals[:, None] + friction * around).reshape(-1, 3)
    return rows(np.repeat(points, SIDES, axis=0), directions).T


def _length(vector: np.ndarray) -> float:
    return math.sqrt(float(vector @ vector))


_ANGLES = 2.0 * np.pi * np.arange(SIDES) / SIDES
_COSINES, _SINES = np.cos(_ANGLES), np.sin(_ANGLES)
