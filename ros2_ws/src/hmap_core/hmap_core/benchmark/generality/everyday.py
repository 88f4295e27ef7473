"""Families of tasks that anybody who programs a Panda has written: pick and place among other things, and pushes."""

import math
from typing import Any

from hmap_core.benchmark.generality.cell import ORANGE, Cell, Point, Sampler
from hmap_core.benchmark.generality.family import solvable

HAND_ROOM = 0.13  # m between the middles of a small object and a neighbour that is not higher, for the fingers
TOLERANT: dict[str, Any] = {"tolerance": 0.01, "degrees": 5.0}  # of goals that are reached by pushes


def clutter(cell: Cell, draw: Sampler, taken: list[tuple[Point, float]], count: int, height: float) -> None:
    """Add blocks and cans that are not higher than ``height``, apart from the places that are taken and each other."""
    for k in range(count):
        spot = draw.spot_apart(taken)
        if spot is None:
            return
        tall = draw.uniform(0.03, max(height, 0.035))
        if draw.choice((True, False)):
            size = (draw.uniform(0.03, 0.05), draw.uniform(0.03, 0.05), tall)
            cell.block(f"other_{k}", size, spot, yaw=draw.angle(), mass=0.15)
        else:
            cell.can(f"other_{k}", draw.uniform(0.015, 0.03), tall, spot, mass=0.15)
        taken.append((spot, 0.09))


def two_spots(draw: Sampler, apart: float, **ring: Point) -> tuple[Point, Point]:
    """Two points around the base with a distance of at least ``apart`` in m."""
    while True:
        start, goal = draw.spot(**ring), draw.spot(**ring)
        if math.dist(start, goal) >= apart:
            return start, goal


def pick_in_clutter(cell: Cell, draw: Sampler) -> None:
    """Bring a block to another place on a table with other things."""
    size = (draw.uniform(0.035, 0.06), draw.uniform(0.035, 0.06), draw.uniform(0.05, 0.1))
    start, goal = two_spots(draw, 0.2)
    cell.table().panda()
    cell.block("block", size, start, yaw=draw.angle(), mass=draw.uniform(0.1, 0.4), color=ORANGE)
    clutter(cell, draw, [(start, HAND_ROOM), (goal, HAND_ROOM)], draw.integer(4, 8), size[2])
    cell.goal("block", goal, size[2] / 2, (0, 0, draw.angle()))


def over_wall(cell: Cell, draw: Sampler) -> None:
    """Sort a block to the other side of a wall."""
    size = (draw.uniform(0.035, 0.06), draw.uniform(0.035, 0.06), draw.uniform(0.05, 0.12))
    side, height = draw.side(), draw.uniform(0.1, 0.22)
    start = (draw.uniform(0.4, 0.55), side * draw.uniform(0.13, 0.3))
    goal = (draw.uniform(0.4, 0.55), -side * draw.uniform(0.13, 0.3))
    cell.table().panda()
    cell.wall("wall", (0.3, 0.0), (0.8, 0.0), height)
    cell.block("block", size, start, yaw=draw.angle(), mass=draw.uniform(0.1, 0.5), color=ORANGE)
    cell.goal("block", goal, size[2] / 2, (0, 0, draw.angle()))


def rotated_goal(cell: Cell, draw: Sampler) -> None:
    """Bring a long block to another place, turned by 60 to 180 degrees."""
    size = (draw.uniform(0.09, 0.15), draw.uniform(0.035, 0.055), draw.uniform(0.035, 0.06))
    start, goal = two_spots(draw, 0.18)
    yaw = draw.angle()
    cell.table().panda()
    cell.block("block", size, start, yaw=yaw, mass=draw.uniform(0.15, 0.4), color=ORANGE)
    cell.goal("block", goal, size[2] / 2, (0, 0, yaw + draw.side() * draw.angle(60, 180)))


def stand_up(cell: Cell, draw: Sampler) -> None:
    """Put a long block that lies upright, or one that stands on its side."""
    thick = draw.uniform(0.04, 0.055)
    size = (draw.uniform(0.13, 0.17), thick, thick)
    start, goal = two_spots(draw, 0.2)
    lying, upright = (0.0, 0.0, draw.angle()), (0.0, 90.0, draw.angle())
    heights = {lying: thick / 2, upright: size[0] / 2}
    before, after = (lying, upright) if draw.choice((True, False)) else (upright, lying)
    at = {"xyz": [start[0], start[1], round(heights[before], 5)], "rpy_deg": list(before)}
    cell.table().panda()
    cell.add_box("block", size, at, movable=True, mass=draw.uniform(0.15, 0.3), friction=0.8, color=ORANGE)
    cell.goal("block", goal, round(heights[after], 5), after)


def build_stack(cell: Cell, draw: Sampler) -> None:
    """Put a block on one or two others that stand on each other."""
    width = draw.uniform(0.04, 0.055)
    heights = [draw.uniform(0.04, 0.06) for _ in range(draw.integer(1, 2))]
    start, goal = two_spots(draw, 0.2)
    yaw, top = draw.angle(), 0.0
    cell.table().panda()
    cell.block("block", (width, width, 0.05), start, yaw=draw.angle(), mass=0.15, color=ORANGE)
    for k, height in enumerate(heights):
        cell.block(f"base_{k}", (0.065, 0.065, height), goal, z=top, yaw=yaw, mass=0.4)
        top += height
    cell.goal("block", goal, top + 0.025, (0, 0, yaw + draw.angle(-45, 45)))


