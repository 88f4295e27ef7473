"""What an executor waits for, kept from one look to the next."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.waitable import NumberOfEntities, Waitable

WAITABLE, TIMER, GUARD = "waitable", "timer", "guard_condition"
# kind -> attribute of nodes, in the order in which rclpy runs what is ready
KINDS = {
    WAITABLE: "waitables",
    TIMER: "timers",
    "subscription": "subscriptions",
    GUARD: "guards",
    "client": "clients",
    "service": "services",
}


class KeptWaitSet:
    """A wait set for the entities of nodes.

    rclpy makes a wait set for each look, and asks every entity several times. Here a look asks only what can have
    changed: whether entities have come or gone, and which of them are busy.
    """

    def __init__(
        self,
        nodes: Iterable[Node],
        context: Context,
        guards: Sequence[GuardCondition],
        allowed: Callable[[Any], bool],
    ):
        """
        Args:
            nodes: whose entities are waited for.
            context: of the executor.
            guards: of the executor, which end a wait.
            allowed: whether an entity is waited for at all.

        Raises:
            InvalidHandle: an entity has been destroyed.
        """
        self._nodes = list(nodes)
        self._entities = _entities(self._nodes)
        chosen = {kind: [each for each in entities if allowed(each)] for kind, entities in self._entities.items()}
        self._waitables: list[Waitable] = chosen.pop(WAITABLE)
        self._guards = [guard.handle for guard in guards]
        self._in_use = [each.handle for entities in chosen.values() for each in entities]
        self._in_use += [*self._guards, context.handle, *self._waitables]
        self._set = rclpy_implementation.WaitSet(*_sizes(chosen, self._waitables, len(guards)), context.handle)
        self._known = {kind: {each.handle.pointer: each for each in found} for kind, found in chosen.items() if found}
        self._parts = [
            (each, each.handle, getattr(self._set, f"add_{kind}"), _exclusive(each))
            for kind, found in chosen.items()
            for each in found
        ]

    def is_current(self, nodes: Iterable[Node]) -> bool:
        """Whether the nodes still have the entities that it was made for."""
        return self._nodes == list(nodes) and self._entities == _entities(self._nodes)

    def wait(self, timeout_ns: int) -> list[tuple[str, Any]]:
        """Wait until something is ready.

        Args:
            timeout_ns: negative: as long as it takes.

        Returns:
            Kind and entity of all that is ready.

        Raises:
            InvalidHandle: an entity has been destroyed.
        """
        with _in_use(self._in_use):
            waitables = self._fill()
            self._set.wait(timeout_ns)
            ready: list[tuple[str, Any]] = [(WAITABLE, each) for each in waitables if each.is_ready(self._set)]
            for kind, known in self._known.items():
                found = [known[pointer] for pointer in self._set.get_ready_entities(kind) if pointer in known]
                if kind == TIMER:  # rcl takes a timer that was canceled for ready
                    found = [timer for timer in found if timer.handle.is_timer_ready()]
                ready += [(kind, each) for each in found]
        return ready

    def _fill(self) -> list[Waitable]:
        """Add what is not busy; the waitables among it."""
        self._set.clear_entities()
        for each, handle, add, exclusive in self._parts:
            if not each._executor_event and (exclusive is None or exclusive.can_execute(each)):
                add(handle)
        for guard in self._guards:
            self._set.add_guard_condition(guard)
        waitables = [
            each for each in self._waitables if not each._executor_event and each.callback_group.can_execute(each)
        ]
        for each in waitables:
            each.add_to_wait_set(self._set)
        return waitables


def _entities(nodes: Iterable[Node]) -> dict[str, list[Any]]:
    """The entities of nodes, by kind."""
    return {kind: [each for node in nodes for each in getattr(node, attribute)] for kind, attribute in KINDS.items()}


def _exclusive(entity: Any) -> Any:
    """The callback group of an entity, where callbacks of the group can keep it from being run; else None."""
    group = entity.callback_group
    return None if isinstance(group, ReentrantCallbackGroup) else group


def _sizes(chosen: dict[str, list[Any]], waitables: Sequence[Waitable], guards: int) -> list[int]:
    """The numbers of entities, in the order of rclpy's wait set."""
    count = {kind: len(found) for kind, found in chosen.items()}
    count[GUARD] += guards
    size = NumberOfEntities(*(count[kind] for kind in ("subscription", GUARD, TIMER, "client", "service")))
    for each in waitables:
        size = size + each.get_num_entities()
    return [getattr(size, what) for what in size.__slots__]


@contextmanager
def _in_use(things: Sequence[Any]) -> Iterator[None]:
    """Nothing of this is destroyed during the context."""
    entered = []
    try:
        for thing in things:
            thing.__enter__()
            entered.append(thing)
        yield
    finally:
        for thing in entered:
            thing.__exit__(None, None, None)
