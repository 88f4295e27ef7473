"""A work cell: a scene builder with the bodies that the families share, and the random numbers for them."""

from collections.abc import Sequence
from typing import Any, Self

import numpy as np

from hmap_core.scenes import SceneBuilder

DIGITS = 4  # of lengths in m: 0.1 mm
TRIES = 2000  # at random for places that keep a distance
BOARD = 0.02  # m, thickness of walls and boards
ORANGE = (0.85, 0.35, 0.15, 1.0)  # of the goal's object

Point = tuple[float, float]


class Sampler:
    """Random numbers, rounded so that a task file is readable."""

    def __init__(self, rng: np.random.Generator):
        """
        Args:
            rng: seeded for the task.
        """
        self.rng = rng

    def uniform(self, low: float, high: float) -> float:
        """A length in m or another number, rounded to 4 digits."""
        return round(float(self.rng.uniform(low, high)), DIGITS)

    def angle(self, low: float = -180.0, high: float = 180.0) -> float:
        """An angle in degrees, rounded to 0.1."""
        return round(float(self.rng.uniform(low, high)), 1)

    def integer(self, low: int, high: int) -> int:
        """A whole number from ``low`` to ``high``, both included."""
        return int(self.rng.integers(low, high + 1))

    def choice(self, options: Sequence[Any]) -> Any:
        """One of the options."""
        return options[int(self.rng.integers(len(options)))]

    def side(self) -> int:
        """-1 or 1."""
        return self.choice((-1, 1))

    def spot(self, radius: Point = (0.40, 0.60), angle: Point = (-45.0, 45.0)) -> Point:
        """A point around the base of a robot at the origin.

        Args:
            radius: m, smallest and largest distance from the base.
            angle: degrees from the x axis, smallest and largest.
        """
        r, a = self.rng.uniform(*radius), np.deg2rad(self.rng.uniform(*angle))
        return round(float(r * np.cos(a)), DIGITS), round(float(r * np.sin(a)), DIGITS)

    def spot_apart(self, taken: Sequence[tuple[Point, float]], **ring: Point) -> Point | None:
        """A point around the base with distances from others.

        Args:
            taken: points, each with the smallest distance from it in m.
            ring: as of :meth:`spot`.

        Returns:
            The point; None if none was found.
        """
        for _ in range(TRIES):
            spot = self.spot(**ring)
            if all(np.hypot(spot[0] - x, spot[1] - y) >= gap for (x, y), gap in taken):
                return spot
        return None


class Cell(SceneBuilder):
    """A scene builder for generated tasks: lengths in m, angles in degrees, bodies given by the place they stand on."""

    def __init__(self, name: str, description: str):
        """
        Args:
            name: of the task.
            description: of the task.
        """
        super().__init__(name, description=description)

    def table(self, length: float = 2.0, width: float = 2.0, x: float = 0.0) -> Self:
        """Add a table top with its upper face at z = 0, around (x, 0)."""
        return self.add_object("table", "table", (x, 0.0, 0.0), values={"length": length, "width": width})

    def panda(self, name: str = "panda", x: float = 0.0, y: float = 0.0, z: float = 0.0, yaw: float = 0.0) -> Self:
        """Add a Panda."""
        return self.robot(name, "panda", x, y, z, yaw)

    def robot(
        self,
        name: str,
        model: str,
        x: float = 0.0,
        y: float = 0.0,
        z: float = 0.0,
        yaw: float = 0.0,
        q: Sequence[float] | None = None,
    ) -> Self:
        """Add a robot of a model, at its home configuration if ``q`` is not given."""
        return self.add_robot(name, model, pose(x, y, z, yaw), q)

    def box(
        self,
        name: str,
        size: Sequence[float],
        at: Sequence[float],
        z: float = 0.0,
        yaw: float = 0.0,
        **options: Any,
    ) -> Self:
        """Add a box that stands at the point ``at`` (2,) on a support of height ``z``; fixed without other options."""
        return self.add_box(name, list(size), pose(at[0], at[1], z + size[2] / 2, yaw), **options)

    def block(
        self, name: str, size: Sequence[float], at: Sequence[float], z: float = 0.0, yaw: float = 0.0, **options: Any
    ) -> Self:
        """Add a movable box that stands at ``at`` on a support of height ``z``."""
        return self.box(name, size, at, z, yaw, **({"movable": True, "mass": 0.2, "friction": 0.7} | options))

    def can(self, name: str, radius: float, height: float, at: Sequence[float], z: float = 0.0, **options: Any) -> Self:
        """Add a movable cylinder that stands at ``at`` on a support of height ``z``."""
        options = {"movable": True, "mass": 0.2, "friction": 0.7} | options
        return self.add_cylinder(name, radius, height, pose(at[0], at[1], z + height / 2), **options)

    def wall(self, name: str, start: Point, end: Point, height: float, z: float = 0.0, thick: float = BOARD) -> Self:
        """Add a fixed wall between two points, which stands on a support of height ``z``."""
        (ax, ay), (bx, by) = start, end
        yaw = float(np.rad2deg(np.arctan2(by - ay, bx - ax)))
        size = [round(float(np.hypot(bx - ax, by - ay)), DIGITS), thick, height]
        return self.box(name, size, ((ax + bx) / 2, (ay + by) / 2), z, yaw)

    def goal(
        self,
        object: str,
        at: Sequence[float],
        z: float,
        rpy: Sequence[float] = (0.0, 0.0, 0.0),
        tolerance: float = 0.005,
        degrees: float = 2.0,
    ) -> Self:
        """Set the goal: the object's frame at (x, y) ``at`` and height ``z``, with tolerances in m and degrees."""
        where = pose(at[0], at[1], z, rpy=rpy)
        turned = min(float(np.deg2rad(degrees)), np.pi)
        return self.set_goal(object, where, position_tolerance=tolerance, rotation_tolerance=turned)


def pose(x: float, y: float, z: float, yaw: float = 0.0, rpy: Sequence[float] | None = None) -> dict[str, Any]:
    """A pose as in a task file; ``rpy`` in degrees, or ``yaw`` alone."""
    place = {"xyz": [round(float(v), DIGITS) for v in (x, y, z)]}
    angles = [round(float(v), 1) for v in (rpy if rpy is not None else (0.0, 0.0, yaw))]
    return place | ({"rpy_deg": angles} if any(angles) else {})
