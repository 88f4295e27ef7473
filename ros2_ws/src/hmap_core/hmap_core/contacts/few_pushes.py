"""Paths of two pushes to a goal that leaves the orientation of the object open, as far as its tolerance goes.

A push along an arc turns the object with it. Two of them lead round a corner where straight pushes need three, for the
second one begins with the object turned already. All first pushes of a grid are looked at. The second one follows from
the first: from each side of the object just one arc with the direction of that side at its start leads to the goal.
"""

from dataclasses import dataclass

import numpy as np

from hmap_core.contacts.push_path import SHORT, Leg, PushPlanner
from hmap_core.transforms import consistent, wrapped
from hmap_core.waypoints.checker import planar_yaw
from hmap_core.waypoints.resample import resample

CURVATURES = np.array([0.2, 0.5, 1.0])  # of first pushes, relative to the largest one
SLANTS = np.array([-0.98, 0.0, 0.98])  # of straight first pushes, relative to the largest one
LENGTH_STEP = 0.04  # m between the lengths of first pushes
DETOUR = 1.7  # longest path, as a share of the straight line
PUSHER_ROOM = 0.05  # m that are free behind the object where a push begins
AWAY = float(np.deg2rad(100.0))  # rad between a first push and the goal
MAX_CHECKED = 3000  # second pushes that are checked
STRAIGHT = 1e-3  # rad; arcs that turn by less are straight


@dataclass(frozen=True)
class _Rays:
    """First pushes (R,) of any length, and the lengths to which they are free.

    Attributes:
        side, heading, curvature: (R,) of the pushes.
        free: (R,) m.
    """

    side: np.ndarray
    heading: np.ndarray
    curvature: np.ndarray
    free: np.ndarray

    def leg(self, ray: int, length: float) -> Leg:
        """The push with this index and a length."""
        return Leg(int(self.side[ray]), float(self.heading[ray]), float(length), float(self.curvature[ray]))


def two_pushes(planner: PushPlanner, poses: np.ndarray, T_goal: np.ndarray, turn: float) -> np.ndarray | None:
    """Plan the shortest free path of two pushes.

    Args:
        planner: of pushes of the object.
        poses: (M, 7) any path from start to goal, on the support.
        T_goal: (7,) the goal; the last of the poses may be turned.
        turn: rad by which the object may be turned at the end, compared with the goal.

    Returns:
        Poses (K, 7); None if there is no such path.
    """
    a, b = planner.state(poses[0]), planner.state(poses[-1])
    b[2] = planar_yaw(planner.problem.start, T_goal)
    headings = np.array([side.heading for side in planner.sides])
    most = np.array([[min(abs(k), planner.robust_curvature) for k in side.curvature] for side in planner.sides])
    longest = DETOUR * float(np.hypot(*(b - a)[:2]))
    rays = _first_pushes(planner, a, b, headings, most, longest)
    lengths = [np.arange(SHORT, free, LENGTH_STEP) for free in rays.free]
    ray = np.repeat(np.arange(len(lengths)), [len(own) for own in lengths])
    length = np.concatenate([np.zeros(0), *lengths])
    at = _ends(a, rays, ray, length)
    legs, way = _second_pushes(at, b, headings, most, planner.slant, turn)
    total = length[:, None] + way
    found = np.argwhere(total <= longest)
    for k, side in found[np.argsort(total[tuple(found.T)], kind="stable")][:MAX_CHECKED]:
        own = Leg(int(side), *(float(number) for number in legs[k, side]))
        middle = at[k] + np.r_[own.along(0.5 * own.length), 0.5 * own.turn]
        back = Leg(own.side, own.heading + np.pi, PUSHER_ROOM)
        if not planner.checker.pose_free(planner.pose(middle)):
            continue
        if planner.free(at[k], [own]) and planner.free(at[k], [back]):
            corners = [poses[0], *planner.poses_along(a, [rays.leg(ray[k], length[k]), own])]
            return consistent(resample(np.array(corners))[0])
    return None


def _first_pushes(
    planner: PushPlanner, a: np.ndarray, b: np.ndarray, headings: np.ndarray, most: np.ndarray, longest: float
) -> _Rays:
    """Straight pushes and arcs from a state (3,) on each side of the object, not away from another state (3,)."""
    own = [(k, slant * planner.slant, 0.0) for k in range(len(headings)) for slant in SLANTS]
    own += [
        (k, 0.0, sign * share * most[k, right])
        for k in range(len(headings))
        for share in CURVATURES
        for right, sign in enumerate((-1.0, 1.0))
    ]
    side, slant, curvature = (np.array(column) for column in zip(*own, strict=True))
    heading = a[2] + headings[side] + slant
    away = np.abs(wrapped(heading - np.arctan2(*(b - a)[1::-1])))
    rays = _Rays(side, heading, curvature, np.zeros(len(side)))
    for k in np.flatnonzero(away <= AWAY):
        at, begin = planner.pose(a), 0.0
        while begin < longest:
            leg = rays.leg(int(k), begin + LENGTH_STEP)
            to = planner.pose(a + np.r_[leg.along(leg.length), leg.turn])
            if not planner.checker.motion_free(at, to):
                break
            at, begin = to, leg.length
        rays.free[k] = begin
    return rays


def _ends(a: np.ndarray, rays: _Rays, ray: np.ndarray, length: np.ndarray) -> np.ndarray:
    """States (N, 3) at the ends of first pushes (N,) from a state (3,), with their lengths (N,)."""
    turn = rays.curvature[ray] * length
    chord, middle = length * np.sinc(0.5 * turn / np.pi), rays.heading[ray] + 0.5 * turn
    return a + np.column_stack([chord * np.cos(middle), chord * np.sin(middle), turn])


def _second_pushes(
    at: np.ndarray, b: np.ndarray, headings: np.ndarray, most: np.ndarray, slant: float, turn: float
) -> tuple[np.ndarray, np.ndarray]:
    """Pushes from states (N, 3) to a state (3,) on each of S sides: straight ones, or arcs.

    Returns:
        Heading, length and curvature (N, S, 3); lengths (N, S), infinite where there is no such push.
    """
    way = b[:2] - at[:, :2]
    distance, direction = np.hypot(*way.T)[:, None], np.arctan2(way[:, 1], way[:, 0])[:, None]
    normal = at[:, 2:] + headings
    off = wrapped(direction - normal)
    straight = np.abs(off) <= slant
    bend = np.where(straight, 0.0, off)
    with np.errstate(divide="ignore", invalid="ignore"):
        curvature = 2.0 * np.sin(bend) / distance
        length = distance / np.sinc(bend / np.pi)
    largest = np.where(bend > 0.0, most[:, 1], most[:, 0])
    turned = np.abs(wrapped(at[:, 2:] + 2.0 * bend - b[2]))
    fits = (np.abs(curvature) <= largest) & (np.abs(bend) < 0.5 * np.pi) & (turned <= turn + STRAIGHT)
    fits &= distance >= SHORT
    legs = np.stack([np.where(straight, direction, normal), length, curvature], axis=2)
    return legs, np.where(fits, length, np.inf)
