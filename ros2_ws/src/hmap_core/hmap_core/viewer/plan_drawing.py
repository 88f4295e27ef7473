"""A plan in viser: the object's path with ghosts, waypoints red, contacts yellow, what was refused dark."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import viser

from hmap_core.trajectory.samples import index_at
from hmap_core.transforms import IDENTITY, multiply
from hmap_core.types import Plan, SegmentKind
from hmap_core.viewer.scene_drawing import frame, mesh
from hmap_core.viewer.surfaces import Surface, body_surface

RED, YELLOW, REFUSED, PATH, GHOST = (220, 30, 30), (255, 209, 13), (120, 40, 110), (220, 90, 30), (150, 150, 155)
WAYPOINT_RADIUS, CONTACT_RADIUS, REFUSED_RADIUS = 0.014, 0.014, 0.007  # m
GHOST_OPACITY = 0.18
GHOSTS = 8  # of the object along its path, at most, beside those at waypoints
PATH_WIDTH, TREE_WIDTH = 0.004, 0.0015  # m

LAYERS = ("path", "ghosts", "waypoints", "contacts", "refused", "search tree")

LAYERS = ("path", "ghosts", "waypoints", "contacts", "refused", "search tree")

OnText = Callable[[str], None]


@dataclass(frozen=True)
class ContactMark:
    """A contact of a plan, for people.

    Attributes:
        at: (3,) where it is made, world frame, m.
        text: which it is.
        start: s, when it begins.
    """

    at: np.ndarray
    text: str
    start: float


def contact_marks(plan: Plan) -> list[ContactMark]:
    """The contacts that a plan makes, in the order of time."""
    marks = []
    for segment in plan.segments:
        if segment.kind is SegmentKind.TRANSIT or segment.object is None or segment.contact_pose is None:
            continue
        k = index_at(plan.trajectory.time, segment.start)
        T = multiply(plan.trajectory.objects[segment.object][k], segment.contact_pose)
        text = f"{segment.robot}: {segment.kind} of '{segment.object}' by {segment.manipulator}"
        marks.append(ContactMark(T[:3], f"{text}, {segment.start:.1f} to {segment.end:.1f} s (chosen)", segment.start))
    return marks


def ghost_poses(plan: Plan, most: int = GHOSTS) -> np.ndarray:
    """Poses (G, 7) of the goal's object along its path, evenly spaced by what it has moved."""
    poses = plan.trajectory.objects.get(plan.scene.goal.object)
    if poses is None or len(poses) < 2:
        return np.zeros((0, 7))
    turns = 0.1 * np.abs(np.diff(poses[:, 3:], axis=0)).sum(axis=1)  # a turn counts as the way of a point 10 cm off
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1) + turns)])
    if way[-1] == 0.0:
        return poses[:1]
    return poses[np.searchsorted(way, np.linspace(0.0, way[-1], most)).clip(0, len(poses) - 1)]


class PlanDrawing:
    """A plan below one node of the page.

    Args:
        api: of viser.
        name: of the node.
        plan: the plan.
        on_text: called with what a thing is that was clicked on.

    Attributes:
        layers: nodes that can be hidden, by the names in :data:`LAYERS`.
    """

    def __init__(self, api: viser.SceneApi, name: str, plan: Plan, on_text: OnText = lambda text: None):
        self._api, self._name, self._on_text = api, name, on_text
        self._refused: list[viser.SceneNodeHandle] = []
        self.root = frame(api, name, IDENTITY)
        self.layers = {layer: frame(api, f"{name}/{layer}", IDENTITY).handle for layer in LAYERS}
        goal = plan.scene.goal.object
        self._draw_path(plan.trajectory.objects.get(goal))
        surface = Surface(*body_surface(plan.scene.bodies[goal]), GHOST, GHOST_OPACITY)
        for k, T in enumerate(ghost_poses(plan)):
            frame(api, f"{name}/ghosts/{k}", T)
            mesh(api, f"{name}/ghosts/{k}/surface", surface)
        for k, T in enumerate(np.asarray(plan.waypoints).reshape(-1, 7)):
            text = f"waypoint {k + 1} of {len(plan.waypoints)} of '{goal}'"
            self._ball(f"waypoints/{k}", T[:3], WAYPOINT_RADIUS, RED, text)
        for k, mark in enumerate(contact_marks(plan)):
            self._ball(f"contacts/{k}", mark.at, CONTACT_RADIUS, YELLOW, mark.text)
            self._label(f"contacts/{k}/chosen", f"contact {k + 1}")

    def remove(self) -> None:
        """Remove it from the page."""
        self.root.handle.remove()

    def show_refused(self, contacts: Sequence[tuple[np.ndarray, str]]) -> None:
        """Draw contacts that were refused: where (3,), and why, which is told on a click."""
        for old in self._refused:
            old.remove()
        self._refused.clear()
        for k, (at, reason) in enumerate(contacts):
            self._refused.append(self._ball(f"refused/{k}", at, REFUSED_RADIUS, REFUSED, reason))

    def show_tree(self, edges: np.ndarray) -> None:
        """Draw a search tree of the object's path: edges (E, 2, 3) between positions, world frame, m."""
        self._api.add_line_segments(
            f"{self._name}/search tree/edges",
            np.asarray(edges, np.float32),
            colors=(60, 110, 200),
            thickness=TREE_WIDTH,
        )

    def _draw_path(self, poses: np.ndarray | None) -> None:
        if poses is None or len(poses) < 2:
            return
        points = np.asarray(poses[:, :3], np.float32)
        moved = np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6
        segments = np.stack([points[:-1], points[1:]], axis=1)[moved]
        if len(segments):
            self._api.add_line_segments(f"{self._name}/path/line", segments, colors=PATH, thickness=PATH_WIDTH)

    def _label(self, name: str, text: str) -> None:
        self._api.add_label(
            f"{self._name}/{name}", text, font_size_mode="screen", font_screen_scale=0.7, depth_test=False
        )

    def _ball(
        self, name: str, at: np.ndarray, radius: float, color: tuple[int, int, int], text: str
    ) -> viser.SceneNodeHandle:
        """A ball that says what it is on a click."""
        ball = self._api.add_icosphere(
            f"{self._name}/{name}",
            radius=radius,
            color=color,
            position=(float(at[0]), float(at[1]), float(at[2])),
            cast_shadow=False,
            receive_shadow=False,
        )
        ball.on_click(lambda _: self._on_text(text))
        return ball
