"""Lower bounds on the distance of two convex shapes by separating axes (Gottschalk, Lin and Manocha 1996).

The signed distance of two convex shapes is the largest gap between them along any direction. So the gap along one
direction is a lower bound, for shapes that overlap as well. The direction is fixed to one of the two shapes. Along it,
each point of the other deviates from its linear interpolation between two samples by at most an eighth of its
acceleration (:mod:`hmap_core.validation.motion`), and so does the gap. Where a body slides along another, or a link
carries it, one direction bounds the distance over many steps.
"""

from functools import cached_property

import numpy as np

from hmap_core.validation.world import Part, Track, World


class SeparatingAxes:
    """Lower bounds on the distance of two parts in each step.

    Args:
        world: the plan.
        a, b: the parts.
    """

    def __init__(self, world: World, a: Part, b: Part):
        self._world = world
        self._frame, self._part = frame_and_part(world, a, b)
        self._sign = 1.0 if self._frame is a else -1.0

    @cached_property
    def _bend(self) -> np.ndarray:
        """(N-1,) how far the gap along a direction may be below its linear interpolation in each step, m."""
        return self._world.relative_motion(self._frame, self._part).bend / 8.0

    def bounds(self, normal: np.ndarray, k: int, first: int, last: int) -> np.ndarray:
        """Lower bounds on the distance in the steps from sample ``first`` to sample ``last``.

        Args:
            normal: (3,) direction from a to b at sample k, world frame.
            k: the sample.
            first, last: samples.

        Returns:
            (last - first,) in metres; -inf if the direction has no length.
        """
        length = np.linalg.norm(normal)
        if not 0.5 < length < 2.0:
            return np.full(last - first, -np.inf)
        frame, part = self._world.tracks[self._frame], self._world.tracks[self._part]
        own = frame.R[k].T @ (self._sign / length * normal)
        gap = gap_along(frame, part, own, slice(first, last + 1))
        return np.minimum(gap[:-1], gap[1:]) - self._bend[first:last]


def gap_along(frame: Track, part: Track, direction: np.ndarray, rows: slice) -> np.ndarray:
    """Gaps between two parts along a direction that is fixed to one of them, at some instants.

    Args:
        frame: the part that the direction is fixed to.
        part: the other one.
        direction: (3,) unit vector from the first to the other, in the frame of the first.
        rows: n instants.

    Returns:
        (n,) in metres; negative where the parts overlap along it.
    """
    towards = frame.R[rows] @ direction
    back = -np.einsum("nji,nj->ni", part.R[rows], towards)
    offset = np.einsum("ni,ni->n", part.p[rows] - frame.p[rows], towards)
    return offset - part.part.solid.support(back) - frame.part.solid.support(direction[None])


def frame_and_part(world: World, a: Part, b: Part) -> tuple[Part, Part]:
    """Two parts, first the one in whose frame the motion of the other is bounded: one that stands still, or a link."""
    if world.tracks[a].still or (a.link is not None and not world.tracks[b].still):
        return a, b
    return (b, a) if world.tracks[b].still or b.link is not None else (a, b)
