"""Pairs of parts to check for collision, with bounds on their relative motion."""

from bisect import bisect_right
from collections.abc import Iterator, Set
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hmap_core.validation import limits
from hmap_core.validation.axes import SeparatingAxes, frame_and_part
from hmap_core.validation.geometry import Gauge
from hmap_core.validation.held import NOTHING_HELD, HeldBodies
from hmap_core.validation.near import SweptBoxes
from hmap_core.validation.world import Part, World

MANY = 20_000  # pairs of parts, above which only those are made that come near each other


@dataclass(eq=False)
class Pair:
    """Two parts that must not penetrate each other.

    Attributes:
        a, b: the parts.
        motion: (N-1,) bound on the relative motion of any two of their points in each step, m.
        clearance: whether their distance counts for the plan's smallest clearance.
        world: the plan.
        held: whether a contact moves one of them, and is not itself the contact between them.
    """

    a: Part
    b: Part
    motion: np.ndarray
    clearance: bool
    world: World
    held: bool = False

    @property
    def held_clearance(self) -> bool:
        """Whether their distance counts for the smallest clearance of held bodies from other bodies."""
        return self.clearance and self.held and self.a.link is None and self.b.link is None

    @property
    def depth(self) -> float:
        """The overlap up to which the judge does not look closer, m."""
        return limits.HEAD_ON if self.held else limits.PENETRATION

    @property
    def names(self) -> tuple[str, str]:
        """Names of the owners in reports."""
        return self.a.owner, self.b.owner

    @cached_property
    def gauge(self) -> Gauge:
        """Measures the distance of the pair."""
        return self.world.gauge(self.a, self.b)

    @cached_property
    def axes(self) -> SeparatingAxes:
        """Bounds on the distance of the pair along directions that are fixed to one of its parts."""
        return SeparatingAxes(self.world, self.a, self.b)

    @cached_property
    def moves(self) -> bool:
        """Whether the two parts ever move relative to each other."""
        return bool(self.motion.any())


class PairBuilder:
    """Builds the pairs of a world.

    Omitted are: two fixed bodies; a fixed body and a link that no joint moves (a base on its table); links of one robot
    that are rigidly connected, share a joint, or are listed in the robot's ``ignored_collisions``.

    Args:
        world: the plan.
        touching: pairs of owners that touch by design: contacts, and bodies with their supports.
        held: the bodies that contacts move.
    """

    def __init__(self, world: World, touching: Set[frozenset[str]], held: HeldBodies = NOTHING_HELD):
        self._world = world
        self._touching = touching
        self._held = held
        self._motion = {part: world.motion(part).speed(part.reach) for part in world.parts}
        self._immobile = {part: self._is_immobile(part) for part in world.parts}
        self._boxes = SweptBoxes(world, self._motion)
        self._lower, self._upper = self._boxes.lower.min(axis=0), self._boxes.upper.max(axis=0)
        # two fixed bodies are no pair, and there can be thousands
        self._free = [k for k, part in enumerate(world.parts) if part.link is not None or not self._immobile[part]]

    @property
    def many(self) -> bool:
        """Whether there are so many pairs that those of parts that come near each other are searched."""
        return len(self._free) * len(self._world.parts) > MANY

    def build(self, reach: float = np.inf) -> list[Pair]:
        """The pairs to check.

        Args:
            reach: pairs that certainly stay farther apart than this are left out, m.
        """
        parts = self._world.parts
        pairs = (self._pair(parts[i], parts[j]) for i, j in self._numbers(reach))
        return [pair for pair in pairs if pair is not None]

    def build_held(self, reach: float) -> list[Pair]:
        """The pairs of bodies that contacts move with other bodies.

        Args:
            reach: pairs that certainly stay farther apart than this are left out, m.
        """
        parts = self._world.parts
        others = np.array([not self._held.moves(part) for part in parts], bool)
        numbers = self._boxes.pairs(reach, others).tolist()
        near = ((parts[i], parts[j]) for i, j in numbers if parts[i].link is None and parts[j].link is None)
        return [pair for pair in (self._pair(a, b) for a, b in near) if pair is not None]

    def _numbers(self, reach: float) -> Iterator[tuple[int, int]]:
        """Numbers of the parts of all pairs that may come nearer to each other than ``reach`` (m)."""
        parts, free = self._world.parts, self._free
        if self.many and np.isfinite(reach):
            frozen = np.array([part.link is None and self._immobile[part] for part in parts])
            yield from map(tuple, self._boxes.pairs(reach, frozen).tolist())
            return
        for i, a in enumerate(parts):
            others = free[bisect_right(free, i) :] if a.link is None and self._immobile[a] else range(i + 1, len(parts))
            for j in self._nearer(i, np.array(others, int), reach).tolist():
                yield i, j

    def _nearer(self, i: int, others: np.ndarray, reach: float) -> np.ndarray:
        """Those of some parts, given by number, that part ``i`` may come nearer to than ``reach``."""
        if np.isinf(reach):
            return others
        apart = np.maximum(self._lower[others] - self._upper[i], self._lower[i] - self._upper[others])
        return others[np.linalg.norm(np.maximum(apart, 0.0), axis=1) <= reach]

    def _pair(self, a: Part, b: Part) -> Pair | None:
        if a.holder == b.holder and (a.link is None) == (b.link is None):
            return None if a.link is None else self._self_pair(a, b)
        if self._immobile[a] and self._immobile[b] and (a.link is None or b.link is None):
            return None
        self._world.check_time()
        pair = Pair(a, b, self._relative_motion(a, b), clearance=False, world=self._world)
        pair.clearance = pair.moves and frozenset(pair.names) not in self._touching
        pair.held = pair.moves and self._held.concerns(a, b)
        return pair

    def _relative_motion(self, a: Part, b: Part) -> np.ndarray:
        """Bound (N-1,) on the relative motion of two parts, m."""
        motion = self._motion[a] + self._motion[b]
        together = self._motion[a].any() and self._motion[b].any() and (a.link is None or b.link is None)
        return (
            np.minimum(motion, self._world.relative_motion(*frame_and_part(self._world, a, b)).speed)
            if together
            else motion
        )

    def _self_pair(self, a: Part, b: Part) -> Pair | None:
        robot = self._world.arms[a.holder]
        link_a, link_b = a.robot_link, b.robot_link
        if link_a == link_b or robot.adjacent(link_a, link_b):
            return None
        if frozenset((link_a, link_b)) in robot.data.ignored_collisions:
            return None
        motion_a, motion_b = self._world.link_motion(a), self._world.link_motion(b)
        speeds_a, speeds_b = motion_a.speeds(a.reach), motion_b.speeds(b.reach)
        # joints between the base and both links move them together
        own = [s for name, s in zip(motion_a.joints, speeds_a, strict=True) if name not in motion_b.joints]
        own += [s for name, s in zip(motion_b.joints, speeds_b, strict=True) if name not in motion_a.joints]
        return Pair(a, b, sum(own, np.zeros(self._world.samples - 1)), clearance=False, world=self._world)

    def _is_immobile(self, part: Part) -> bool:
        if part.link is None:
            return self._world.document.bodies[part.holder].fixed and not self._motion[part].any()
        return not self._world.arms[part.holder].moving(part.link)
