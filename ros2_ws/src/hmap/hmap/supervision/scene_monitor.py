"""What the supervisor knows of the world: the scene, the newest state, the clouds; with waiting for news."""

import threading
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hmap.conversions import bodies_from_message, cloud_from_message, scene_from_message, state_from_message
from hmap.node import LATCHED, HmapNode, clock_time
from hmap.problem_log import ProblemLog
from hmap_core import transforms
from hmap_core.contacts.camera import Cloud
from hmap_core.exceptions import Code, InputError, PlannerError
from hmap_core.stability.supports import on_supports
from hmap_core.types import Body, BodyKind, Scene, SceneState
from hmap_msgs.msg import BodyArray, ObjectClouds, WorldState
from hmap_msgs.msg import Scene as SceneMessage
from hmap_msgs_py.checks import ConversionError, frame
from hmap_msgs_py.measurements import Latest, ReceiverClock
from hmap_msgs_py.times import seconds_from_message
from hmap_msgs_py.world import WORLD_FRAME

REST_PERIOD = 0.2  # s between two looks at what is coming to rest, of the sensors' clock
REST_DISTANCE, REST_ANGLE = 5e-4, 0.01  # m, rad that a body moves in that period; less counts as at rest
REST_JOINT = 2e-3  # rad that a joint moves in it
REST_LOOKS = 15  # looks at most
AHEAD = 5.0  # s that a state may be stamped ahead of the node's clock; /clock comes late while the node is busy
CLOCK_STANDS = 0.1  # s that a clock goes on since the last state while a simulation pauses
CLOUDS_AHEAD = 60.0  # s, the same for clouds, which come rarely, so that each of them counts