def doorway(cell: Cell, draw: Sampler) -> None:
    """Bring a block through a gap in a high wall."""
    size = (draw.uniform(0.04, 0.06), draw.uniform(0.04, 0.06), draw.uniform(0.06, 0.1))
    middle, gap, height = draw.uniform(-0.1, 0.1), draw.uniform(0.3, 0.36), draw.uniform(0.3, 0.5)
    start = (draw.uniform(0.34, 0.37), middle + draw.uniform(-0.2, 0.2))
    goal = (draw.uniform(0.6, 0.64), middle + draw.uniform(-0.04, 0.04))
    cell.table().panda()
    cell.wall("wall_left", (0.5, middle + gap / 2), (0.5, 0.8), height)
    cell.wall("wall_right", (0.5, -0.8), (0.5, middle - gap / 2), height)
    cell.block("block", size, start, mass=draw.uniform(0.1, 0.4), color=ORANGE)
    cell.goal("block", goal, size[2] / 2, (0, 0, draw.choice((0, 90, -90))))


def shelf_to_shelf(cell: Cell, draw: Sampler) -> None:
    """Bring a block from one board of an open shelf to the other."""
    size = (draw.uniform(0.04, 0.06), draw.uniform(0.04, 0.06), draw.uniform(0.1, 0.14))
    boards = [draw.uniform(0.25, 0.33), draw.uniform(0.6, 0.66)]
    front = draw.uniform(0.48, 0.54)
    middle = front + 0.13
    cell.table().panda()
    for name, z in (("lower", boards[0]), ("upper", boards[1]), ("roof", draw.uniform(0.92, 1.0))):
        cell.box(f"board_{name}", (0.26, 0.7, 0.02), (middle, 0.0), z - 0.02)
    for name, y in (("left", 0.36), ("right", -0.36)):
        cell.box(f"side_{name}", (0.26, 0.02, 1.02), (middle, y))
    cell.box("back", (0.02, 0.74, 1.02), (front + 0.27, 0.0))
    begin, end = boards if draw.choice((True, False)) else boards[::-1]
    places = [(front + draw.uniform(0.05, 0.09), draw.uniform(-0.2, 0.2)) for _ in range(2)]
    cell.block("block", size, places[0], begin, mass=draw.uniform(0.1, 0.3), color=ORANGE)
    cell.goal("block", places[1], end + size[2] / 2)


def bin_picking(cell: Cell, draw: Sampler) -> None:
    """Bring one of several blocks from one bin to another."""
    side, height = draw.side(), draw.uniform(0.04, 0.06)
    cell.table().panda()
    for name, y in (("bin_1", side * 0.22), ("bin_2", -side * 0.22)):
        values = {"span_x": 0.36, "span_y": 0.26, "wall": 0.015, "top": height}
        cell.add_object(name, "tray", (0.48, y, 0.0), values=values)
    slots = [(0.48 + dx, side * 0.22 + dy) for dx in (-0.11, 0.0, 0.11) for dy in (-0.06, 0.06)]
    draw.rng.shuffle(slots)
    for k, (x, y) in enumerate(slots[: draw.integer(3, 6)]):
        name = "block" if k == 0 else f"other_{k}"
        size = (draw.uniform(0.03, 0.042), draw.uniform(0.03, 0.042), draw.uniform(0.08, 0.1))
        spot = (x + draw.uniform(-0.004, 0.004), y + draw.uniform(-0.004, 0.004))
        color: dict[str, Any] = {"color": ORANGE} if k == 0 else {}
        cell.block(name, size, spot, yaw=draw.angle(-15, 15), mass=0.15, **color)
        if k == 0:
            tall = size[2]
    goal = (0.48 + draw.uniform(-0.08, 0.08), -side * 0.22 + draw.uniform(-0.04, 0.04))
    cell.goal("block", goal, tall / 2, (0, 0, draw.angle(-30, 30)))


def push_into_corner(cell: Cell, draw: Sampler) -> None:
    """Push a box that is too wide for the gripper into a corner between two walls."""
    size = (draw.uniform(0.1, 0.13), draw.uniform(0.1, 0.13), draw.uniform(0.05, 0.08))
    side = draw.side()
    x, y = draw.uniform(0.62, 0.66), draw.uniform(0.2, 0.28)
    goal = (x - size[0] / 2 - 0.003, side * (y - size[1] / 2 - 0.003))
    start = (goal[0] - draw.uniform(0.06, 0.1), goal[1] - side * draw.uniform(0.1, 0.18))
    cell.table().panda()
    cell.wall("wall_back", (x + 0.01, -0.4), (x + 0.01, 0.4), 0.08)
    cell.wall("wall_side", (x - 0.25, side * (y + 0.01)), (x, side * (y + 0.01)), 0.08)
    cell.block("box", size, start, yaw=draw.angle(-6, 6), mass=draw.uniform(0.2, 0.5), friction=0.5, color=ORANGE)
    cell.goal("box", goal, size[2] / 2, **TOLERANT)


FAMILIES = solvable(
    pick_in_clutter,
    over_wall,
    rotated_goal,
    stand_up,
    build_stack,
    doorway,
    shelf_to_shelf,
    bin_picking,
    push_into_corner,
)
