"""Where obstacles appear near the path of an object, and how they move on: a world that changes, by a seed.

As in the paper's dynamic scenes: an obstacle appears within 0.3 m of the path and goes on in about six steps, as a tree
of random samples would extend (LaValle, "Rapidly-exploring random trees", 1998).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hmap_core import transforms
from hmap_core.collision.convex import ConvexSet, convex_set, from_hulls, hull_vertices, set_distance
from hmap_core.exceptions import InputError
from hmap_core.kinematics.arm import load_arm
from hmap_core.types import Body, BodyKind, Scene, SceneState, Shape, ShapeKind

REACH = 0.3  # m from the path within which obstacles appear and stay
STEP = 0.05  # m that an obstacle moves at once
ROBOT_DISTANCE = 0.15  # m that obstacles keep from robots, which may be on their way
BODY_DISTANCE = 0.01  # m that they keep from bodies, where the object is, and where it has to go
TRIES = 200  # places that are looked at before it is said that there is none
COLOR = (0.85, 0.2, 0.6, 1.0)

Allowed = Callable[[Body], bool]


@dataclass
class ObstacleSource:
    """Finds free places for spherical obstacles near a path.

    Attributes:
        scene: what stands around, and the goal that stays free.
        path: (M, 7) poses that the object has ahead of it, world frame.
        rng: the only source of randomness.
        allowed: asked last for every place; what it refuses is not used.
    """

    scene: Scene
    path: np.ndarray
    rng: np.random.Generator
    allowed: Allowed = lambda body: True

    def __post_init__(self):
        self.path = np.asarray(self.path, float).reshape(-1, 7)
        if len(self.path) == 0:
            raise InputError("the path near which obstacles appear has 0 poses; at least 1 is needed")

    def appear(self, state: SceneState, name: str, radii: tuple[float, float]) -> Body | None:
        """A new sphere (radius in m uniformly between ``radii``) in a free place; None where none was found.

        Raises:
            InputError: the radii are not positive and increasing.
        """
        if not 0.0 < radii[0] <= radii[1]:
            raise InputError(f"radii of obstacles are {radii} m; needed: 0 < smallest <= largest")
        around = Around(self.scene, state, without=name)
        for _ in range(TRIES):
            radius = float(self.rng.uniform(*radii))
            body = sphere(name, radius, self._near_path())
            if self._fits(around, body):
                return body
        return None

    def move(self, state: SceneState, body: Body) -> Body | None:
        """The obstacle one STEP on towards a random place near the path; None where it cannot go anywhere."""
        around = Around(self.scene, state, without=body.name)
        for _ in range(TRIES):
            way = self._near_path() - body.pose[:3]
            length = float(np.linalg.norm(way))
            if length < STEP:
                continue
            there = sphere(body.name, body.shapes[0].size[0], body.pose[:3] + STEP / length * way)
            if self._distance_to_path(there.pose[:3]) <= REACH and self._fits(around, there):
                return there
        return None

    def _near_path(self) -> np.ndarray:
        """A point (3,) in the upper half of the ball of radius REACH about a random pose of the path."""
        middle = self.path[self.rng.integers(len(self.path)), :3]
        direction = self.rng.normal(size=3)
        direction[2] = abs(direction[2])
        return middle + REACH * self.rng.random() ** (1.0 / 3.0) * direction / np.linalg.norm(direction)

    def _distance_to_path(self, point: np.ndarray) -> float:
        return float(np.linalg.norm(self.path[:, :3] - point, axis=1).min())

    def _fits(self, around: "Around", body: Body) -> bool:
        return around.free(body) and self.allowed(body)


class Around:
    """What an obstacle must not be in: robots, bodies, and the place where the goal's object has to end."""

    def __init__(self, scene: Scene, state: SceneState, without: str = ""):
        """
        Args:
            without: a body that is not looked at.
        """
        bodies = [(body, state.poses.get(name, body.pose)) for name, body in scene.bodies.items() if name != without]
        bodies.append((scene.bodies[scene.goal.object], scene.goal.pose))
        self._bodies = _posed(bodies)
        self._robots = _links(scene, state)

    def free(self, body: Body) -> bool:
        """Whether a body keeps its distances at its pose."""
        own = convex_set(body.shapes)
        return self._far(own, body.pose, self._robots, ROBOT_DISTANCE) and self._far(
            own, body.pose, self._bodies, BODY_DISTANCE
        )

    def _far(self, own: ConvexSet, T: np.ndarray, others: ConvexSet, distance: float) -> bool:
        return len(others) == 0 or set_distance(own, T, others, transforms.IDENTITY, distance) >= distance


def sphere(name: str, radius: float, position: np.ndarray) -> Body:
    """A fixed sphere of a radius (m) at a position (3,) in the world."""
    return Body(name, BodyKind.FIXED, (Shape(ShapeKind.SPHERE, (radius,)),), transforms.pose(position), color=COLOR)


def _posed(bodies: list[tuple[Body, np.ndarray]]) -> ConvexSet:
    hulls = []
    for body, T in bodies:
        for shape in body.shapes:
            points, radius = hull_vertices(shape)
            hulls.append((transforms.apply(T, points), radius))
    return from_hulls(hulls)


def _links(scene: Scene, state: SceneState) -> ConvexSet:
    hulls = []
    for name, robot in scene.robots.items():
        arm = load_arm(robot.model)
        R, p = arm.frames(state.q[name])
        for hull in arm.hulls:
            points = hull.at(state.gripper.get(name, 0.0)) @ R[hull.frame].T + p[hull.frame]
            hulls.append((transforms.apply(robot.base_pose, points), hull.radius))
    return from_hulls(hulls)
