"""Equilibrium of bodies that touch, with Coulomb friction, as a linear program.

Bodies are in equilibrium if forces inside the friction cones at the corners of their contact patches balance their
weights (Mattikalli, Baraff, Khosla, "Finding all stable orientations of assemblies with friction", IEEE T-RA 1996).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from hmap_core.stability.contact_patches import ContactPatch

CONE_EDGES = 8  # edges of the pyramid in the friction cone
LEAST_CARRIED = 0.5  # share of a body's weight that normal forces carry: what friction alone holds between walls slips
_ANGLES = 2.0 * np.pi * np.arange(CONE_EDGES) / CONE_EDGES


@dataclass(frozen=True)
class Contact:
    """A patch between two of some bodies.

    Attributes:
        patch: its normal points into the first body.
        on: index of the first body.
        by: index of the second body; None for one that does not move.
    """

    patch: ContactPatch
    on: int
    by: int | None = None


def in_equilibrium(
    masses: Sequence[float], centres: np.ndarray, contacts: Sequence[Contact], gravity: np.ndarray
) -> bool:
    """Whether contact forces balance the weights of N bodies.

    Args:
        masses: (N,) kg.
        centres: (N, 3) centres of mass, world frame, m.
        contacts: patches between them, and with bodies that do not move.
        gravity: (3,) its direction.
    """
    if not contacts:
        return False
    n = len(masses)
    columns, lifts = [], []
    for contact in contacts:
        forces = cone(contact.patch.normal, contact.patch.friction)
        lift = np.zeros(n)
        lift[contact.on] = contact.patch.normal[2]
        if contact.by is not None:
            lift[contact.by] = -contact.patch.normal[2]
        lifts += [lift] * (len(contact.patch.points) * CONE_EDGES)
        for point in contact.patch.points:
            for force in forces:
                column = np.zeros((n, 6))
                column[contact.on] = _wrench(point - centres[contact.on], force)
                if contact.by is not None:
                    column[contact.by] = -_wrench(point - centres[contact.by], force)
                columns.append(column.ravel())
    wrenches = np.array(columns).T
    size = max(float(np.abs(wrenches.reshape(n, 6, -1)[:, 3:]).max()), 1e-6)
    wrenches.reshape(n, 6, -1)[:, 3:] /= size  # torques on the scale of forces
    weights = np.asarray(masses) / max(masses)
    needed = np.zeros((n, 6))
    needed[:, :3] = -np.outer(weights, gravity)
    program = scipy.optimize.linprog(
        np.ones(wrenches.shape[1]),
        A_ub=-np.array(lifts).T,
        b_ub=-LEAST_CARRIED * weights,
        A_eq=wrenches,
        b_eq=needed.ravel(),
        bounds=(0.0, None),
        method="highs",
    )
    return bool(program.success)


def cone(normal: np.ndarray, friction: float) -> np.ndarray:
    """Edges (CONE_EDGES, 3) of the pyramid in the friction cone about a unit normal (3,)."""
    first, second = np.linalg.svd(normal[None])[2][1:]
    return normal + friction * (np.outer(np.cos(_ANGLES), first) + np.outer(np.sin(_ANGLES), second))


def _wrench(arm: np.ndarray, force: np.ndarray) -> np.ndarray:
    return np.concatenate([force, np.cross(arm, force)])
