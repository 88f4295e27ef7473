"""Families of tasks for two Pandas: a bar handed over, a window, a shared table, a bar for both."""

from hmap_core.benchmark.generality.cell import ORANGE, Cell, Sampler
from hmap_core.benchmark.generality.family import solvable


def facing(cell: Cell, distance: float) -> None:
    """Add two Pandas that face each other along x."""
    cell.panda("near").panda("far", x=distance, yaw=180.0)


def bar_handed_over(cell: Cell, draw: Sampler) -> None:
    """Pass a bar from one arm to the other over a gap between two tables."""
    apart, gap = draw.uniform(1.44, 1.54), draw.uniform(0.45, 0.62)
    length, thick = draw.uniform(0.22, 0.3), draw.uniform(0.034, 0.045)
    edge = round((apart - gap) / 2, 4)
    cell.box("table_near", (edge + 0.2, 1.0, 0.05), ((edge - 0.2) / 2, 0.0), -0.05)
    cell.box("table_far", (edge + 0.2, 1.0, 0.05), (apart - (edge - 0.2) / 2, 0.0), -0.05)
    facing(cell, apart)
    room = edge - thick / 2 - 0.01
    start = (draw.uniform(room - 0.07, room), draw.uniform(-0.18, 0.18))
    goal = (apart - draw.uniform(room - 0.07, room), draw.uniform(-0.18, 0.18))
    mass, yaw = draw.uniform(0.1, 0.3), 90 + draw.angle(-5, 5)
    cell.block("bar", (length, thick, thick), start, yaw=yaw, mass=mass, friction=0.8, color=ORANGE)
    cell.goal("bar", goal, thick / 2, (0, 0, 90))


def through_window(cell: Cell, draw: Sampler) -> None:
    """Bring a block through a window in a high wall between two arms; the sill carries it while the hands change."""
    size = (draw.uniform(0.04, 0.055), draw.uniform(0.04, 0.055), draw.uniform(0.09, 0.12))
    thick, sill = draw.uniform(0.09, 0.14), draw.uniform(0.16, 0.26)
    wide, high, y = draw.uniform(0.32, 0.4), draw.uniform(0.34, 0.4), draw.uniform(-0.08, 0.08)
    side, apart = draw.side(), draw.uniform(1.14, 1.24)
    x, top = apart / 2, 1.0
    cell.table(length=3.0, x=x)
    cell.box("wall_below", (thick, 1.6, sill), (x, 0.0))
    cell.box("wall_above", (thick, 1.6, top - sill - high), (x, 0.0), sill + high)
    cell.box("wall_left", (thick, 0.8 - y - wide / 2, high), (x, (0.8 + y + wide / 2) / 2), sill)
    cell.box("wall_right", (thick, 0.8 + y - wide / 2, high), (x, (-0.8 + y - wide / 2) / 2), sill)
    facing(cell, apart)
    start = (draw.uniform(0.32, 0.4), side * draw.uniform(0.05, 0.3))
    goal = (apart - draw.uniform(0.32, 0.4), -side * draw.uniform(0.05, 0.3))
    cell.block("block", size, start, mass=draw.uniform(0.1, 0.25), color=ORANGE)
    cell.goal("block", goal, size[2] / 2)


def relay_over_table(cell: Cell, draw: Sampler) -> None:
    """Bring a block over a long table on which each of two arms reaches one half."""
    size = (draw.uniform(0.04, 0.06), draw.uniform(0.04, 0.06), draw.uniform(0.05, 0.1))
    apart, side = draw.uniform(1.1, 1.25), draw.side()
    cell.table(length=3.0, x=apart / 2)
    facing(cell, apart)
    start = (draw.uniform(0.05, 0.3), side * draw.uniform(0.35, 0.45))
    goal = (apart - draw.uniform(0.05, 0.3), -side * draw.uniform(0.35, 0.45))
    for k in range(draw.integer(0, 3)):
        spot = (apart / 2 + draw.uniform(-0.05, 0.05), draw.choice((-0.32, 0.32)) + 0.11 * (k - 1))
        cell.can(f"other_{k}", 0.025, 0.06, spot)
    cell.block("block", size, start, yaw=draw.angle(), mass=draw.uniform(0.1, 0.4), color=ORANGE)
    cell.goal("block", goal, size[2] / 2, (0, 0, draw.angle()))


def bar_for_two(cell: Cell, draw: Sampler) -> None:
    """Lift a bar that is too heavy for one arm with two arms side by side, and lay it on two posts."""
    length, thick = draw.uniform(0.8, 1.0), draw.uniform(0.04, 0.05)
    mass, posts = draw.uniform(3.6, 4.6), draw.uniform(0.1, 0.16)
    cell.table(length=2.4, width=2.6)
    cell.panda("left", y=0.4).panda("right", y=-0.4)
    start, goal = draw.uniform(0.38, 0.44), draw.uniform(0.54, 0.6)
    for name, y in (("left", 0.12), ("right", -0.12)):
        cell.box(f"post_{name}", (0.07, 0.07, posts), (goal, y))
    cell.block("bar", (thick, length, thick), (start, draw.uniform(-0.02, 0.02)), mass=mass, friction=0.9, color=ORANGE)
    cell.goal("bar", (goal, 0.0), posts + thick / 2, tolerance=0.01, degrees=3.0)


FAMILIES = solvable(bar_handed_over, through_window, relay_over_table, bar_for_two)
