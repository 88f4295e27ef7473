"""Families of tasks with bodies that roll: they rest in rings and cradles, or stand on an end."""

import math
from typing import Any

from hmap_core.benchmark.generality.cell import ORANGE, Cell, Point, Sampler
from hmap_core.benchmark.generality.everyday import two_spots
from hmap_core.benchmark.generality.family import solvable

ANY_TURN = 180.0  # degrees, tolerance of a body whose turn does not matter


def ball_into_ring(cell: Cell, draw: Sampler) -> None:
    """Bring a ball from a ring on the table into another one on a pedestal."""
    radius, height = draw.uniform(0.026, 0.034), draw.uniform(0.04, 0.2)
    ring = {"span_x": 2 * radius + 0.012, "span_y": 2 * radius + 0.012, "wall": 0.008, "top": 0.012}
    start, goal = two_spots(draw, 0.25)
    cell.table().panda()
    cell.box("pedestal", (0.12, 0.12, height), goal)
    cell.add_object("ring_1", "tray", (*start, 0.0), values=ring)
    cell.add_object("ring_2", "tray", (*goal, height), values=ring)
    ball: dict[str, Any] = {"movable": True, "mass": draw.uniform(0.05, 0.15), "friction": 0.7, "color": ORANGE}
    cell.add_sphere("ball", radius, (*start, radius), **ball)
    cell.goal("ball", goal, height + radius, degrees=ANY_TURN)


def cylinder_on_rails(cell: Cell, draw: Sampler) -> None:
    """Bring a cylinder that lies on two rails to two others."""
    radius, length = draw.uniform(0.018, 0.03), draw.uniform(0.1, 0.16)
    start, goal = two_spots(draw, 0.25)
    yaws = draw.angle(-40, 40), draw.angle(-40, 40)
    heights = draw.uniform(0.025, 0.05), draw.uniform(0.025, 0.1)
    cell.table().panda()
    ends = zip((start, goal), heights, yaws, strict=True)
    lying = [rails(cell, f"rails_{k}", radius, at, top, yaw) for k, (at, top, yaw) in enumerate(ends)]
    at = {"xyz": [*start, lying[0]], "rpy_deg": [0.0, 90.0, yaws[0]]}
    cell.add_cylinder("cylinder", radius, length, at, movable=True, mass=0.2, friction=0.7, color=ORANGE)
    cell.goal("cylinder", goal, lying[1], (0, 90, yaws[1]), degrees=5.0)


def rails(cell: Cell, name: str, radius: float, at: Point, top: float, yaw: float) -> float:
    """Add two rails along x, turned by ``yaw``, for a lying cylinder; returns the height of its axis in m."""
    half = round(0.6 * radius, 4)  # between the middle and a rail's inner edge
    parts = [
        {"shape": "box", "size": [0.1, 0.012, top], "pose": {"xyz": [0.0, sign * (half + 0.006), round(top / 2, 5)]}}
        for sign in (-1, 1)
    ]
    cell.add_body(name, parts, {"xyz": [*at, 0.0], "rpy_deg": [0.0, 0.0, yaw]})
    return round(top + math.sqrt(radius**2 - half**2), 5)


def can_to_shelf(cell: Cell, draw: Sampler) -> None:
    """Bring a can that stands on a table to the board of a shelf."""
    radius, height = draw.uniform(0.024, 0.035), draw.uniform(0.08, 0.13)
    side, board = draw.side(), draw.uniform(0.15, 0.35)
    front, y = draw.uniform(0.46, 0.5), side * draw.uniform(0.15, 0.25)
    start = draw.spot((0.42, 0.55), (-40, -15))
    cell.table().panda()
    cell.box("board", (0.24, 0.36, 0.02), (front + 0.12, y), board - 0.02)
    cell.box("roof", (0.24, 0.36, 0.02), (front + 0.12, y), board + draw.uniform(0.28, 0.34))
    for name, edge in (("left", 0.19), ("right", -0.19)):
        cell.box(f"side_{name}", (0.24, 0.02, 0.72), (front + 0.12, y + edge))
    mass = draw.uniform(0.1, 0.35)
    cell.can("can", radius, height, (start[0], -side * abs(start[1])), mass=mass, color=ORANGE)
    goal = (front + draw.uniform(0.05, 0.09), y + draw.uniform(-0.06, 0.06))
    cell.goal("can", goal, board + height / 2, degrees=ANY_TURN)


FAMILIES = solvable(ball_into_ring, cylinder_on_rails, can_to_shelf)
