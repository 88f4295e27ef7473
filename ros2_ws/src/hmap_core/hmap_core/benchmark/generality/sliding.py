"""Families of tasks with flat bodies, and with contacts of the object and walls, neighbours, or holes."""

from typing import Any

from hmap_core.benchmark.generality.cell import ORANGE, Cell, Sampler
from hmap_core.benchmark.generality.everyday import TOLERANT, two_spots
from hmap_core.benchmark.generality.family import solvable

ROUND: dict[str, Any] = {"tolerance": 0.01, "degrees": 180.0}  # of the goals of discs


def disc_on_table(cell: Cell, draw: Sampler) -> None:
    """Slide a disc that is too wide for the gripper round a post."""
    radius, height = draw.uniform(0.045, 0.06), draw.uniform(0.025, 0.035)
    side, x = draw.side(), draw.uniform(0.46, 0.54)
    start = (x + draw.uniform(-0.03, 0.03), side * draw.uniform(0.16, 0.22))
    goal = (x + draw.uniform(-0.03, 0.03), -side * draw.uniform(0.16, 0.22))
    cell.table().panda()
    cell.box("post", (0.05, 0.05, draw.uniform(0.05, 0.15)), (x, draw.uniform(-0.02, 0.02)))
    cell.can("disc", radius, height, start, mass=draw.uniform(0.1, 0.3), friction=0.5, color=ORANGE)
    cell.goal("disc", goal, height / 2, **ROUND)


def plate_on_table(cell: Cell, draw: Sampler) -> None:
    """Drag a thin plate over a table."""
    size = (draw.uniform(0.1, 0.13), draw.uniform(0.1, 0.13), draw.uniform(0.006, 0.012))
    start, goal = two_spots(draw, 0.12, radius=(0.42, 0.56), angle=(-35, 35))
    yaw = draw.angle(-45, 45)
    cell.table().panda()
    cell.block("plate", size, start, yaw=yaw, mass=draw.uniform(0.08, 0.2), friction=0.5, color=ORANGE)
    cell.goal("plate", goal, size[2] / 2, (0, 0, yaw + draw.angle(-15, 15)), **TOLERANT)


def along_wall(cell: Cell, draw: Sampler) -> None:
    """Push a box that is too wide for the gripper along a wall."""
    size = (draw.uniform(0.1, 0.14), draw.uniform(0.1, 0.14), draw.uniform(0.05, 0.09))
    wall, side = draw.uniform(0.6, 0.64), draw.side()
    x = wall - size[0] / 2 - draw.uniform(0.001, 0.003)
    start = (x, -side * draw.uniform(0.06, 0.14))
    goal = (x, side * draw.uniform(0.06, 0.14))
    cell.table().panda()
    cell.wall("wall", (wall + 0.01, -0.5), (wall + 0.01, 0.5), draw.uniform(0.06, 0.15))
    cell.block("box", size, start, mass=draw.uniform(0.2, 0.5), friction=0.4, color=ORANGE)
    cell.goal("box", goal, size[2] / 2, **TOLERANT)


def book_out_of_row(cell: Cell, draw: Sampler) -> None:
    """Take a book out of a row in which it is flush with its neighbours, and lay or stand it elsewhere."""
    thick, deep, high = draw.uniform(0.03, 0.045), draw.uniform(0.1, 0.13), draw.uniform(0.16, 0.19)
    ground, gap, side = draw.uniform(0.1, 0.18), draw.uniform(0.002, 0.004), draw.side()
    x, y = draw.uniform(0.54, 0.58), side * draw.uniform(0.02, 0.08)
    cell.table().panda()
    cell.box("platform", (0.4, 1.2, ground), (0.6, 0.0))
    for k, sign in enumerate((-1, 1)):
        near = sign * (thick + gap + 0.0)
        cell.box(f"near_{k}", (deep, thick, high), (x, y + near), ground)
        cell.box(f"far_{k}", (deep, thick, high), (x, y + near + sign * (thick + gap)), ground)
    cell.box("back", (0.02, 5 * thick + 4 * gap, high), (x + deep / 2 + 0.012, y), ground)
    mass = draw.uniform(0.15, 0.3)
    cell.block("book", (deep, thick, high), (x, y), ground, mass=mass, friction=0.6, color=ORANGE)
    cell.goal("book", (draw.uniform(0.48, 0.54), -side * draw.uniform(0.25, 0.35)), ground + high / 2)


def book_sticks_out(cell: Cell, draw: Sampler) -> None:
    """Move a book that sticks out of a row to another gap of the row."""
    thick, deep, high = draw.uniform(0.03, 0.05), draw.uniform(0.12, 0.15), draw.uniform(0.14, 0.18)
    ground, gap, out = draw.uniform(0.16, 0.24), draw.uniform(0.006, 0.01), draw.uniform(0.035, 0.05)
    x, y, side = draw.uniform(0.58, 0.62), draw.uniform(-0.06, 0.06), draw.side()
    cell.table().panda()
    cell.box("platform", (0.44, 1.2, ground), (0.64, 0.0))
    pitch = thick + gap
    for k in range(-2, 4):
        if k not in (0, 2):
            cell.box(f"book_{k + 2}", (deep, thick, high), (x, y + side * k * pitch), ground)
    mass = draw.uniform(0.15, 0.3)
    cell.block("book", (deep, thick, high), (x - out, y), ground, mass=mass, friction=0.6, color=ORANGE)
    cell.goal("book", (x - out, y + side * 2 * pitch), ground + high / 2)


