"""A world that is a little off: friction, masses and poses that differ from those that the planner knows."""

from dataclasses import dataclass, replace

import numpy as np

from hmap_core import transforms
from hmap_core.collision.convex import convex_set, set_distance
from hmap_core.exceptions import InputError
from hmap_core.types import Body, BodyKind, Scene

ALLOWED = "friction=SHARE,mass=SHARE,pose=METRES:DEGREES, such as friction=0.3,mass=0.5,pose=0.002:1"
MOST_SHARE, MOST_OFFSET, MOST_TURN = 0.95, 0.1, 45.0  # of friction and mass; m; deg
TRIES, HALVINGS = 50, 5  # poses that are drawn for a body, and how often their range is halved after that
OVERLAP = 1e-4  # m by which a displaced body may overlap another one, if it did not overlap it more before


@dataclass(frozen=True)
class Perturbation:
    """How far a world is off, at most; each value is drawn uniformly, and for each body by itself.

    Attributes:
        friction: share of the friction coefficients.
        mass: share of the masses.
        position: m, horizontally along each axis.
        rotation: rad, about the vertical.
    """

    friction: float = 0.0
    mass: float = 0.0
    position: float = 0.0
    rotation: float = 0.0

    @classmethod
    def parse(cls, text: str) -> "Perturbation":
        """Reads a perturbation such as ``friction=0.3,mass=0.5,pose=0.002:1``.

        Raises:
            InputError: the text has another form, or a value is out of range.
        """
        values: dict[str, float] = {}
        for part in filter(None, text.split(",")):
            key, _, value = part.partition("=")
            key = key.strip()
            if key == "pose":
                offset, separator, turn = value.partition(":")
                values["position"] = _number(text, key, offset, MOST_OFFSET)
                values["rotation"] = float(np.deg2rad(_number(text, key, turn, MOST_TURN))) if separator else 0.0
            elif key in ("friction", "mass"):
                values[key] = _number(text, key, value, MOST_SHARE)
            else:
                raise InputError(f"perturbation '{text}': '{key}' is not known; needed: {ALLOWED}")
        if not values:
            raise InputError(f"perturbation '{text}' names nothing; needed: {ALLOWED}")
        return cls(**values)

    def apply(self, scene: Scene, seed: int) -> Scene:
        """A scene that is off.

        Bodies stay on their supports, and are displaced into no other body: where there is no room, by less.

        Args:
            scene: as it is known.
            seed: of the random numbers.
        """
        rng = np.random.default_rng(seed)
        bodies = {name: self._weighed(body, rng) for name, body in scene.bodies.items()}
        for name, body in scene.bodies.items():
            if body.kind is not BodyKind.FIXED:
                others = [other for key, other in bodies.items() if key != name]
                bodies[name] = replace(bodies[name], pose=self._displaced(body, others, rng))
        return replace(scene, bodies=bodies)

    def _weighed(self, body: Body, rng: np.random.Generator) -> Body:
        friction, mass = (1.0 + share * rng.uniform(-1.0, 1.0) for share in (self.friction, self.mass))
        return replace(body, friction=friction * body.friction, mass=mass * body.mass)

    def _displaced(self, body: Body, others: list[Body], rng: np.random.Generator) -> np.ndarray:
        """The pose (7,) of a body at a place nearby that is free."""
        if self.position == 0.0 and self.rotation == 0.0:
            return body.pose
        own, around = convex_set(body.shapes), [(convex_set(other.shapes), other.pose) for other in others]
        least = [min(0.0, set_distance(own, body.pose, *other, OVERLAP)) - OVERLAP for other in around]
        for halving in range(HALVINGS + 1):
            for _ in range(TRIES):
                x, y, turn = 0.5**halving * rng.uniform(-1.0, 1.0, 3) * [self.position, self.position, self.rotation]
                about = transforms.pose((0.0, 0.0, 0.0), (0.0, 0.0, np.sin(0.5 * turn), np.cos(0.5 * turn)))
                there = transforms.multiply(about, transforms.pose((0.0, 0.0, 0.0), body.pose[3:]))
                there[:3] = body.pose[:3] + [x, y, 0.0]
                distances = (set_distance(own, there, *other, OVERLAP) for other in around)
                if all(distance >= low for distance, low in zip(distances, least, strict=True)):
                    return there
        return body.pose


def _number(text: str, key: str, value: str, most: float) -> float:
    try:
        number = float(value)
    except ValueError as error:
        raise InputError(f"perturbation '{text}': {key}={value} is no number; needed: {ALLOWED}") from error
    if not 0.0 <= number <= most:
        raise InputError(f"perturbation '{text}': {key}={value}; 0 to {most:g} is allowed")
    return number
