"""Problem and result of Algorithm 2."""

from dataclasses import dataclass, replace

import numpy as np

from hmap_core.exceptions import Code, InputError, WaypointError
from hmap_core.types import Body

# distance to all bodies that the object touches neither at the start nor at the goal, m
DEFAULT_MIN_DISTANCE = 0.002
MOTIONS = ("auto", "planar", "spatial")


@dataclass(frozen=True)
class ObjectPathProblem:
    """Move one body from a start to a goal pose among fixed obstacles.

    ``body.pose`` is not used; obstacles are at their own ``pose``. ``motion`` is "planar" (SE(2): height, roll and
    pitch of the start are kept), "spatial" (SE(3)) or "auto": planar if start and goal allow it, otherwise spatial.
    ``level`` keeps roll and pitch in spatial motion, too; start and goal then have the same.

    Raises:
        InputError: a value is not allowed; INVALID_POSE for a malformed start or goal.
    """

    body: Body
    start: np.ndarray  # T_world_obj (7,)
    goal: np.ndarray  # T_world_obj (7,)
    obstacles: tuple[Body, ...]
    motion: str = "auto"
    min_distance: float = DEFAULT_MIN_DISTANCE  # m
    bounds: np.ndarray | None = None  # (2, 3) lower and upper position of the body, m; None: from the scene
    removable: frozenset[str] = frozenset()  # obstacles that can be moved out of the way; named if they block
    level: bool = False

    def __post_init__(self):
        if self.motion not in MOTIONS:
            raise InputError(f"motion '{self.motion}' is unknown; allowed: {', '.join(MOTIONS)}")
        if not self.min_distance >= 0.0:
            raise InputError(f"min_distance is {self.min_distance}; it must be at least 0 m")
        for name, T in (("start", self.start), ("goal", self.goal)):
            self._check_pose(name, T)
        if any(o.name == self.body.name for o in self.obstacles):
            raise InputError(f"body '{self.body.name}' is among its own obstacles")

    def _check_pose(self, name: str, T: np.ndarray) -> None:
        T = np.asarray(T)
        if T.shape != (7,) or not np.all(np.isfinite(T)) or abs(np.linalg.norm(T[3:]) - 1.0) > QUATERNION_TOLERANCE:
            raise InputError(
                f"{name} pose of '{self.body.name}' is {T.tolist()}; needed: x, y, z and a unit quaternion xyzw",
                Code.INVALID_POSE,
            )

    def without(self, names: set[str] | frozenset[str]) -> "ObjectPathProblem":
        """The same problem without some obstacles."""
        kept = tuple(o for o in self.obstacles if o.name not in names)
        return replace(self, obstacles=kept, removable=self.removable - names)


QUATERNION_TOLERANCE = 1e-4


@dataclass(frozen=True)
class ObjectPath:
    """A path of the object: dense poses, and the waypoints where it changes direction.

    Between two successive poses the body moves as defined by :func:`hmap_core.transforms.interpolate`. The motion was
    checked as a rotation about the middle of the body's largest shape. If the body's frame is elsewhere, the two
    motions differ by 0.1 mm at most. Quaternions do not change sign along the path. If no path with the minimum
    distance exists, the path keeps less; see ``clearance``.
    """

    poses: np.ndarray  # (M, 7) T_world_obj, from the start to the goal
    # (I,) increasing indices into poses, one per waypoint; the last is M - 1, and the start is not included
    cuts: np.ndarray
    clearance: np.ndarray  # (M,) m, distance to bodies touched neither at start nor goal; at most CLEARANCE_CAP
    motion: str  # "planar" or "spatial"

    @property
    def waypoints(self) -> np.ndarray:
        """Poses (I, 7) T_world_obj of the waypoints; the last is the goal."""
        return self.poses[self.cuts]


class NoObjectPath(WaypointError):
    """No path of the object was found.

    Attributes:
        blockers: bodies that block: those on the straight motion, then those that blocked the search, most frequent
            first.
        free_without: the removable bodies whose removal makes a path possible; None if no such set was found.
        path_without: the path that is free without these; None if unknown.
        proven: whether it is proven that no path exists, with the removable bodies in place or without them; otherwise
            the search has ended with its time or its number of motions.
    """

    def __init__(
        self,
        reason: str,
        blockers: tuple[str, ...],
        free_without: tuple[str, ...] | None,
        path_without: ObjectPath | None = None,
        proven: bool = False,
    ):
        super().__init__(reason)
        self.blockers = blockers
        self.free_without = free_without
        self.path_without = path_without
        self.proven = proven
