"""Families of tasks that need a tool, because no hand fits where the object is."""

from collections.abc import Callable
from typing import Any

from hmap_core.benchmark.generality.cell import ORANGE, Cell, Sampler
from hmap_core.benchmark.generality.family import solvable

GREEN = (0.2, 0.5, 0.3, 1.0)
THICK = 0.022  # m, of the rake; sticks are longer by 0.07 m than what is in the tunnel at the end, for the hand


def rake_under_shelf(cell: Cell, draw: Sampler) -> None:
    """Pull a block from under a low shelf with a rake."""
    width, side = draw.uniform(0.04, 0.055), draw.side()
    edge, under = draw.uniform(0.56, 0.6), draw.uniform(0.066, 0.075)
    start = (edge + draw.uniform(0.08, 0.1), draw.uniform(-0.05, 0.05))
    goal = (edge - draw.uniform(0.09, 0.12), start[1] + draw.uniform(-0.02, 0.02))
    cell.table().panda()
    legs = [(edge + 0.01, 0.29), (edge + 0.01, -0.29), (edge + 0.27, 0.29), (edge + 0.27, -0.29)]
    for k, at in enumerate(legs):
        cell.box(f"leg_{k}", (0.02, 0.02, under), at)
    cell.box("shelf", (0.28, 0.6, 0.02), (edge + 0.14, 0.0), under)
    friction = draw.uniform(0.5, 0.7)
    cell.block("block", (width, width, width), start, yaw=draw.angle(-8, 8), mass=0.15, friction=friction, color=ORANGE)
    shaft, bar, grip = 0.22, draw.uniform(0.13, 0.17), THICK / 2 + 0.001
    parts = [
        {"shape": "box", "size": [shaft + THICK, THICK, THICK], "pose": {"xyz": [shaft / 2, 0.0, 0.0]}},
        {"shape": "box", "size": [THICK, bar, THICK], "pose": {"xyz": [shaft, 0.0, 0.0]}},
        {"shape": "box", "size": [THICK, THICK, 0.1], "pose": {"xyz": [0.0, 0.0, THICK / 2 + 0.05]}},
    ]
    pose: dict[str, Any] = {"xyz": [draw.uniform(0.26, 0.31), side * draw.uniform(0.28, 0.34), THICK / 2]}
    pose["rpy_deg"] = [0.0, 0.0, side * draw.angle(0, 30)]
    handle = [[[-grip, -grip, THICK / 2 + 0.01], [grip, grip, THICK / 2 + 0.101]]]
    cell.add_body("rake", parts, pose, tool=True, mass=0.12, friction=1.0, graspable=handle, color=GREEN)
    cell.goal("block", goal, width / 2, tolerance=0.01, degrees=5.0)


def stick_in_holder(cell: Cell, draw: Sampler) -> None:
    """Push a block out of a tunnel with a stick that stands in a holder."""
    width, side = draw.uniform(0.04, 0.05), draw.side()
    cell.table().panda()
    add_block = tunnel(cell, draw, width, side, lengths=(0.16, 0.2), headroom=0.012)
    stick, tall = draw.uniform(0.024, 0.03), draw.uniform(0.3, 0.34)
    holder = (draw.uniform(0.36, 0.42), -side * draw.uniform(0.3, 0.36))
    add_holder(cell, stick, holder)
    cell.block("stick", (stick, stick, tall), holder, tool=True, movable=False, mass=0.12, friction=0.9, color=GREEN)
    add_block(mass=0.12)


def tunnel(
    cell: Cell, draw: Sampler, width: float, side: int, lengths: tuple[float, float], headroom: float
) -> Callable[..., None]:
    """Add a tunnel for a block of a width; returns what adds the block (``mass`` in kg) in it, and its goal outside."""
    room, length = draw.uniform(0.006, 0.01), draw.uniform(*lengths)
    x, y = draw.uniform(0.48, 0.54), side * draw.uniform(0.0, 0.04)
    height = width + headroom
    values = {"length": length, "inner_width": width + 2 * room, "height": height, "wall": 0.015, "roof": 0.02}
    cell.add_object("tunnel", "tunnel", {"xyz": [x, y, 0.0], "rpy_deg": [0.0, 0.0, 90.0]}, values=values)

    def add_block(mass: float) -> None:
        start = (x, y - side * draw.uniform(0.0, 0.03))
        goal = (x, y + side * (length / 2 + width / 2 + draw.uniform(0.01, 0.03)))
        cell.block("block", (width, width, width), start, mass=mass, friction=0.5, color=ORANGE)
        cell.goal("block", goal, width / 2, tolerance=0.01, degrees=5.0)

    return add_block


def add_holder(cell: Cell, width: float, at: tuple[float, float]) -> None:
    """Add four walls, 50 mm high, in which a stick of a width in m stands with 2 mm of room on each side."""
    values = {"span_x": width + 0.014, "span_y": width + 0.014, "wall": 0.01, "top": 0.05}
    cell.add_object("holder", "tray", (*at, 0.0), values=values)


def stick_into_tunnel(cell: Cell, draw: Sampler) -> None:
    """Push a block out of a tunnel with a stick that lies on the table."""
    width, side = draw.uniform(0.04, 0.055), draw.side()
    cell.table().panda()
    add_block = tunnel(cell, draw, width, side, lengths=(0.18, 0.22), headroom=0.015)
    stick, long = draw.uniform(0.03, width), draw.uniform(0.34, 0.38)
    at = (draw.uniform(0.3, 0.36), -side * draw.uniform(0.25, 0.35))
    options: dict[str, Any] = {"tool": True, "movable": False, "mass": 0.15, "friction": 0.9, "color": GREEN}
    cell.block("stick", (stick, long, stick), at, yaw=draw.angle(-20, 20), **options)
    add_block(mass=0.15)


FAMILIES = solvable(rake_under_shelf, stick_in_holder, stick_into_tunnel)