def peg_in_hole(cell: Cell, draw: Sampler) -> None:
    """Move a peg from one hole to another, with 1 to 2 mm of room on each side."""
    width, height = draw.uniform(0.03, 0.045), draw.uniform(0.09, 0.12)
    room, deep = draw.uniform(0.001, 0.002), draw.uniform(0.03, 0.045)
    start, goal = two_spots(draw, 0.18, radius=(0.42, 0.56))
    yaws = draw.angle(), draw.angle()
    cell.table().panda()
    span = width + 2 * room + 0.02
    for k, (spot, yaw) in enumerate(zip((start, goal), yaws, strict=True)):
        at = {"xyz": [*spot, 0.0], "rpy_deg": [0.0, 0.0, yaw]}
        values = {"span_x": span, "span_y": span, "wall": 0.02, "top": deep}
        cell.add_object(f"hole_{k}", "tray", at, values=values)
    cell.block("peg", (width, width, height), start, yaw=yaws[0], friction=0.6, color=ORANGE)
    cell.goal("peg", goal, height / 2, (0, 0, yaws[1]), tolerance=0.002)


def box_round_corner(cell: Cell, draw: Sampler) -> None:
    """Push a box that is too wide for the gripper past the end of a wall."""
    size = (draw.uniform(0.09, 0.12), draw.uniform(0.09, 0.12), draw.uniform(0.05, 0.08))
    side, x = draw.side(), draw.uniform(0.44, 0.48)
    start = (x + 0.11, side * draw.uniform(0.1, 0.14))
    goal = (x + 0.11, -side * draw.uniform(0.1, 0.14))
    cell.table().panda()
    cell.wall("wall", (x + 0.1, 0.0), (x + 0.4, 0.0), draw.uniform(0.04, 0.06))
    cell.block("box", size, start, mass=draw.uniform(0.15, 0.4), friction=0.4, color=ORANGE)
    cell.goal("box", goal, size[2] / 2, **TOLERANT)


def card_over_edge(cell: Cell, draw: Sampler) -> None:
    """Pick a thin card that lies flat on a slab, and put it on a narrow pedestal."""
    card = (draw.uniform(0.08, 0.09), draw.uniform(0.1, 0.12), draw.uniform(0.004, 0.006))
    top, higher, side = draw.uniform(0.16, 0.24), draw.uniform(0.04, 0.1), draw.side()
    start = (draw.uniform(0.46, 0.52), side * draw.uniform(-0.1, -0.02))
    cell.table().panda()
    cell.box("slab", (0.4, 0.48, 0.04), (0.57, side * -0.04), top - 0.04, friction=0.5)
    cell.box("foot", (0.2, 0.2, top - 0.04), (0.6, side * -0.04))
    goal = (draw.uniform(0.42, 0.47), side * 0.42)
    cell.box("pedestal", (card[0] - 0.04, card[1] - 0.04, top + higher), goal)
    mass = draw.uniform(0.04, 0.08)
    cell.block("card", card, start, top, draw.angle(-8, 8), mass=mass, friction=0.6, color=ORANGE)
    cell.goal("card", goal, top + higher + card[2] / 2, tolerance=0.015, degrees=8.0)


def peg_out_of_groove(cell: Cell, draw: Sampler) -> None:
    """Take a peg out of a groove that is open at one end and as deep as the peg is high, and stand it elsewhere."""
    wide, long, high = draw.uniform(0.035, 0.045), draw.uniform(0.09, 0.11), draw.uniform(0.03, 0.035)
    gap, side = draw.uniform(0.002, 0.003), draw.side()
    x, y = draw.uniform(0.5, 0.54), side * draw.uniform(0.08, 0.16)
    cell.table().panda()
    for name, sign in (("left", 1), ("right", -1)):
        cell.box(f"rail_{name}", (long + 0.02, 0.06, high), (x, y + sign * (wide / 2 + gap + 0.03)))
    cell.box("end", (0.02, wide + 2 * gap, high), (x + long / 2 + gap + 0.01, y))
    cell.block("peg", (long, wide, high), (x, y), mass=draw.uniform(0.1, 0.2), friction=0.6, color=ORANGE)
    cell.goal("peg", (draw.uniform(0.44, 0.5), -side * draw.uniform(0.12, 0.2)), high / 2, tolerance=0.01)


FAMILIES = solvable(
    disc_on_table,
    plate_on_table,
    along_wall,
    book_out_of_row,
    book_sticks_out,
    peg_in_hole,
    box_round_corner,
    card_over_edge,
    peg_out_of_groove,
)
