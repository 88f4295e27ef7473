"""Which pixels of a depth picture show which body, by known shapes and measured poses, without an instance mask."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from hmap.perception.pictures import Picture
from hmap_core.contacts.cloud import back_projected
from hmap_core.kinematics.joint_poses import JointPoses
from hmap_core.trajectory.samples import movable_bodies
from hmap_core.transforms import apply, multiply
from hmap_core.types import Scene, SceneState
from hmap_core.viewer.surfaces import body_surface, link_surfaces

# A measured point belongs to the nearest known surface if that is not farther than this: m, and m for each m of depth.
# Stereo cameras are off by some 1 % of the depth (Keselman et al., "Intel RealSense Stereoscopic Depth Cameras", 2017).
TOLERANCE, TOLERANCE_PER_DEPTH = 0.005, 0.01

Triangles = tuple[np.ndarray, np.ndarray]  # vertices (V, 3) in m, faces (F, 3)


class Segmentation:
    """Labels pictures of a scene's cameras.

    Args:
        scene: the bodies and robots.

    Raises:
        InputError: INVALID_SCENE; a robot description or a mesh cannot be read.
    """

    def __init__(self, scene: Scene):
        self._scene = scene
        self._bodies = {name: body_surface(body) for name, body in scene.bodies.items()}
        self._links = {name: link_surfaces(robot.model) for name, robot in scene.robots.items()}
        self._joints = {name: JointPoses(robot.model) for name, robot in scene.robots.items()}
        self._radius = {
            name: float(np.linalg.norm(vertices, axis=1).max()) for name, (vertices, _) in self._bodies.items()
        }

    def label(self, picture: Picture, state: SceneState) -> Picture:
        """The picture with an instance mask of the bodies that can move; numbers count from 1.

        Points nearer to a fixed body or a robot, and those that are near no known surface, are background.

        Args:
            picture: whose mask is not used.
            state: at the time of the picture.
        """
        names = {name: number for number, name in enumerate(movable_bodies(self._scene), start=1)}
        rows, columns = np.nonzero(np.isfinite(picture.depth) & (picture.depth > 0.0))
        seen = back_projected(picture.depth, rows, columns, picture.intrinsics)
        reach = TOLERANCE + TOLERANCE_PER_DEPTH * seen[:, 2]
        points = apply(picture.camera.pose, seen)
        near = np.zeros(len(points), bool)
        for name in names:
            distance = np.linalg.norm(points - state.poses[name][:3], axis=1)
            near |= distance <= self._radius[name] + reach
        mask = np.zeros(picture.depth.shape, np.int32)
        if near.any():
            surfaces = list(self._placed(state))
            owner, distance = _nearest(points[near], surfaces)
            numbers = np.array([names.get(name, 0) for name, _ in surfaces])
            mask[rows[near], columns[near]] = np.where(distance <= reach[near], numbers[owner], 0)
        return replace(picture, mask=mask, names=names)

    def _placed(self, state: SceneState) -> Iterator[tuple[str, Triangles]]:
        """Every surface in the world frame, with the name of its body; robots have none."""
        for name, (vertices, faces) in self._bodies.items():
            yield name, (apply(state.poses[name], vertices), faces)
        for robot, joints in self._joints.items():
            poses = self._link_poses(robot, joints, state)
            for link, surfaces in self._links[robot].items():
                for surface in surfaces:
                    yield "", (apply(poses[link], surface.vertices), surface.faces)

    def _link_poses(self, robot: str, joints: JointPoses, state: SceneState) -> Mapping[str, np.ndarray]:
        local = joints.fixed | joints.moving(state.q[robot], state.gripper[robot])
        poses = {joints.root: self._scene.robots[robot].base_pose}
        for link, parent in joints.parents.items():
            poses[link] = multiply(poses[parent], local[link])
        return poses


def _nearest(points: np.ndarray, surfaces: list[tuple[str, Triangles]]) -> tuple[np.ndarray, np.ndarray]:
    """Index (N,) of the surface nearest to each point (N, 3), and the distance (N,) to it in m."""
    import open3d as o3d  # slow to import, and not needed where a camera comes with masks

    scene = o3d.t.geometry.RaycastingScene()
    tensor = o3d.core.Tensor.from_numpy
    for _, (vertices, faces) in surfaces:
        scene.add_triangles(tensor(vertices.astype(np.float32)), tensor(faces.astype(np.uint32)))
    closest = scene.compute_closest_points(tensor(points.astype(np.float32)))
    return closest["geometry_ids"].numpy(), np.linalg.norm(closest["points"].numpy() - points, axis=1)
