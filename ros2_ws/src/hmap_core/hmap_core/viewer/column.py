"""One recording on the page: its scene, and the plan that is followed. Two columns stand side by side."""

from collections.abc import Callable

import numpy as np
import viser

from hmap_core.transforms import IDENTITY
from hmap_core.types import BodyKind, Plan, Scene
from hmap_core.viewer.plan_drawing import PlanDrawing
from hmap_core.viewer.recording import Clouds, Recording
from hmap_core.viewer.scene_drawing import SceneDrawing

GAP = 0.4  # m between two columns
LARGEST = 4.0  # m; bodies that reach farther do not count for the distance between columns


class Column:
    """Draws a recording at a time.

    Args:
        server: of viser.
        name: of the node.
        on_text: called with what a thing is that was clicked on.
    """

    def __init__(self, server: viser.ViserServer, name: str, on_text: Callable[[str], None]):
        self._server, self._api, self._name, self._on_text = server, server.scene, name, on_text
        self._drawing: SceneDrawing | None = None
        self._plan: Plan | None = None
        self._plan_drawing: PlanDrawing | None = None
        self._offset = IDENTITY
        self._visible: dict[str, bool] = {}
        self._clouds: Clouds | None = None

    @property
    def plan(self) -> Plan | None:
        """The plan that is drawn."""
        return self._plan

    @property
    def plan_drawing(self) -> PlanDrawing | None:
        """Its drawing."""
        return self._plan_drawing

    def show(self, recording: Recording, t: float) -> None:
        """Draw a recording at a time (s)."""
        scene, state, plan, clouds = recording.scene, recording.state(t), recording.plan(t), recording.cloud(t)
        with self._server.atomic():
            if self._drawing is None or self._drawing.scene is not scene:
                self.clear()
                self._drawing = SceneDrawing(self._api, self._name, scene)
                self._drawing.root.place(self._offset)
            self._drawing.show(state)
            if clouds is not self._clouds:
                self._clouds = clouds
                self._drawing.show_clouds(clouds)
            if plan is not self._plan:
                if self._plan_drawing is not None:
                    self._plan_drawing.remove()
                self._plan = plan
                self._plan_drawing = (
                    None if plan is None else PlanDrawing(self._api, f"{self._name}/plan", plan, self._on_text)
                )
            self._apply_visible()

    def set_visible(self, layer: str, visible: bool) -> None:
        """Show or hide a layer of the scene or of the plan, now and later."""
        self._visible[layer] = visible
        self._apply_visible()

    def place(self, y: float) -> None:
        """Move it to the side by y (m)."""
        self._offset = np.array([0.0, y, 0.0, 0.0, 0.0, 0.0, 1.0])
        if self._drawing is not None:
            self._drawing.root.place(self._offset)

    def clear(self) -> None:
        """Remove everything."""
        if self._drawing is not None:
            self._drawing.remove()
        self._drawing = self._plan_drawing = self._plan = self._clouds = None

    def _apply_visible(self) -> None:
        for drawing in (self._drawing, self._plan_drawing):
            for layer, node in {} if drawing is None else drawing.layers.items():
                wanted = self._visible.get(layer, True)
                if node.visible != wanted:
                    node.visible = wanted


def width(scene: Scene) -> float:
    """How far a scene reaches along y, with a gap, m."""
    points = [robot.base_pose[1] for robot in scene.robots.values()]
    for body in scene.bodies.values():
        radius = max((max(shape.size) for shape in body.shapes if shape.mesh is None), default=0.1)
        if body.kind is not BodyKind.FIXED or radius < LARGEST:
            points += [body.pose[1] - radius / 2.0, body.pose[1] + radius / 2.0]
    return float(max(points) - min(points)) + GAP if points else GAP
