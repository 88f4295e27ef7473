"""The page: a scene, what is planned and done in it, and buttons. It knows no ROS."""

import threading
import time
from collections.abc import Callable, Mapping
from html import escape
from typing import Any, Literal

import numpy as np
import viser

from hmap_core.exceptions import HmapError
from hmap_core.types import Plan, Scene, SceneState
from hmap_core.viewer import plan_drawing, scene_drawing
from hmap_core.viewer.commands import CONFIRM, PAUSE, RESUME, SPEED, STOP, Commands
from hmap_core.viewer.playback import Playback
from hmap_core.viewer.recording import Recording, of_plan
from hmap_core.viewer.search_html import live_search, search_html

RUN = "this run"
LONGEST = 3600.0  # s of a run that are kept
LIVE_PERIOD = 0.2  # s between two states that are drawn while a run goes on
MOST_STEPS = 500  # of a search that is going on
ABSENT = "the supervisor offers no {name}"
ICONS = {
    PAUSE: viser.Icon.PLAYER_PAUSE,
    RESUME: viser.Icon.PLAYER_PLAY,
    CONFIRM: viser.Icon.CHECK,
    STOP: viser.Icon.HAND_STOP,
}
COLORS: dict[str, Literal["green", "red"]] = {CONFIRM: "green", STOP: "red"}
HIDDEN = ("cameras",)  # layers that are not shown at first


