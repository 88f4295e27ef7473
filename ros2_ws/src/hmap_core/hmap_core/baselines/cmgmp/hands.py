"""Robots as manipulators of CMGMP: contacts from hmap's sampler, reached and followed by inverse kinematics."""

from collections.abc import Iterator

import numpy as np

from hmap_core.baselines.birrt.contacts import Contacts
from hmap_core.baselines.birrt.manifold import Manifold
from hmap_core.baselines.birrt.search import Leg
from hmap_core.baselines.birrt.space import ObjectSpace
from hmap_core.baselines.cmgmp.fingers import NONE, Placement, Relocation, patches
from hmap_core.baselines.cmgmp.search import Node
from hmap_core.contacts.feasibility import reachable
from hmap_core.transforms import rotation_matrix
from hmap_core.types import ContactKind

CANDIDATES = 240  # contacts looked at for one relocation
KEPT = 240  # contacts of a batch that are kept
PAD = 0.008  # m, radius of the patch at which a fingertip or tool touches


class TouchingSpace(ObjectSpace):
    """Poses of an object that may touch what stands around: the search of CMGMP has checked its motions."""

    def reached(self, poses: np.ndarray) -> int:
        """All of the poses (m + 1, 7) after the first."""
        return len(poses) - 1


class RobotHands:
    """Implements :class:`hmap_core.baselines.cmgmp.fingers.Manipulator`: one hand at a time, bare or with a tool.

    Args:
        contacts: draws contacts.
    """

    def __init__(self, contacts: Contacts):
        self._contacts = contacts

    def relocations(self, placement: Placement | None, T: np.ndarray, rng: np.random.Generator) -> Iterator[Relocation]:
        """Yield contacts of a random hand; meanwhile the object rests alone."""
        for mode in self._contacts.candidates(T[None], rng, CANDIDATES):
            yield Relocation(Placement(*_points(mode), key=(mode,)), NONE)

    def settled(self, placement: Placement, T: np.ndarray, rng: np.random.Generator) -> Placement | None:
        """The placement with the configuration in which the robot touches, if there is one."""
        mode: Manifold = placement.key[0]
        ok, q = reachable(mode.hand.manipulation, [mode.contact], T, rng)
        return Placement(placement.points, placement.normals, (mode, q)) if ok[0] else None

    def free(self, placement: Placement, T: np.ndarray) -> bool:
        """Always: :meth:`followed` looks at all links."""
        return True

    def followed(self, placement: Placement, poses: np.ndarray) -> tuple[Placement, np.ndarray]:
        """The poses that the arm follows; the placement remembers its configurations."""
        mode, path = placement.key
        path, poses = mode.along(path[-1], poses, False)
        return Placement(placement.points, placement.normals, (mode, path)), poses


def legs_of(branch: list[Node]) -> list[Leg]:
    """The legs of the robots along a branch of the tree."""
    placed = ((node.placement.key, node.poses) for node in branch if node.placement is not None)
    return [Leg(mode, path, poses) for (mode, path), poses in placed]


def _points(mode: Manifold) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 3) at which a hand touches the object, and the outward normals, object frame."""
    contact = mode.contact
    if contact.kind != ContactKind.GRASP:
        return patches(contact.point[None], contact.normal[None], PAD)
    closing = rotation_matrix(contact.T_obj_ee)[:, 1]
    sides = np.array([closing, -closing])
    return patches(contact.T_obj_ee[:3] + 0.5 * contact.opening * sides, sides, PAD)
