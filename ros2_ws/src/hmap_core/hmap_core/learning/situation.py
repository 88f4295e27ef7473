"""What of a query matters to the model, in axes that turn and move with the scene."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hmap_core.collision.convex import convex_set
from hmap_core.kinematics.arm import load_arm
from hmap_core.learning.clearance import Boxes
from hmap_core.stability.mass import centre_of_mass
from hmap_core.transforms import IDENTITY, apply, rotation_matrices
from hmap_core.types import AttachedBody, Body, Robot, Scene, SceneState

PLACES = 4  # poses of the object's path that are looked at
FIRST_PLACE = 8  # index of the second of them, unless the path is shorter
FINE = 24  # poses of the path at which the direction of a push is compared
AROUND = 0.45  # m round the object's path in which bodies count
FRICTION_SHARE = 0.7  # of the friction that a push may use, as in hmap_core.contacts.push


@dataclass(frozen=True)
class PathSituation:
    """An object with its path, one robot, and what stands around.

    The axes ``axes`` (rows: away from the robot's shoulder, to the left of that, up) turn with the scene, so nothing
    that is computed in them changes if the whole scene is turned about the vertical or moved.

    Attributes:
        body: the object.
        robot: who moves it; an attached tool is part of it.
        poses: (M, 7) path of the object, world frame.
        boxes: what stands around.
        kinematic: whether contacts carry in any direction.
    """

    body: Body
    robot: Robot
    poses: np.ndarray
    boxes: Boxes
    kinematic: bool

    @staticmethod
    def of(scene: Scene, state: SceneState, object: str, object_poses: np.ndarray, robot: str) -> "PathSituation":
        """The situation of a robot in a scene; a tool that it holds does not stand around."""
        placed, body = scene.robots[robot], scene.bodies[object]
        attached = placed.model.attached
        gone = {object} if attached is None else {object, attached.name}
        others = [(other, state.poses[name]) for name, other in scene.bodies.items() if name not in gone]
        return PathSituation.among(scene, body, placed, object_poses, Boxes.around(others))

    @staticmethod
    def among(scene: Scene, body: Body, robot: Robot, object_poses: np.ndarray, boxes: Boxes) -> "PathSituation":
        """The situation among given boxes."""
        lower, upper = object_poses[:, :3].min(axis=0) - AROUND, object_poses[:, :3].max(axis=0) + AROUND
        return PathSituation(body, robot, object_poses, boxes.near(lower, upper), scene.mode == "kinematic")

    @property
    def attached(self) -> AttachedBody | None:
        """The attached tool."""
        return self.robot.model.attached

    @cached_property
    def own_boxes(self) -> Boxes:
        """The boxes of the object, in its own frame."""
        return Boxes.around([(self.body, IDENTITY)])

    @cached_property
    def shoulder(self) -> np.ndarray:
        """Origin (3,) of the robot's first joint, world frame."""
        return apply(self.robot.base_pose, load_arm(self.robot.model).p_joint[0])

    @cached_property
    def span(self) -> float:
        """The arm's span, m."""
        return load_arm(self.robot.model).span

    @cached_property
    def axes(self) -> np.ndarray:
        """(3, 3) rows: away from the shoulder, left, up; world frame."""
        away = self.poses[0, :2] - self.shoulder[:2]
        away = away / max(float(np.linalg.norm(away)), 1e-9)
        return np.array([[away[0], away[1], 0.0], [-away[1], away[0], 0.0], [0.0, 0.0, 1.0]])

    @cached_property
    def places(self) -> np.ndarray:
        """Indices (PLACES,) of poses: the first, a near one, the middle, the last."""
        last = len(self.poses) - 1
        return np.array([0, min(FIRST_PLACE, last), last // 2, last])

    @cached_property
    def R_places(self) -> np.ndarray:
        """Orientations (PLACES, 3, 3) of the object at the places."""
        return rotation_matrices(self.poses[self.places])

    @cached_property
    def corners(self) -> np.ndarray:
        """Vertices (V, 3) of the object's hulls, object frame; spheres by their middles."""
        return np.ascontiguousarray(convex_set(self.body.shapes).vertices)

    @cached_property
    def centre(self) -> np.ndarray:
        """Centre of mass (3,), object frame."""
        return centre_of_mass(convex_set(self.body.shapes))

    @cached_property
    def extents(self) -> np.ndarray:
        """(2, 3) lower and upper corner of the object at its first pose, in :attr:`axes` about its origin, m."""
        shapes = convex_set(self.body.shapes)
        turned = shapes.vertices @ (self.axes @ self.R_places[0]).T
        radius = float(np.max(shapes.radius))
        return np.array([turned.min(axis=0) - radius, turned.max(axis=0) + radius])

    @cached_property
    def steps(self) -> np.ndarray:
        """Ways (PLACES - 1, 3) of the object between the places, in :attr:`axes`, m."""
        return np.diff(self.poses[self.places, :3], axis=0) @ self.axes.T

    @cached_property
    def turns(self) -> np.ndarray:
        """How far (PLACES - 1,) the object turns about the vertical between the places, rad."""
        R = self.R_places[1:] @ self.R_places[:-1].swapaxes(1, 2)
        return np.arctan2(R[:, 1, 0] - R[:, 0, 1], R[:, 0, 0] + R[:, 1, 1])

    @cached_property
    def pushing(self) -> tuple[np.ndarray, np.ndarray]:
        """Directions (F, 3) in which the object moves, in its own frame, and the shares (F,) of the path where."""
        last = len(self.poses) - 1
        index = np.unique(np.round(np.linspace(0, last, min(last + 1, FINE))).astype(int))
        ways = np.diff(self.poses[index, :3], axis=0)
        lengths = np.linalg.norm(ways, axis=1)
        keep = lengths > 1e-6
        R = rotation_matrices(self.poses[index[:-1]])
        directions = np.einsum("fji,fj->fi", R, ways)[keep] / lengths[keep, None]
        return directions, index[:-1][keep] / max(last, 1)

    def pushed_share(self, normals: np.ndarray) -> np.ndarray:
        """Share (K,) of the path after which pushes against the normals (K, 3), object frame, leave their cones."""
        directions, shares = self.pushing
        if not len(directions):
            return np.ones(len(normals))
        cone = np.cos(np.arctan(FRICTION_SHARE * self.body.friction))
        leaves = -normals @ directions.T < cone
        return np.where(leaves.any(axis=1), shares[leaves.argmax(axis=1)], 1.0)

    @cached_property
    def common(self) -> np.ndarray:
        """Numbers (14 + 4 * (PLACES - 1),) that all contacts of the query share."""
        gripper, size = self.robot.model.gripper, self.extents[1] - self.extents[0]
        widest = 0.0 if gripper is None else gripper.max_opening
        stretch = np.linalg.norm(self.poses[self.places, :3] - self.shoulder, axis=1) / self.span
        height = float(self.poses[0, 2] - self.shoulder[2])
        return np.concatenate(
            [
                [float(self.kinematic), float(self.attached is not None), self.body.friction, self.body.mass],
                [*(10.0 * size), 10.0 * widest, 10.0 * (widest - min(size[0], size[1]))],
                [height, *stretch],
                10.0 * self.steps.ravel(),
                self.turns,
            ]
        )


def tool_points(attached: AttachedBody) -> np.ndarray:
    """The middle of an attached body, and the middles (6, 3) of the faces of its box, end-effector frame: (7, 3)."""
    vertices = convex_set(attached.shapes).vertices
    lower, upper = vertices.min(axis=0), vertices.max(axis=0)
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    own = np.concatenate([[middle], *(middle + side * np.diag(half) for side in (-1.0, 1.0))])
    return apply(attached.T_ee_body, own)