class Page:
    """The page in the browser.

    Args:
        server: of viser (:func:`hmap_core.viewer.server.open_server`).
        commands: of the buttons; None: there are none, as for a plan file.
    """

    def __init__(self, server: viser.ViserServer, commands: Commands | None = None):
        self.server, self._commands = server, commands
        self._lock = threading.RLock()
        self._run: Recording | None = None
        self._drawn = 0.0  # when a state was drawn last, s of the steady clock
        self._plans = 0
        self._steps: list[tuple[int, int, int, str]] = []
        self._final: Mapping[str, Any] | None = None  # the search tree of a search that has ended
        self._shown_search: Mapping[str, Any] | None = None
        gui = server.gui
        self._status = gui.add_html(_line("starting"))
        if commands is not None:
            self._add_buttons(commands)
        self.playback = Playback(server, self.tell, self._show_time)
        with gui.add_folder("Layers", expand_by_default=False):
            for layer in (*plan_drawing.LAYERS, *scene_drawing.LAYERS):
                self._add_layer(layer)
        with gui.add_folder("On request"):
            about = "grows RRT-Connect trees for the object of the plan that is shown, without robots"
            tree = gui.add_button("RRT tree", icon=viser.Icon.BINARY_TREE, hint=about)
            about = (
                "samples contacts where the plan makes its contacts, and checks them; a click says why one is refused"
            )
            refused = gui.add_button("Refused contacts", icon=viser.Icon.HAND_OFF, hint=about)
        self._about = gui.add_html(_line("click on a waypoint or a contact: what it is stands here"))
        with gui.add_folder("Algorithm 1"):
            self._search = gui.add_html(search_html(None))
        tree.on_click(lambda _: self._on_request(tree, self._draw_tree))
        refused.on_click(lambda _: self._on_request(refused, self._draw_refused))

    def close(self) -> None:
        """Stop the server."""
        self.playback.close()
        self.server.stop()

    # what is shown

    def add_recording(self, recording: Recording) -> None:
        """Add something that can be played, and show it."""
        self.playback.add(recording.name, recording, show=True)
        self._status.content = _line(f"{recording.name}: {recording.duration:.1f} s")

    def set_scene(self, scene: Scene) -> None:
        """The graph has loaded a scene; a run of another task ends."""
        with self._lock:
            run = self._run
            if run is not None and (run.scene.task, run.scene.seed) == (scene.task, scene.seed):
                run.scene = scene
            else:
                self._run = Recording(RUN, scene)
                if self._commands is not None:
                    if scene.task not in self._task.options:
                        self._task.options = [scene.task, *self._task.options]
                    self._task.value, self._seed.value = scene.task, scene.seed
                self.playback.add(RUN, self._run, show=True)

    def add_state(self, stamp: float, state: SceneState) -> None:
        """The graph has measured a state at a time (s)."""
        with self._lock:
            run = self._run
            if run is None:
                return
            began = run.began
            if began is None or stamp < began or run.duration > LONGEST:
                began = stamp
                run.restart(stamp)
            run.add(stamp - began, state)
            now = time.monotonic()
            if now - self._drawn > LIVE_PERIOD and self.server.get_clients():
                self._drawn = now
                self.playback.grown(RUN)

    def set_plan(self, plan: Plan) -> None:
        """The graph has a new plan."""
        with self._lock:
            self._plans += 1
            name = f"plan {self._plans}: {plan.scene.task}, seed {plan.scene.seed}"
            self.playback.add(name, of_plan(plan, name))
            if self._run is not None:
                now = self._run.duration
                self._run.plans.append((now, plan))
                search = plan.stats.get("search")
                if isinstance(search, dict):
                    self._run.searches.append((now, search))
                    self._final = search
                self.playback.redraw()

    def set_clouds(self, clouds: Mapping[str, np.ndarray]) -> None:
        """What the cameras see: object -> points (N, 3), world frame, m."""
        with self._lock:
            if self._run is not None:
                self._run.clouds.append((self._run.duration, clouds))
                self.playback.redraw()

    def set_status(self, phase: str, text: str, waypoint: int = 0, waypoints: int = 0, attempt: int = 0) -> None:
        """The graph is in a phase of a goal."""
        with self._lock:
            line = f"{phase}: {text}" if text else phase
            self._status.content = _line(line)
            if self._run is not None:
                self._run.captions.append((self._run.duration, line))
            if phase in ("loading", "waypoints") and not waypoints:
                self._steps, self._final = [], None
            if phase in ("waypoints", "contacts", "motion"):
                self._steps = [*self._steps[-MOST_STEPS:], (waypoint, waypoints, attempt, text)]
            self._show_search(phase)

    def set_search(self, search: Mapping[str, Any]) -> None:
        """What was tried until now, as a tree with reasons."""
        with self._lock:
            self._final = search
            self._show_search("")

    def tell(self, text: str) -> None:
        """Say what was clicked on, or what was answered."""
        self._about.content = _line(text)

    def refresh(self) -> None:
        """Enable the buttons that somebody listens to."""
        if self._commands is None:
            return
        available = self._commands.available()
        for name, widget in self._optional.items():
            missing = name not in available
            if widget.disabled != missing:
                widget.disabled = missing
                widget.hint = ABSENT.format(name=name) if missing else None

    # inside

    def _add_buttons(self, commands: Commands) -> None:
        gui = self.server.gui
        with gui.add_folder("Task"):
            self._task: Any = gui.add_dropdown("Task", commands.tasks() or [""])
            self._seed: Any = gui.add_number("Seed", 0, min=0, max=2**31 - 1, step=1)
            plan = gui.add_button("Plan", icon=viser.Icon.ROUTE, hint="plan the task, and move nothing")
            execute = gui.add_button("Execute", icon=viser.Icon.PLAYER_PLAY, hint="plan the task, and execute the plan")
            cancel = gui.add_button("Cancel", icon=viser.Icon.X, hint="end the goal; the robots stop")
            replan = gui.add_button("Replan", icon=viser.Icon.REFRESH, hint="plan and execute anew from here")
            services: dict[str, Any] = {}
            for name, icon in ICONS.items():
                color = COLORS.get(name)
                services[name] = gui.add_button(
                    name.capitalize(), icon=icon, color=color, disabled=True, hint=ABSENT.format(name=name)
                )
            speed = gui.add_slider("Speed", 0.05, 1.0, 0.05, 1.0, disabled=True, hint=ABSENT.format(name=SPEED))
        self._optional: dict[str, Any] = services | {SPEED: speed}
        plan.on_click(lambda _: self._try(lambda: commands.start(self._task.value, int(self._seed.value), True)))
        execute.on_click(lambda _: self._try(lambda: commands.start(self._task.value, int(self._seed.value), False)))
        cancel.on_click(lambda _: self._try(commands.cancel))
        replan.on_click(lambda _: self._try(commands.replan))
        for name, button in services.items():
            button.on_click(self._calling(commands, name))
        speed.on_update(lambda event: self._try(lambda: commands.set_speed(float(event.target.value))))

    def _calling(self, commands: Commands, name: str) -> Callable[[Any], None]:
        return lambda _: self._try(lambda: commands.call(name))

    def _try(self, command: Callable[[], Any]) -> None:
        """Give a command, and say what came of it."""
        try:
            answer = command()
        except HmapError as error:
            self.tell(str(error))
        else:
            if answer:
                self.tell(str(answer))

    def _add_layer(self, layer: str) -> None:
        shown = layer not in HIDDEN
        box = self.server.gui.add_checkbox(layer, shown)
        self.playback.set_visible(layer, shown)
        box.on_update(lambda _: self.playback.set_visible(layer, bool(box.value)))

    def _show_time(self, recording: Recording, t: float) -> None:
        if self._commands is None or recording is not self._run:
            self._status.content = _line(f"{recording.name}, {t:.2f} s: {recording.caption(t)}")
        search = recording.search(t)
        if search is not None and search is not self._shown_search and recording is not self._run:
            self._shown_search = search
            self._search.content = search_html(search)

    def _show_search(self, phase: str) -> None:
        search = self._final
        if search is None:
            search = live_search(self._steps, phase) if self._steps else None
        if search is not self._shown_search:
            self._shown_search = search
            self._search.content = search_html(search)

    def _on_request(self, button: viser.GuiButtonHandle, draw) -> None:
        plan = self.playback.left.plan
        if plan is None:
            self.tell("there is no plan yet")
            return
        button.disabled = True
        try:
            draw(plan)
        except HmapError as error:
            self.tell(str(error))
        finally:
            button.disabled = False

    def _draw_tree(self, plan: Plan) -> None:
        from hmap_core.viewer.on_request import object_trees  # slow to import, and seldom needed

        trees = object_trees(plan)
        drawing = self.playback.left.plan_drawing
        if drawing is not None:
            drawing.show_tree(trees.edges)
        self.tell(trees.text)

    def _draw_refused(self, plan: Plan) -> None:
        from hmap_core.viewer.on_request import refused_contacts  # slow to import, and seldom needed

        self.tell("checking contacts ...")
        found = refused_contacts(plan)
        drawing = self.playback.left.plan_drawing
        if drawing is not None:
            drawing.show_refused(found)
        self.tell(f"{len(found)} refused contacts; a click on one says why")


def _line(text: str) -> str:
    return f'<div class="hmap-line" style="padding: 4px 8px; font-size: 13px;">{escape(text)}</div>'
