"""Transits of a robot with an attached tool, with additional clearance for the tool.

Attached tools can slip, so in physical tasks they keep a larger minimum distance than links where that is possible.
"""

from collections.abc import Callable, Iterator

import numpy as np

from hmap_core.collision.scene_model import CollisionModel, Collisions
from hmap_core.deadline import check_time
from hmap_core.komo.allowances import relaxed
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.pair_blocks import PairChecks
from hmap_core.planner.hand_moves import HandMoves
from hmap_core.planner.transit import UNSEEN, find_transit
from hmap_core.types import TaskMode

ROOMS = (0.01, 0.005)  # m round what is held that are asked for, one after the other
STRAYS = 0.0005  # m that a way may come nearer than the last of these


FindTransit = Callable[..., np.ndarray | None]  # the arguments and the result of find_transit


class TransitSearch:
    """What a robot meets on its way from one configuration to another.

    Args:
        manipulation: the robot, with what it holds.
        collisions, cols: what keeps apart, and its arrays, with minimum distances that the start keeps.
        start, goal: (n,).
        mask: bit mask of the phases that count.
        find: searches a path, with the arguments and the result of :func:`find_transit`.
    """

    def __init__(
        self,
        manipulation: Manipulation,
        collisions: CollisionModel,
        cols: Collisions,
        start: np.ndarray,
        goal: np.ndarray,
        mask: int,
        find: FindTransit = find_transit,
    ):
        self._chain, self._cols, self._mask = manipulation.model.chain, cols, mask
        self._start, self._goal, self._find = start, goal, find
        self._moves = HandMoves(manipulation, collisions)
        check_time()
        scene = manipulation.scene
        held = scene.robots[manipulation.robot].model.attached
        slips = None if held is None or scene.mode == TaskMode.KINEMATIC else f"{manipulation.robot}/{held.name}"
        self._rooms = () if slips is None else ROOMS
        self._held = np.array([name == slips for name in collisions.names])

    def has_room(self, path: np.ndarray) -> bool:
        """Whether a way (M, n) from the start to the goal keeps the least room, where these have it."""
        if not self._rooms:
            return True
        cols = self._with_room(self._rooms[-1])
        check_time()
        cols = cols._replace(min_distance=cols.min_distance - STRAYS)
        masks = np.full(len(path) - 1, self._mask, np.int64)
        return not (PairChecks(self._chain, cols).between(path, masks, UNSEEN)[1] >= 0).any()

    def ways(self, rng: np.random.Generator, deadline: float, narrow: bool) -> Iterator[np.ndarray]:
        """Ways (m, n) found by search, the ones with most room first.

        Args:
            narrow: whether ways with no more room than the links have are wanted, too.
            deadline: ``time.monotonic()`` after which to give up.
        """
        for room in (*self._rooms, 0.0) if narrow else self._rooms:
            cols = self._with_room(room) if room else self._cols
            way = self._find(self._moves, self._chain, cols, self._mask, self._start, self._goal, rng, deadline)
            if way is not None:
                yield way

    def _with_room(self, room: float) -> Collisions:
        """The pairs with ``room`` between what is held and what stands around, less where start or goal have less."""
        cols, stands = self._cols, self._cols.frame == 0
        own = (self._held[cols.a] & stands[cols.b]) | (self._held[cols.b] & stands[cols.a])
        roomy = cols._replace(min_distance=np.where(own, np.maximum(cols.min_distance, room), cols.min_distance))
        for q in (self._start, self._goal):
            check_time()
            roomy = relaxed(self._chain, roomy, q, self._mask)
        return roomy._replace(min_distance=np.maximum(roomy.min_distance, cols.min_distance))
