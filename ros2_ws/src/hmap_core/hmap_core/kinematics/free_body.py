"""A free body as a chain of virtual joints, so that an object's pose can be a variable of the optimisation."""

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from scipy.spatial.transform import Rotation

from hmap_core.collision.convex import ConvexSet
from hmap_core.exceptions import Code, InputError
from hmap_core.kinematics.branch import Branch
from hmap_core.transforms import IDENTITY, euler_angles, from_matrix, inverse, multiply, rotation_matrix, to_matrix

PLANE_TOLERANCE = 1e-6  # m or, for unit vectors, 1; largest deviation of a planar body's pose from its plane
MAX_PITCH = np.radians(80.0)  # rad; the rotation of a spatial body is singular at a pitch of 90 degrees
MAX_TURN = 2.0 * np.pi  # rad in each direction, limit of the other rotations


class Freedom(StrEnum):
    """The degrees of freedom of a free body."""

    PLANAR = "planar"  # translation along x and y of the reference, rotation about its z
    SPATIAL = "spatial"  # translation along x, y, z of the reference, then rotation about the body's x, y and z


# The axes of translation and of rotation, in the order of the joints; 0, 1, 2 are x, y, z. The last axis is z, which is
# the axis of every joint in its own frame, so the last frame is the frame of the body.
_SLIDES = {Freedom.PLANAR: (0, 1), Freedom.SPATIAL: (0, 1, 2)}
_TURNS = {Freedom.PLANAR: (2,), Freedom.SPATIAL: (0, 1, 2)}
_PITCH = 4  # index of the pitch joint of a spatial body


def _z_along(axis: int) -> np.ndarray:
    """A rotation (3, 3) that maps z to x, y or z (axis 0, 1 or 2)."""
    return np.roll(np.eye(3), 2 - axis, axis=1)


def extent_of(shapes: ConvexSet, T_tip_body: np.ndarray = IDENTITY) -> float:
    """Radius of a ball about the tip's origin that contains a set of shapes.

    Args:
        shapes: the shapes, in the body frame.
        T_tip_body: (7,) pose of the body in the tip frame.

    Returns:
        The radius, m.
    """
    centers = to_matrix(T_tip_body)[:3, :3] @ shapes.center.T + T_tip_body[:3, None]
    return float((np.linalg.norm(centers, axis=0) + shapes.bound).max(initial=0.0))


@dataclass(frozen=True)
class FreeBody:
    """An object as a serial chain of virtual joints.

    A planar body has the coordinates (x, y, yaw), a spatial body (x, y, z, roll, pitch, yaw) with the rotation
    R_x(roll) R_y(pitch) R_z(yaw), which is singular at a pitch of 90 degrees. A reference
    near the expected poses keeps clear of the singularity.

    Attributes:
        name: of the object.
        freedom: planar or spatial.
        T_world_reference: (7,) pose of the tip at zero coordinates; a planar body moves in the x-y plane of this frame.
        lower, upper: (2,) or (3,) bounds of the position in the reference frame, m.
        extent: bound on the distance of the body's points from the tip's origin, m; see :func:`extent_of`.
        T_tip_body: (7,) pose of the body in the tip frame, such as its resting pose on the plane.

    Raises:
        InputError: bounds of wrong length or order, or a negative extent.
    """

    name: str
    freedom: Freedom
    T_world_reference: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    extent: float
    T_tip_body: np.ndarray = field(default_factory=lambda: IDENTITY)

    def __post_init__(self):
        slides = len(_SLIDES[self.freedom])
        lower, upper = np.asarray(self.lower, float), np.asarray(self.upper, float)
        if lower.shape != (slides,) or upper.shape != (slides,) or not (lower <= upper).all():
            raise InputError(
                f"free body '{self.name}': the bounds {lower} to {upper} of its position; "
                f"allowed: {slides} numbers each, lower not above upper",
                Code.INVALID_SCENE,
            )
        if not self.extent >= 0.0:
            raise InputError(f"free body '{self.name}': extent is {self.extent}; allowed: 0 m or more")

    @property
    def n(self) -> int:
        """Number of coordinates."""
        return len(_SLIDES[self.freedom]) + len(_TURNS[self.freedom])

    def branch(self) -> Branch:
        """The virtual joints, as :class:`KinematicModel` expects them."""
        axes = [_z_along(axis) for axis in _SLIDES[self.freedom] + _TURNS[self.freedom]]
        base = to_matrix(self.T_world_reference)
        R = np.array([before.T @ after for before, after in zip([np.eye(3), *axes], axes, strict=False)])
        R[0] = base[:3, :3] @ R[0]
        p = np.zeros((self.n, 3))
        p[0] = base[:3, 3]
        slides = len(_SLIDES[self.freedom])
        prismatic = np.array([1] * slides + [0] * (self.n - slides), np.int64)
        turn = np.full(self.n - slides, MAX_TURN)
        if self.freedom == Freedom.SPATIAL:
            turn[_PITCH - slides] = MAX_PITCH
        reach = np.where(prismatic == 1, 1.0, self.extent)
        return Branch(R, p, prismatic, np.r_[self.lower, -turn], np.r_[self.upper, turn], reach, self.T_tip_body)

    def pose(self, q: np.ndarray) -> np.ndarray:
        """Pose T_world_body (7,) at coordinates q (n,)."""
        slides = len(_SLIDES[self.freedom])
        matrix = np.eye(4)
        matrix[:slides, 3] = q[:slides]
        turns = "Z" if self.freedom == Freedom.PLANAR else "XYZ"
        matrix[:3, :3] = Rotation.from_euler(turns, q[slides:]).as_matrix().reshape(3, 3)
        return multiply(self.T_world_reference, multiply(from_matrix(matrix), self.T_tip_body))

    def coordinates(self, T_world_body: np.ndarray) -> np.ndarray:
        """Coordinates of a pose; inverse of :meth:`pose`.

        Args:
            T_world_body: (7,).

        Returns:
            (n,), with angles in [-pi, pi].

        Raises:
            InputError: the pose of a planar body is outside its plane.
        """
        T = multiply(inverse(self.T_world_reference), multiply(T_world_body, inverse(self.T_tip_body)))
        if self.freedom == Freedom.SPATIAL:
            return np.r_[T[:3], euler_angles(T, "XYZ")]
        matrix = rotation_matrix(T)
        off = max(abs(T[2]), np.abs(matrix[:2, 2]).max(), 1.0 - matrix[2, 2])
        if off > PLANE_TOLERANCE:
            raise InputError(f"free body '{self.name}' is {off:.2g} off its plane; allowed: {PLANE_TOLERANCE:g}")
        return np.r_[T[:2], np.arctan2(matrix[1, 0], matrix[0, 0])]
