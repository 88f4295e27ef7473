"""Families of tasks in which other bodies have to go first: on the object, on its goal, before it."""

import numpy as np

from hmap_core.benchmark.generality.cell import ORANGE, Cell, Sampler
from hmap_core.benchmark.generality.everyday import HAND_ROOM, clutter, two_spots
from hmap_core.benchmark.generality.family import solvable


def two_on_goal(cell: Cell, draw: Sampler) -> None:
    """Bring a block to a place on which two others stand."""
    size = (draw.uniform(0.045, 0.06), draw.uniform(0.045, 0.06), draw.uniform(0.05, 0.08))
    start, goal = two_spots(draw, 0.22)
    yaw, half = draw.angle(), draw.uniform(0.034, 0.04)
    cell.table().panda()
    cell.block("block", size, start, yaw=draw.angle(), mass=0.2, color=ORANGE)
    for k, sign in enumerate((-1, 1)):
        x, y = goal[0] + sign * half * np.cos(np.deg2rad(yaw)), goal[1] + sign * half * np.sin(np.deg2rad(yaw))
        width = draw.uniform(0.035, 0.045)
        cell.block(f"on_goal_{k}", (width, width, draw.uniform(0.04, 0.07)), (x, y), yaw=yaw, removable=True)
    clutter(cell, draw, [(start, HAND_ROOM), (goal, HAND_ROOM + 0.05)], draw.integer(0, 3), size[2])
    cell.goal("block", goal, size[2] / 2, (0, 0, yaw))


def jars_in_cabinet(cell: Cell, draw: Sampler) -> None:
    """Take the last jar out of a narrow cabinet in which one or two others stand before it."""
    radius, height = draw.uniform(0.024, 0.03), draw.uniform(0.09, 0.12)
    ground, side = draw.uniform(0.2, 0.26), draw.side()
    front, y = draw.uniform(0.5, 0.53), side * draw.uniform(0.04, 0.1)
    jars, pitch = draw.integer(2, 3), draw.uniform(0.074, 0.08)
    deep, wide, high = pitch * (jars - 1) + 0.1, draw.uniform(0.28, 0.32), draw.uniform(0.28, 0.34)
    middle = front + deep / 2
    cell.table().panda()
    cell.box("base", (deep, wide + 0.04, ground), (middle, y))  # nothing stands before it, where the wrist has to be
    cell.box("roof", (deep, wide + 0.04, 0.02), (middle, y), ground + high)
    for name, edge in (("left", wide / 2 + 0.01), ("right", -wide / 2 - 0.01)):
        cell.box(f"side_{name}", (deep, 0.02, high), (middle, y + edge), ground)
    cell.box("back", (0.02, wide, high), (front + deep - 0.01, y), ground)
    counter = y - side * (wide / 2 + 0.24)
    cell.box("counter", (0.3, 0.36, ground), (0.55, counter))
    for k in range(jars):
        last = k == jars - 1
        at = (front + 0.036 + pitch * k, y + draw.uniform(-0.01, 0.01))
        options = {"color": ORANGE} if last else {"removable": True}
        cell.can("jar" if last else f"front_{k}", radius, height, at, ground, **options)
    goal = (draw.uniform(0.45, 0.52), counter + draw.uniform(-0.06, 0.06))
    cell.goal("jar", goal, ground + height / 2, degrees=180.0)


def unstack_and_stack(cell: Cell, draw: Sampler) -> None:
    """Put a block that carries another one on a block that carries another one, too."""
    start, goal = two_spots(draw, 0.24)
    yaw, turned = draw.angle(), draw.angle()
    low, high = draw.uniform(0.04, 0.06), draw.uniform(0.05, 0.07)
    width = draw.uniform(0.045, 0.055)
    cell.table().panda()
    cell.block("red", (width, width, high), start, yaw=yaw, color=ORANGE)
    cell.block("blue", (0.042, 0.042, draw.uniform(0.04, 0.055)), start, high, yaw, mass=0.12, removable=True)
    cell.block("green", (0.065, 0.065, low), goal, yaw=turned, mass=0.4)
    cell.can("yellow", draw.uniform(0.018, 0.024), draw.uniform(0.05, 0.07), goal, low, mass=0.1, removable=True)
    cell.goal("red", goal, low + high / 2, (0, 0, turned + draw.angle(-45, 45)))


def below_others(cell: Cell, draw: Sampler) -> None:
    """Bring a block that carries one or two others to another place, beside other things."""
    start, goal = two_spots(draw, 0.22)
    size = (draw.uniform(0.05, 0.065), draw.uniform(0.05, 0.065), draw.uniform(0.05, 0.08))
    yaw, z = draw.angle(), size[2]
    cell.table().panda()
    cell.block("block", size, start, yaw=yaw, mass=0.3, color=ORANGE)
    for k in range(draw.integer(1, 2)):
        width, height = draw.uniform(0.035, 0.042), draw.uniform(0.035, 0.055)
        cell.block(f"top_{k}", (width, width, height), start, z, yaw + draw.angle(-10, 10), mass=0.1, removable=True)
        z += height
    clutter(cell, draw, [(start, HAND_ROOM), (goal, HAND_ROOM)], draw.integer(0, 3), 0.05)
    cell.goal("block", goal, size[2] / 2, (0, 0, draw.angle()))


def behind_others(cell: Cell, draw: Sampler) -> None:
    """Bring a block out of a niche before which one or two others stand."""
    size = (draw.uniform(0.04, 0.055), draw.uniform(0.04, 0.055), draw.uniform(0.08, 0.12))
    ground = draw.uniform(0.16, 0.24)
    front, y, wide = draw.uniform(0.5, 0.54), draw.uniform(-0.06, 0.06), draw.uniform(0.3, 0.36)
    deep, high = 0.16, size[2] + draw.uniform(0.06, 0.1)
    cell.table().panda()
    cell.box("platform", (0.46, 1.2, ground), (0.63, 0.0))
    cell.box("roof", (deep, wide + 0.04, 0.02), (front + deep / 2, y), ground + high)
    for name, edge in (("left", wide / 2 + 0.01), ("right", -wide / 2 - 0.01)):
        cell.box(f"side_{name}", (deep, 0.02, high), (front + deep / 2, y + edge), ground)
    cell.box("back", (0.02, wide, high), (front + deep - 0.01, y), ground)
    cell.block("block", size, (front + 0.1, y), ground, mass=0.2, color=ORANGE)
    for k in range(draw.integer(1, 2)):
        width = draw.uniform(0.04, 0.055)
        at = (front + 0.02, y + (0.0, draw.side() * 0.09)[k])
        cell.block(f"front_{k}", (width, width, draw.uniform(0.08, 0.12)), at, ground, removable=True)
    goal = (draw.uniform(0.48, 0.56), draw.side() * draw.uniform(0.33, 0.4))
    cell.goal("block", goal, ground + size[2] / 2)


FAMILIES = solvable(two_on_goal, jars_in_cabinet, unstack_and_stack, below_others, behind_others)
