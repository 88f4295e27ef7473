"""A scene in viser: robots with their meshes, bodies, the goal, cameras and what they see."""

from collections.abc import Mapping

import numpy as np
import viser

from hmap_core.kinematics.joint_poses import JointPoses
from hmap_core.transforms import IDENTITY
from hmap_core.types import BodyKind, Camera, Robot, Scene, SceneState
from hmap_core.viewer.surfaces import Surface, body_surface, link_surfaces

COLORS = {BodyKind.FIXED: (184, 184, 189), BodyKind.MOVABLE: (51, 115, 204), BodyKind.TOOL: (217, 153, 51)}
GREEN = (26, 158, 64)
GOAL_OPACITY = 0.3
CLOUD_COLOR = (20, 160, 170)
POINT_SIZE = 0.003  # m
CAMERA_SIZE = 0.08  # m
LAYERS = ("goal", "cameras", "clouds")
MOVED = 1e-5  # m or 1; smaller changes of a pose are not sent


def wxyz(T: np.ndarray) -> tuple[float, float, float, float]:
    """The quaternion of a pose (7,) in viser's order."""
    x, y, z, w = (float(number) for number in T[3:])
    return w, x, y, z


def position(T: np.ndarray) -> tuple[float, float, float]:
    """The position of a pose (7,)."""
    x, y, z = (float(number) for number in T[:3])
    return x, y, z


class Placed:
    """A node of the scene that is sent a pose only where it has moved."""

    def __init__(self, handle: viser.SceneNodeHandle, T: np.ndarray):
        self.handle, self._T = handle, np.array(T, float)

    def place(self, T: np.ndarray) -> None:
        """Move it to a pose (7,) in its parent."""
        if np.abs(T - self._T).max() <= MOVED:
            return
        self._T = np.array(T, float)
        self.handle.position = position(T)
        self.handle.wxyz = wxyz(T)


def frame(api: viser.SceneApi, name: str, T: np.ndarray) -> Placed:
    """A frame without axes at a pose (7,) in its parent."""
    return Placed(api.add_frame(name, show_axes=False, wxyz=wxyz(T), position=position(T)), T)


def mesh(api: viser.SceneApi, name: str, surface: Surface) -> viser.MeshHandle:
    """Triangles with flat shading, in the frame of their parent."""
    opacity = None if surface.opacity >= 1.0 else surface.opacity
    return api.add_mesh_simple(
        name,
        surface.vertices,
        surface.faces,
        color=surface.color,
        opacity=opacity,
        flat_shading=True,
        side="double",
        cast_shadow=False,
        receive_shadow=False,
    )


class RobotDrawing:
    """A robot: each link is a child of the link before, so that a configuration is a few poses.

    Args:
        api: of viser.
        name: of the node.
        robot: the robot.

    Raises:
        InputError: INVALID_SCENE; its description cannot be read.
    """

    def __init__(self, api: viser.SceneApi, name: str, robot: Robot):
        self._joints = JointPoses(robot.model)
        surfaces = link_surfaces(robot.model)
        opening = robot.model.gripper.open_opening if robot.model.gripper else 0.0
        start = self._joints.fixed | self._joints.moving(robot.q, opening)
        paths = {self._joints.root: name}
        frame(api, name, robot.base_pose)
        self._links = {}
        for link, parent in self._joints.parents.items():
            paths[link] = f"{paths[parent]}/{link}"
            self._links[link] = frame(api, paths[link], start[link])
        for link, path in paths.items():
            for k, surface in enumerate(surfaces.get(link, ())):
                mesh(api, f"{path}/surface_{k}", surface)

    def show(self, q: np.ndarray, opening: float) -> None:
        """Move it to a configuration (n,) with an opening of its gripper in m."""
        for link, T in self._joints.moving(q, opening).items():
            self._links[link].place(T)


class SceneDrawing:
    """A scene below one node.

    Args:
        api: of viser.
        name: of the node, such as "/scene"; it may be moved.
        scene: the scene.

    Attributes:
        root: the node.
        layers: nodes that can be hidden, by the names in :data:`LAYERS`.

    Raises:
        InputError: INVALID_SCENE; a robot or a mesh cannot be read.
    """

    def __init__(self, api: viser.SceneApi, name: str, scene: Scene):
        self.scene = scene
        self._api, self._name = api, name
        self.root = frame(api, name, IDENTITY)
        self._robots = {key: RobotDrawing(api, f"{name}/robots/{key}", robot) for key, robot in scene.robots.items()}
        self._bodies = {}
        for key, body in scene.bodies.items():
            color, opacity = COLORS[body.kind], 1.0
            if body.color is not None:
                r, g, b = (round(255 * number) for number in body.color[:3])
                color, opacity = (r, g, b), float(body.color[3])
            self._bodies[key] = frame(api, f"{name}/bodies/{key}", body.pose)
            mesh(api, f"{name}/bodies/{key}/surface", Surface(*body_surface(body), color, opacity))
        self.layers = {layer: frame(api, f"{name}/{layer}", IDENTITY).handle for layer in LAYERS}
        self._draw_goal()
        for key, camera in scene.cameras.items():
            self._draw_camera(key, camera)
        self._clouds: dict[str, viser.PointCloudHandle] = {}

    def remove(self) -> None:
        """Remove it from the page."""
        self.root.handle.remove()

    def show(self, state: SceneState) -> None:
        """Move everything to a state; bodies and robots that are not in the scene are left out."""
        for name, robot in self._robots.items():
            if name in state.q:
                robot.show(state.q[name], state.gripper.get(name, 0.0))
        for name, body in self._bodies.items():
            if name in state.poses:
                body.place(state.poses[name])

    def show_clouds(self, clouds: Mapping[str, np.ndarray]) -> None:
        """Draw what cameras see: object -> points (N, 3) in the world frame, m."""
        for name in self._clouds.keys() - clouds.keys():
            self._clouds.pop(name).remove()
        for name, points in clouds.items():
            self._clouds[name] = self._api.add_point_cloud(
                f"{self._name}/clouds/{name}", np.asarray(points, np.float32), CLOUD_COLOR, point_size=POINT_SIZE
            )

    def _draw_goal(self) -> None:
        goal = self.scene.goal
        body = self.scene.bodies.get(goal.object)
        if body is None:
            return
        frame(self._api, f"{self._name}/goal/object", goal.pose)
        surface = Surface(*body_surface(body), GREEN, GOAL_OPACITY)
        mesh(self._api, f"{self._name}/goal/object/surface", surface)

    def _draw_camera(self, name: str, camera: Camera) -> None:
        self._api.add_camera_frustum(
            f"{self._name}/cameras/{name}",
            fov=float(camera.fov_y),
            aspect=camera.width / camera.height,
            scale=CAMERA_SIZE,
            color=CLOUD_COLOR,
            wxyz=wxyz(camera.pose),
            position=position(camera.pose),
        )
