"""Hands and contacts from which a tree chooses: hmap's own sampler and feasibility checks."""

from itertools import islice

import numpy as np

from hmap_core.baselines.birrt.manifold import Hand, Manifold
from hmap_core.baselines.birrt.space import ObjectSpace
from hmap_core.contacts.feasibility import reach_bounds, reachable
from hmap_core.planner.contact_checker import cleared, secure_grasps
from hmap_core.planner.context import SearchContext
from hmap_core.planner.interfaces import ToolGrasp
from hmap_core.planner.surroundings import nearest_first
from hmap_core.planner.tools import attach_tool, tools_of
from hmap_core.types import ContactPoint

BATCHES = 4  # of the sampler, the best first
KEPT = 12  # contacts of a batch that are kept for later branches
FRESH = 0.2  # share of the draws for which contacts are sampled anew
TRIED = 3  # contacts for which inverse kinematics is solved at one draw
TOOL_GRASPS = 4  # grasps on tools, the farthest-reaching


class Contacts:
    """Draws contacts for a pose of the object.

    Args:
        context: of the job.
        object: name of the object.
        space: of the object.
        kept: contacts that are kept of those sampled at once.
        fresh: share of the draws for which contacts are sampled anew.
    """

    def __init__(self, context: SearchContext, object: str, space: ObjectSpace, kept: int = KEPT, fresh: float = FRESH):
        self._kept, self._fresh = kept, fresh
        self._context, self._object, self._space = context, object, space
        robots = nearest_first(context.scene, object, context.start, tuple(context.scene.robots))
        self._hands = [self._hand(robot, None) for robot in robots]
        self._pools: list[list[Manifold]] = [[] for _ in self._hands]

    def add_tools(self) -> None:
        """Let hands with tools be drawn, too."""
        context = self._context
        if not tools_of(context.scene, self._object):
            return
        context.report("contacts", text=f"tools for '{self._object}'")
        line = self._space.line(self._space.start, self._space.goal)
        found = context.components.tools.tool_grasps(
            context.scene, context.start, self._object, line, context.seed(), context.time_left()
        )
        for grasp, _ in found[:TOOL_GRASPS]:
            self._hands.append(self._hand(grasp.robot, grasp))
            self._pools.append([])

    def draw(self, T: np.ndarray, ahead: np.ndarray, rng: np.random.Generator) -> tuple[Manifold, np.ndarray] | None:
        """A contact that can be made with the object at T (7,), and the configuration (n,) in it; None for none.

        Args:
            ahead: (k, 7) the next poses of the object, in the order of time; T is the first or the last of them.
            rng: the only source of randomness.
        """
        chosen = self.candidates(ahead, rng, TRIED)
        if not chosen:
            return None
        ok, q = reachable(chosen[0].hand.manipulation, [mode.contact for mode in chosen], T, rng)
        first = int(ok.argmax())
        return (chosen[first], q[first]) if ok.any() else None

    def candidates(self, ahead: np.ndarray, rng: np.random.Generator, count: int) -> list[Manifold]:
        """Up to ``count`` contacts of a random hand with which this can go along poses (k, 7) of the object."""
        number = int(rng.integers(len(self._hands)))
        hand, pool = self._hands[number], self._pools[number]
        if not pool or rng.random() < self._fresh:
            pool += self._sampled(hand, ahead, rng)
        if not pool:
            return []
        bounds = reach_bounds(hand.manipulation, [mode.contact for mode in pool], ahead)
        return [pool[k] for k in rng.permutation(np.flatnonzero(bounds >= len(ahead) - 1))[:count]]

    def forget(self, mode: Manifold) -> None:
        """Draw a contact no more."""
        for pool in self._pools:
            pool[:] = [own for own in pool if own is not mode]

    def _hand(self, robot: str, grasp: ToolGrasp | None) -> Hand:
        scene = self._context.scene if grasp is None else attach_tool(self._context.scene, grasp)
        manipulation, away = cleared(scene, self._context.start, self._object, robot)
        return Hand(robot, scene, manipulation, away, grasp)

    def _sampled(self, hand: Hand, ahead: np.ndarray, rng: np.random.Generator) -> list[Manifold]:
        """Contacts of the next batch that the hand alone can make at the first of the next poses (k, 7)."""
        there = self._context.start.copy()
        there.poses[self._object] = ahead[0]
        query = self._context.contact_query(hand.scene, there, self._object, ahead, hand.robot, rng)
        batches = islice(self._context.components.proposer.propose(query), BATCHES)
        contacts: list[ContactPoint] = [contact for batch in batches for contact in batch.contacts]
        if contacts and not self._space.planar:
            contacts = secure_grasps(hand.scene, self._object, hand.robot, contacts, ahead[0])
        if not contacts:
            return []
        possible = np.flatnonzero(reach_bounds(hand.manipulation, contacts, ahead[:1]) >= 0)
        kept = rng.permutation(possible)[: self._kept]
        return [Manifold(hand, contacts[k], self._space) for k in kept]