class SceneMonitor:
    """Follows ``scene``, ``new_object``, ``world_state`` and ``object_clouds``."""

    def __init__(
        self,
        node: HmapNode,
        stale_after: float,
        noise: float = 0.0,
        clock_died: Callable[[], bool] = lambda: False,
    ):
        """
        Args:
            stale_after: s; a state that arrived longer ago is none.
            noise: m, standard deviation of measured positions, see :mod:`hmap_core.stability.supports`.
            clock_died: whether the node that publishes the clock has died, so that a clock that stands means nothing.
        """
        self._clock_died = clock_died
        self._node, self._stale_after, self._noise = node, stale_after, noise
        self._news = threading.Condition()
        self._base: Scene | None = None  # as `scene` tells
        self._text = ""  # of it
        self._seen: dict[str, Body] = {}  # what only the cameras tell of
        self._scene: Scene | None = None  # both together
        self._changed = 0.0  # when the bodies changed last, on the steady clock
        self._listeners: list[Callable[[], None]] = []
        self._clock = ReceiverClock(lambda: clock_time(node), AHEAD)
        self._states: Latest[SceneState] = Latest("the world state", self._clock)
        self._arrived = -float("inf")  # when the newest state did, on the steady clock
        self._arrived_at: float | None = None  # the same, s of the node's clock
        self._cloud_clock = ReceiverClock(lambda: clock_time(node), CLOUDS_AHEAD)
        self._cloud_messages: Latest[ObjectClouds] = Latest("the message of the objects' clouds", self._cloud_clock)
        self._decoded_message: ObjectClouds | None = None
        self._clouds: dict[str, Cloud] = {}  # of that message
        self._problems = ProblemLog(
            lambda text: node.get_logger().warning(text),
            lambda text: node.get_logger().info(text),
        )
        node.subscribe(SceneMessage, "scene", self._take_scene, LATCHED)
        node.subscribe(WorldState, "world_state", self._take_state)
        node.subscribe(BodyArray, "new_object", self._take_new, LATCHED)
        node.subscribe(ObjectClouds, "object_clouds", self._take_clouds, LATCHED)

    def scene(self, patience: float = 0.0) -> Scene | None:
        """The loaded scene, if one is published within ``patience`` seconds."""
        with self._news:
            self._wait(lambda: self._scene is not None, time.monotonic() + patience)
            return self._scene

    def changed(self) -> float:
        """When bodies came, moved otherwise than by themselves, or went for the last time: s of the steady clock."""
        with self._news:
            return self._changed

    def on_change(self, listener: Callable[[], None]) -> None:
        """Call a function, which must not wait, whenever the bodies change."""
        with self._news:
            self._listeners.append(listener)

    def wait_for_change(self, since: float, patience: float, canceled: Callable[[], bool]) -> bool:
        """Wait until the bodies have changed after ``since`` (s of the steady clock); whether they did in time."""
        with self._news:
            self._wait(lambda: self._changed > since or canceled(), time.monotonic() + patience)
            return self._changed > since

    def clouds(self) -> dict[str, Cloud]:
        """What has been seen of each object."""
        with self._news:
            self._cloud_clock.now()
            newest = self._cloud_messages.newest()
            if newest is not None and newest[1] is not self._decoded_message:
                self._decoded_message = newest[1]
                self._clouds = self._decoded(newest[1])
            return dict(self._clouds)

    def _decoded(self, message: ObjectClouds) -> dict[str, Cloud]:
        """Clouds by object; malformed ones are named in the log and left out."""
        found, problems = {}, []
        for entry in message.clouds:
            try:
                cloud = cloud_from_message(entry)
                if entry.object in found:
                    raise ConversionError(f"there are two clouds of {entry.object!r}; the first one is used")
            except ConversionError as error:
                problems.append(str(error))
                continue
            if cloud is not None:
                found[entry.object] = cloud
        self._problems.update("object_clouds", problems)
        return found

    def silent(self) -> bool:
        """Whether no state has arrived for too long. While the node's clock stands, nothing moves, and none is due.

        Where the node that publishes the clock has died, none counts.
        """
        with self._news:
            return self._silent()

    def _silent(self) -> bool:
        if self._clock_died():  # perception repeats the last measurement, which is as old as the clock that stands
            return True
        if time.monotonic() - self._arrived <= self._stale_after:
            return False
        now = clock_time(self._node)
        return now is None or self._arrived_at is None or abs(now - self._arrived_at) > CLOCK_STANDS

    def newest(self) -> tuple[float, SceneState] | None:
        """The newest stamp (s) and state; None where none has arrived for too long."""
        with self._news:
            return self._fresh()

    def _fresh(self) -> tuple[float, SceneState] | None:
        self._clock.now()
        return None if self._silent() else self._states.newest()

    def state(
        self, patience: float, after: float = -float("inf"), canceled: Callable[[], bool] = lambda: False
    ) -> tuple[float, SceneState]:
        """The newest stamp (s) and state; waits for one that is fresh and has a stamp later than ``after``.

        Args:
            patience: s.
            after: s.
            canceled: ends the waiting.

        Raises:
            InputError: STALE_STATE; none came in time.
            PlannerError: CANCELED, or the node is being shut down.
        """
        until = time.monotonic() + patience

        def fresh() -> tuple[float, SceneState] | None:
            newest = self._fresh()
            return newest if newest is not None and newest[0] > after else None

        with self._news:
            self._wait(lambda: fresh() is not None, until, canceled)
            found = fresh()
            if found is None:
                raise InputError(
                    f"no fresh world state within {patience:g} s: is perception running, and do its sensors speak?",
                    Code.STALE_STATE,
                )
            return found

    def settled(self, patience: float, canceled: Callable[[], bool] = lambda: False) -> SceneState:
        """Where everything is once it stands, or after as long as one waits for that.

        The newest state is not enough when a motion has just ended: it may be of before the end. So the first look is
        at a state of later than now. A clock that comes in steps may still be behind, hence the look at what moves.
        Bodies that stand on something within the noise of the measurement stand exactly there.

        Raises:
            InputError, PlannerError: as :meth:`state`, with ``patience`` and ``canceled`` for each look.
        """
        stamp, state = self.state(patience, self._node.get_clock().now().nanoseconds * 1e-9, canceled)
        for _ in range(REST_LOOKS):
            before = state
            stamp, state = self.state(patience, stamp + REST_PERIOD, canceled)
            if _at_rest(before, state):
                break
        scene = self.scene()
        return state if scene is None else on_supports(scene, state, self._noise)

    def wait_for_scene(
        self, task: str, seed: int, patience: float, canceled: Callable[[], bool] = lambda: False
    ) -> Scene:
        """The scene, once it is that of the task.

        Args:
            task, seed: of it.
            patience: s.
            canceled: ends the waiting.

        Raises:
            InputError: STALE_STATE; it did not come.
            PlannerError: CANCELED, or the node is being shut down.
        """

        def wanted() -> Scene | None:
            scene = self._scene
            return scene if scene is not None and (scene.task, scene.seed) == (task, seed) else None

        with self._news:
            self._wait(lambda: wanted() is not None, time.monotonic() + patience, canceled)
            scene = wanted()
            if scene is None:
                raise InputError(f"the scene of task {task!r}, seed {seed} was not published", Code.STALE_STATE)
            return scene

    def _wait(self, predicate: Callable[[], bool], until: float, canceled: Callable[[], bool] = lambda: False) -> None:
        while not predicate() and (left := until - time.monotonic()) > 0.0:
            if self._node.stopping.is_set():
                raise PlannerError("the supervisor is shutting down", Code.CANCELED)
            if canceled():
                raise PlannerError("canceled", Code.CANCELED)
            self._news.wait(min(left, 0.5))

    def _take_scene(self, message: SceneMessage) -> None:
        base = scene_from_message(message)
        with self._news:
            same = self._base is not None and (self._base.task, self._base.seed) == (base.task, base.seed)
            # what came before the first scene is of it, too: latched topics come in any order, and once
            if self._base is not None and not same:
                self._seen = {}
            if self._base is not None and self._base.bodies.keys() != base.bodies.keys():
                self._cloud_messages.clear()
                self._clouds, self._decoded_message = {}, None
            # the same scene again: it was reset to its start, so earlier states are invalid
            changed = same and message.text != self._text
            self._base, self._text = base, message.text
            self._merge(base, keep_state=changed)

    def _take_new(self, message: BodyArray) -> list[str]:
        bodies, problems = bodies_from_message(message)
        with self._news:
            self._seen = bodies
            if self._base is not None:
                self._merge(self._base, keep_state=True)
        return problems

    def _merge(self, base: Scene, keep_state: bool) -> None:
        """The scene with all that was seen in it; a state of before counts where it lacks no measured body."""
        seen = {name: body for name, body in self._seen.items() if name not in base.bodies}
        self._scene = scene = replace(base, bodies=base.bodies | seen)
        newest = self._states.newest() if keep_state else None
        self._states.clear()
        if newest is not None:
            stamp, state = newest
            fixed = {n: body.pose for n, body in scene.bodies.items() if body.kind is BodyKind.FIXED}
            poses = {n: T for n, T in (state.poses | fixed).items() if n in scene.bodies}
            if poses.keys() == scene.bodies.keys():
                self._states.add_checked(stamp, replace(state, poses=poses))
        self._changed = time.monotonic()
        self._news.notify_all()
        for listener in self._listeners:
            listener()

    def _take_state(self, message: WorldState) -> None:
        with self._news:
            base = self._base
        if base is None:
            return
        stamp, state = seconds_from_message(message.header.stamp), state_from_message(base, message)
        with self._news:
            if base is self._base and self._scene is not None:
                state.poses |= {n: body.pose for n, body in self._scene.bodies.items() if n not in base.bodies}
                if self._states.add(stamp, state):
                    self._arrived, self._arrived_at = time.monotonic(), clock_time(self._node)
                    self._news.notify_all()

    def _take_clouds(self, message: ObjectClouds) -> None:
        frame("the message of the objects' clouds", message.header.frame_id, ("", WORLD_FRAME))
        with self._news:
            self._cloud_messages.add(seconds_from_message(message.header.stamp), message)


def _at_rest(before: SceneState, after: SceneState) -> bool:
    """Whether nothing has moved between two states REST_PERIOD apart."""
    if before.poses.keys() != after.poses.keys():
        return False  # a body came or went
    moved = [transforms.distance(before.poses[name], pose) for name, pose in after.poses.items()]
    arms = max((float(np.abs(q - before.q[name]).max(initial=0.0)) for name, q in after.q.items()), default=0.0)
    return arms < REST_JOINT and all(far < REST_DISTANCE and angle < REST_ANGLE for far, angle in moved)
