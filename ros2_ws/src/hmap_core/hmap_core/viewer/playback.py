"""The time line: what is shown, when, and what beside it."""

import threading
import time
from collections.abc import Callable
from typing import Any

import viser

from hmap_core.viewer.column import Column, width
from hmap_core.viewer.recording import Recording

PERIOD = 0.05  # s between two pictures while it plays
NOTHING = "nothing"
STEP = 0.01  # s, of the slider
MOST = 12  # recordings that can be chosen; older plans go


class Playback:
    """The folder with the time line, and the columns that it moves.

    Args:
        server: of viser.
        on_text: called with what a thing is that was clicked on.
        on_time: called with the recording and the time (s) that are shown.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        on_text: Callable[[str], None],
        on_time: Callable[[Recording, float], None],
    ):
        self.recordings: dict[str, Recording] = {}
        self.left, self.right = Column(server, "/left", on_text), Column(server, "/right", on_text)
        self._server, self._on_time = server, on_time
        self._lock = threading.RLock()
        self._end = threading.Event()
        gui = server.gui  # whose handles are not typed in a way that a checker could follow
        with gui.add_folder("Time"):
            self._choice: Any = gui.add_dropdown("Show", [NOTHING])
            self._slider: Any = gui.add_slider("Time (s)", 0.0, 1.0, STEP, 0.0)
            self._play: Any = gui.add_button("Play", icon=viser.Icon.PLAYER_PLAY)
            self._follow: Any = gui.add_checkbox("Follow the newest", True, hint="of a run that goes on")
            self._beside: Any = gui.add_dropdown("Beside it", [NOTHING], hint="a second plan or run at the same time")
        self._playing = False
        self._watched = False  # whether a browser was there yet; before, nothing is drawn
        server.on_client_connect(lambda _: self._begin())
        self._choice.on_update(lambda _: self._chosen())
        self._beside.on_update(lambda _: self._chosen())
        self._slider.on_update(lambda event: self._moved(by_user=event.client is not None))
        self._play.on_click(lambda _: self._toggle())
        threading.Thread(target=self._run, name="playback", daemon=True).start()

    def close(self) -> None:
        """End the thread that plays."""
        self._end.set()

    @property
    def recording(self) -> Recording | None:
        """What is shown."""
        return self.recordings.get(self._choice.value)

    @property
    def time(self) -> float:
        """s, that is shown."""
        return float(self._slider.value)

    def add(self, key: str, recording: Recording, show: bool = False) -> None:
        """Add a recording, or replace it.

        Args:
            key: by which people choose it.
            recording: that can still grow; see :meth:`grown`.
            show: show it now.
        """
        with self._lock:
            self.recordings[key] = recording
            plans = [name for name in self.recordings if name.startswith("plan")]
            for name in plans[: max(0, len(self.recordings) - MOST)]:
                if name not in (self._choice.value, self._beside.value):
                    del self.recordings[name]
            names = list(self.recordings)
            shown, beside = self._choice.value, self._beside.value
            self._choice.options, self._beside.options = names, [NOTHING, *names]
            self._choice.value = key if show or shown not in names else shown
            self._beside.value = beside if beside in names else NOTHING
            self._chosen()

    def grown(self, key: str) -> None:
        """A recording has a newer state."""
        with self._lock:
            recording = self.recordings[key]
            if self._choice.value != key:
                return
            self._slider.max = max(round(recording.duration, 2), STEP)
            if self._follow.value and not self._playing:
                self._slider.value = round(recording.duration, 2)

    def redraw(self) -> None:
        """Draw what is shown again."""
        with self._lock:
            recording, beside = self.recording, self.recordings.get(self._beside.value)
            if recording is None or not self._watched:
                return
            t = self.time
            self.left.show(recording, t)
            if beside is None:
                self.right.clear()
                self.left.place(0.0)
            else:
                self.right.show(beside, t)
                shift = 0.5 * max(width(recording.scene), width(beside.scene))
                self.left.place(shift)
                self.right.place(-shift)
            self._on_time(recording, t)

    def set_visible(self, layer: str, visible: bool) -> None:
        """Show or hide a layer in both columns."""
        with self._lock:
            self.left.set_visible(layer, visible)
            self.right.set_visible(layer, visible)

    def _begin(self) -> None:
        """A browser has come."""
        with self._lock:
            first, self._watched = not self._watched, True
            if first:
                self.redraw()

    def _chosen(self) -> None:
        with self._lock:
            recording, beside = self.recording, self.recordings.get(self._beside.value)
            if recording is None:
                return
            duration = max(recording.duration, 0.0 if beside is None else beside.duration)
            self._slider.max = max(round(duration, 2), STEP)
            self._slider.value = min(self.time, self._slider.max)
            self.redraw()

    def _moved(self, by_user: bool) -> None:
        if by_user:
            self._follow.value = False
        self.redraw()

    def _toggle(self) -> None:
        with self._lock:
            self._playing = not self._playing
            if self._playing and self.time >= self._slider.max - STEP:
                self._slider.value = 0.0
            self._show_button()

    def _show_button(self) -> None:
        self._play.label = "Stop playing" if self._playing else "Play"
        self._play.icon = viser.Icon.PLAYER_STOP if self._playing else viser.Icon.PLAYER_PLAY

    def _run(self) -> None:
        before = time.monotonic()
        while not self._end.wait(PERIOD):
            now = time.monotonic()
            with self._lock:
                if self._playing:
                    self._slider.value = round(min(self.time + now - before, self._slider.max), 2)
                    if self.time >= self._slider.max:
                        self._playing = False
                        self._show_button()
            before = now
