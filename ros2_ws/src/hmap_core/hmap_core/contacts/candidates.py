"""Contacts as arrays: what the generators of touches, grasps and pushes have in common."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hmap_core.transforms import quaternions
from hmap_core.types import AttachedBody, ContactKind, ContactPoint, Gripper

# the grasp depth is reduced by at most this share of the tip length to keep the palm clear
SHALLOWEST = 0.5
# palm to fingertip centre: a tall object ends below it, m
PALM_CLEARANCE = 0.039
# distance left between fingertip and surface where they touch, m
CONTACT_GAP = 5e-5
# vertices of the finger this near to the foremost one make the touching feature, m
FEATURE = 5e-5
# only the part of the feature this near to the end of the finger counts, m
TIP_LENGTH = 0.01


@dataclass(frozen=True)
class Hand:
    """What of the hand matters to a contact, in the end-effector frame (z approach, y closing).

    Attributes:
        tip: (V, 3) vertices of the convex hull of the closed fingers, or of what they hold.
        gripper: None for an arm without fingers or with a body in them; it then cannot grasp.
        attached: the body in the fingers, which touches in their place.
        palm_clearance: from the palm to the fingertip centre, m.
        closed: opening of the closed gripper, m.
        tip_radius: (V,) m, of a sphere round each vertex of the tip; 0.0 for none.
    """

    tip: np.ndarray
    gripper: Gripper | None
    attached: AttachedBody | None = None
    palm_clearance: float = PALM_CLEARANCE
    closed: float = 0.0
    tip_radius: np.ndarray | float = 0.0

    def require_gripper(self) -> Gripper:
        """The gripper of a hand that grasps.

        Raises:
            ValueError: the hand has none.
        """
        if self.gripper is None:
            raise ValueError("the hand has no gripper that could grasp")
        return self.gripper

    def require_attached(self) -> AttachedBody:
        """The body in the fingers.

        Raises:
            ValueError: there is none.
        """
        if self.attached is None:
            raise ValueError("the hand has no attached body")
        return self.attached

    def friction(self, object_friction: float) -> float:
        """Lateral Coulomb coefficient of its touch on an object with this one."""
        return object_friction if self.attached is None else min(object_friction, self.attached.friction)


@dataclass(frozen=True)
class Situation:
    """What contacts are wanted for.

    Attributes:
        T_world_obj: (7,) where the object is.
        T_world_next: (7,) where it is to go next; None when nothing is known of the motion.
        robot_position: (3,) the robot's base, world frame; None: any.
        R_world_hand: (3, 3) orientation that the hand of an arm with few joints keeps, but for rotations about the
            vertical; None: it reaches any.
        support_friction: highest coefficient of what the object slides on; None: not known.
    """

    T_world_obj: np.ndarray
    T_world_next: np.ndarray | None = None
    robot_position: np.ndarray | None = None
    R_world_hand: np.ndarray | None = None
    support_friction: float | None = None


@dataclass(frozen=True)
class HandPoses:
    """How the hand makes N contacts: R (N, 3, 3) and origin (N, 3) of the end-effector frame in the object's frame."""

    R: np.ndarray
    origin: np.ndarray
    opening: np.ndarray
    approach: np.ndarray  # (N, 3) end-effector frame

    def __getitem__(self, chosen: np.ndarray) -> "HandPoses":
        return HandPoses(self.R[chosen], self.origin[chosen], self.opening[chosen], self.approach[chosen])


@dataclass(frozen=True)
class Candidates:
    """N contacts, object frame.

    Attributes:
        toward: (N, 3) where the hand points, its z axis.
        poses: maps indices to how the hand makes these: of thousands of contacts only the first are ever asked for.
    """

    kind: ContactKind
    toward: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    score: np.ndarray
    poses: Callable[[np.ndarray], HandPoses]

    def __len__(self) -> int:
        return len(self.score)

    def contacts(self, chosen: np.ndarray) -> list[ContactPoint]:
        """The chosen ones (indices) as contact points."""
        made = self.poses(chosen)
        frames = np.concatenate([made.origin, quaternions(made.R)], axis=1)
        columns = frames, self.point[chosen], self.normal[chosen], made.opening.tolist(), made.approach
        return [
            ContactPoint(self.kind, *numbers) for numbers in zip(*columns, self.score[chosen].tolist(), strict=True)
        ]


def clear_of_palm(above: np.ndarray, hand: Hand) -> tuple[np.ndarray, np.ndarray]:
    """How much less deep grasps have to be for the object to end below the palm.

    Args:
        above: (N,) extent of the object from the middle between the pads towards the palm, m.
        hand: its palm and fingers.

    Returns:
        Distance (N,) in m to draw back, and (N,) whether the fingers are long enough for it.
    """
    shallower = np.maximum(above - hand.palm_clearance, 0.0)
    return shallower, shallower <= SHALLOWEST * hand.require_gripper().tip_offset


def tangents(normals: np.ndarray, toward: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit tangents (N, 3) of unit normals (N, 3); the first as near to the direction ``toward`` (3,) as can be."""
    first = toward - normals * (normals @ toward)[:, None]
    flat = np.linalg.norm(first, axis=1) < _FLAT
    if flat.any():
        other = np.eye(3)[np.abs(toward).argmin()]
        first[flat] = other - normals[flat] * (normals[flat] @ other)[:, None]
    first /= np.linalg.norm(first, axis=1)[:, None]
    return first, np.cross(normals, first)


_FLAT = 1e-3


def frames(z: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Rotation matrices (N, 3, 3) with columns x, z x x, z from perpendicular unit vectors (N, 3)."""
    return np.stack([x, np.cross(z, x), z], axis=2)


def on_surface(
    R: np.ndarray,
    points: np.ndarray,
    normals: np.ndarray,
    tip: np.ndarray,
    radius: np.ndarray | float = 0.0,
    end: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Slide fingers along the normals until they touch the tangent planes.

    Args:
        R: (N, 3, 3) orientation of the end-effector frame.
        points, normals: (N, 3) where to touch.
        tip: (V, 3) the finger's vertices, end-effector frame.
        radius: (V,) of the spheres round them, m.
        end: (3,) direction in which the end of the finger lies, that touches; None: the z axis of the hand.

    Returns:
        origin (N, 3) of the end-effector frame, for which the foremost vertices lie CONTACT_GAP above the plane with
        their centre over the point; feature (N, V): which vertices those are.
    """
    inward = -np.einsum("nij,ni->nj", R, normals)  # -normal in the end-effector frame
    ahead = inward @ tip.T + radius
    foremost = ahead.max(axis=1)
    feature = ahead >= foremost[:, None] - FEATURE
    height = np.where(feature, tip[:, 2] if end is None else np.einsum("i,nij,vj->nv", end, R, tip), -np.inf)
    feature &= height >= height.max(axis=1)[:, None] - TIP_LENGTH
    centre = feature @ tip / feature.sum(axis=1)[:, None]
    origin = points - np.einsum("nij,nj->ni", R, centre)
    sunk = foremost - np.einsum("nj,nj->n", inward, centre)  # the foremost is this far ahead of the centre
    return origin + normals * (sunk + CONTACT_GAP)[:, None], feature
