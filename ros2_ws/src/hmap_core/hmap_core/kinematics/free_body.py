"""A body that moves by itself, as a chain of joints: so that an object can be a variable of its own."""

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from scipy.spatial.transform import Rotation

from hmap_core.collision.convex import ConvexSet
from hmap_core.exceptions import Code, InputError
from hmap_core.kinematics.branch import Branch
from hmap_core.transforms import IDENTITY, from_matrix, inverse, multiply, rotation_matrix, to_matrix

OFF_PLANE = 1e-6  # m and, for unit vectors, 1: how far a planar body's pose may be from its plane
MAX_PITCH = np.radians(80.0)  # rad: the three turns of a spatial body are singular at 90 degrees
MAX_TURN = 2.0 * np.pi  # rad either way, of the other turns


class Freedom(StrEnum):
    """How a free body moves."""

    PLANAR = "planar"  # x, y along, and a turn about z of its reference
    SPATIAL = "spatial"  # x, y, z along its reference, then turns about the body's x, y and z


# Per freedom, the axes along which it slides and about which it turns, in this order; 0, 1, 2 are x, y, z. The last is
# z, which is the axis of every joint in its own frame, so the last frame is the body's.
_SLIDES = {Freedom.PLANAR: (0, 1), Freedom.SPATIAL: (0, 1, 2)}
_TURNS = {Freedom.PLANAR: (2,), Freedom.SPATIAL: (0, 1, 2)}
_PITCH = 4  # number of the joint of a spatial body that must stay away from a quarter turn


def _z_along(axis: int) -> np.ndarray:
    """A rotation (3, 3) that takes z to x, y or z."""
    return np.roll(np.eye(3), 2 - axis, axis=1)


def extent_of(shapes: ConvexSet, T_tip_body: np.ndarray = IDENTITY) -> float:
    """Radius (m) round the tip's origin of a ball that holds shapes given in the body frame."""
    centers = to_matrix(T_tip_body)[:3, :3] @ shapes.center.T + T_tip_body[:3, None]
    return float((np.linalg.norm(centers, axis=0) + shapes.bound).max(initial=0.0))


@dataclass(frozen=True)
class FreeBody:
    """An object as a serial chain of joints without mass or motor.

    A planar body has the coordinates (x, y, yaw), a spatial one (x, y, z, roll, pitch, yaw) with the rotation
    R_x(roll) R_y(pitch) R_z(yaw): zero at the reference, singular a quarter turn of pitch away from it. So a reference
    near the poses that are expected is far from the singularity.

    Attributes:
        name: of the object.
        freedom: planar or spatial.
        T_world_reference: (7,) where the tip is when all coordinates are zero; a planar body moves in its x-y plane.
        lower, upper: (2,) or (3,) bounds of the position in the reference frame, m.
        extent: no point of the body is farther than this from the tip's origin, m; see :func:`extent_of`.
        T_tip_body: (7,) the body's frame in the last one, such as how it rests on the plane.

    Raises:
        InputError: bounds of the wrong length or order, or a negative extent.
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
        """Its joints as a :class:`KinematicModel` takes them."""
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
        """T_world_body (7,) at the coordinates q (n,)."""
        slides = len(_SLIDES[self.freedom])
        matrix = np.eye(4)
        matrix[:slides, 3] = q[:slides]
        turns = "Z" if self.freedom == Freedom.PLANAR else "XYZ"
        matrix[:3, :3] = Rotation.from_euler(turns, q[slides:]).as_matrix().reshape(3, 3)
        return multiply(self.T_world_reference, multiply(from_matrix(matrix), self.T_tip_body))

    def coordinates(self, T_world_body: np.ndarray) -> np.ndarray:
        """Coordinates (n,) at which the body is at a pose (7,); the turns are within half a turn.

        Raises:
            InputError: a planar body would have to leave its plane.
        """
        T = multiply(inverse(self.T_world_reference), multiply(T_world_body, inverse(self.T_tip_body)))
        if self.freedom == Freedom.SPATIAL:
            return np.r_[T[:3], Rotation.from_quat(T[3:]).as_euler("XYZ")]
        matrix = rotation_matrix(T)
        off = max(abs(T[2]), np.abs(matrix[:2, 2]).max(), 1.0 - matrix[2, 2])
        if off > OFF_PLANE:
            raise InputError(f"free body '{self.name}' is {off:.2g} off its plane; allowed: {OFF_PLANE:g}")
        return np.r_[T[:2], np.arctan2(matrix[1, 0], matrix[0, 0])]
