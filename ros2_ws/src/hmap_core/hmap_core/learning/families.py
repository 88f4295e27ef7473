"""Families of scenes for the data set: drawn at random, by other generators than those of ``hmap bench generality``."""

import math
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

from hmap_core.benchmark.generality.cell import ORANGE, Cell, Point, Sampler
from hmap_core.exceptions import HmapError, InputError
from hmap_core.scenes import load_scene
from hmap_core.types import Scene

GREEN = (0.2, 0.5, 0.3, 1.0)
ARMS = ("panda", "panda", "xarm6", "ur5e_2f85")
NEARER = {"xarm6": 0.08, "ur5e_2f85": 0.04, "panda": 0.0}  # m that everything stands nearer to shorter arms
TASKS = ("bolt", "bookshelf", "bookshelf_mini", "tunnel", "tunnel_tool", "puck_around", "puck_move")
Build = Callable[[Cell, Sampler], None]


def _arm(cell: Cell, draw: Sampler, x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> float:
    """Add an arm; how much nearer to it things have to stand, m."""
    model = draw.choice(ARMS)
    cell.robot("arm", model, x, y, 0.0, yaw)
    return NEARER[model]


def shelf(cell: Cell, draw: Sampler) -> None:
    """A book among others on a board: to another gap, or to another depth."""
    cell.table()
    near = _arm(cell, draw)
    board, front = draw.uniform(0.12, 0.5), draw.uniform(0.42, 0.56) - near
    thick, deep, tall = draw.uniform(0.03, 0.065), draw.uniform(0.12, 0.2), draw.uniform(0.12, 0.22)
    cell.box("board", (deep + 0.3, 1.0, 0.02), (front + deep / 2 - 0.06, 0.0), board - 0.02)
    if draw.choice((True, False)):
        cell.box(
            "upper", (deep + 0.1, 1.0, 0.02), (front + deep / 2 + 0.03, 0.0), board + tall + draw.uniform(0.05, 0.2)
        )
    if draw.choice((True, False)):
        cell.box("back", (0.02, 1.0, tall + 0.1), (front + deep + 0.1, 0.0), board)
    slot = draw.uniform(-0.22, 0.05)
    other = slot + thick + draw.uniform(0.1, 0.25)
    pulled = draw.choice((True, False))  # out of its gap; else along the board to another place
    x = front + deep / 2
    for k, (at, side) in enumerate(((slot, -1), (slot, 1), (other, -1), (other, 1))):
        width = draw.uniform(0.02, 0.05)
        y = at + side * (thick / 2 + draw.uniform(0.006, 0.03) + width / 2)
        if k in ((2, 3) if pulled else (1, 2)):
            continue
        cell.box(f"book_{k}", (deep, width, draw.uniform(0.6, 1.0) * tall), (x, y), board)
    out = draw.uniform(0.0, 0.05)
    start = (x - out, slot)
    goal = (x - out - draw.uniform(0.08, 0.16), slot) if pulled else (x - out, other)
    if draw.choice((True, False)):
        start, goal = goal, start
    mass, friction = draw.uniform(0.1, 0.4), draw.uniform(0.4, 0.9)
    cell.block("book", (deep, thick, tall), start, board, mass=mass, friction=friction, color=ORANGE)
    cell.goal("book", goal, board + tall / 2)


def tunnel(cell: Cell, draw: Sampler) -> None:
    """A bar or block in a covered passage, with sticks and short blocks as tools."""
    cell.table()
    near = _arm(cell, draw)
    width, tall = draw.uniform(0.035, 0.07), draw.uniform(0.035, 0.07)
    length = draw.uniform(0.16, 0.34)
    long = draw.choice((width, draw.uniform(width, length)))
    yaw = math.radians(draw.angle(60, 120) * draw.side())
    way = (math.cos(yaw), math.sin(yaw))
    at = (draw.uniform(0.4, 0.52) - near, draw.uniform(-0.12, 0.12))
    room, headroom = draw.uniform(0.004, 0.02), draw.uniform(0.006, 0.04)
    values = {"length": length, "inner_width": width + 2 * room, "height": tall + headroom, "wall": 0.02, "roof": 0.02}
    where = {"xyz": [*at, 0.0], "rpy_deg": [0.0, 0.0, round(math.degrees(yaw), 1)]}
    cell.add_object("passage", "tunnel", where, values=values)
    first, last = draw.uniform(-0.3, 0.3) * max(length - long, 0.0), length / 2 + long * draw.uniform(-0.1, 0.6) + 0.02
    start, goal = ((round(at[0] + s * way[0], 4), round(at[1] + s * way[1], 4)) for s in (first, last))
    degrees = round(math.degrees(yaw), 1)
    mass, friction = draw.uniform(0.08, 0.25), draw.uniform(0.4, 0.8)
    cell.block("bar", (long, width, tall), start, yaw=degrees, mass=mass, friction=friction, color=ORANGE)
    cell.goal("bar", goal, tall / 2, (0, 0, degrees), tolerance=0.01, degrees=5.0)
    _tools(cell, draw, [(at, 0.24), (goal, 0.12)], near, min(width, 0.06), draw.integer(1, 3))


def _tools(cell: Cell, draw: Sampler, taken: list, near: float, thick: float, count: int) -> None:
    """Add sticks, hooks, pawns and short blocks on the table."""
    for k in range(count):
        spot = draw.spot_apart(taken, radius=(0.3, 0.6 - near), angle=(-100.0, 100.0))
        if spot is None:
            continue
        taken.append((spot, 0.16))
        _tool(cell, draw, f"tool_{k}", spot, draw.uniform(0.02, thick))


def _tool(cell: Cell, draw: Sampler, name: str, spot: Point, thick: float) -> None:
    """Add one tool of a thickness in m."""
    options: dict[str, Any] = {"tool": True, "mass": draw.uniform(0.08, 0.2), "friction": 0.9, "color": GREEN}
    kind = draw.choice(("stick", "stick", "stick", "block", "pawn", "hook", "standing"))
    yaw = draw.angle()
    if kind == "pawn":
        values = {"width": draw.uniform(0.035, 0.06), "height": draw.uniform(0.02, 0.045)}
        values |= {"handle": draw.uniform(0.014, 0.022), "handle_length": draw.uniform(0.08, 0.14)}
        values["handle_z"] = round((values["height"] + values["handle_length"]) / 2, 4)
        place = {"xyz": [*spot, values["height"] / 2], "rpy_deg": [0.0, 0.0, yaw]}
        cell.add_object(name, "pawn", place, values=values, tool=True, friction=0.9)
    elif kind == "hook":
        shaft, bar = draw.uniform(0.15, 0.3), draw.uniform(0.08, 0.16)
        parts = [
            {"shape": "box", "size": [shaft, thick, thick], "pose": {"xyz": [shaft / 2, 0.0, 0.0]}},
            {"shape": "box", "size": [thick, bar, thick], "pose": {"xyz": [shaft, 0.0, 0.0]}},
        ]
        cell.add_body(name, parts, {"xyz": [*spot, thick / 2], "rpy_deg": [0.0, 0.0, yaw]}, **options)
    else:
        long = {"stick": draw.uniform(0.2, 0.42), "block": draw.uniform(0.04, 0.08), "standing": thick}[kind]
        tall = draw.uniform(0.15, 0.3) if kind == "standing" else thick
        cell.block(name, (long, thick, tall), spot, yaw=yaw, movable=False, **options)


def tray(cell: Cell, draw: Sampler) -> None:
    """A wide or flat thing slides among walls, thin or wide, perhaps round a post; tools stand by."""
    cell.table()
    near = _arm(cell, draw)
    middle = (draw.uniform(0.42, 0.54) - near, draw.uniform(-0.1, 0.1))
    wall, top = draw.uniform(0.015, 0.1), draw.uniform(0.02, 0.12)
    span = (draw.uniform(0.32, 0.5) + wall, draw.uniform(0.38, 0.9) + wall)
    values = {"span_x": span[0], "span_y": span[1], "wall": wall, "top": top}
    cell.add_object("walls", "tray", (*middle, 0.0), values=values)
    width, tall = draw.uniform(0.05, 0.12), draw.uniform(0.02, 0.09)
    half = ((span[0] - wall - width) / 2 - 0.02, (span[1] - wall - width) / 2 - 0.02)
    inside = [
        (middle[0] + draw.uniform(-half[0], half[0]), middle[1] + side * draw.uniform(0.2, 1.0) * half[1])
        for side in (-1, 1)
    ]
    if draw.choice((True, False)):
        inside.reverse()
    start, goal = ((round(x, 4), round(y, 4)) for x, y in inside)
    if draw.choice((True, False)):
        post = (round(middle[0] + draw.uniform(-0.08, 0.08), 4), round(middle[1], 4))
        size = (draw.uniform(0.02, 0.25), draw.uniform(0.02, 0.16), draw.uniform(0.02, 0.12))
        cell.box("post", size, post)
    yaw, friction = draw.angle(-30, 30), draw.uniform(0.4, 0.8)
    if draw.choice((True, False)):
        values = {"width": width, "height": tall}
        place = {"xyz": [*start, tall / 2], "rpy_deg": [0.0, 0.0, yaw]}
        cell.add_object("piece", "octagon", place, values=values, movable=True, mass=0.2, friction=friction)
    else:
        size = (width, draw.uniform(0.6, 1.0) * width, tall)
        cell.block("piece", size, start, yaw=yaw, mass=draw.uniform(0.1, 0.4), friction=friction, color=ORANGE)
    cell.goal("piece", goal, tall / 2, (0, 0, yaw), tolerance=0.01, degrees=10.0)
    _tools(cell, draw, [(start, 0.13), (goal, 0.13), (middle, 0.1)], near, 0.045, draw.integer(1, 2))


def clutter(cell: Cell, draw: Sampler) -> None:
    """A thing close among others, which may be removed."""
    cell.table()
    near = _arm(cell, draw)
    ring = {"radius": (0.36, 0.58 - near), "angle": (-50.0, 50.0)}
    start = draw.spot(**ring)
    goal = draw.spot_apart([(start, 0.2)], **ring) or (start[0], -start[1])
    size = (draw.uniform(0.03, 0.09), draw.uniform(0.03, 0.07), draw.uniform(0.03, 0.14))
    cell.block("thing", size, start, yaw=draw.angle(), mass=draw.uniform(0.1, 0.4), color=ORANGE)
    taken = [(start, 0.5 * math.hypot(size[0], size[1]) + 0.045), (goal, 0.08)]
    for k in range(draw.integer(4, 12)):
        wide, tall = draw.uniform(0.02, 0.06), draw.uniform(0.03, 0.16)
        near_start = (round(start[0] + draw.uniform(-0.13, 0.13), 4), round(start[1] + draw.uniform(-0.13, 0.13), 4))
        if any(math.dist(near_start, spot) < gap + 0.5 * wide for spot, gap in taken):
            continue
        taken.append((near_start, 0.8 * wide))
        may_go = draw.choice((True, False))
        if draw.choice((True, False)):
            cell.can(f"can_{k}", wide / 2, tall, near_start, mass=0.15, removable=may_go)
        else:
            cell.block(
                f"other_{k}", (wide, wide, tall), near_start, yaw=draw.angle(-20, 20), mass=0.15, removable=may_go
            )
    cell.goal("thing", goal, size[2] / 2, (0, 0, draw.angle()))


def bin(cell: Cell, draw: Sampler) -> None:
    """A thing in a bin with high walls, perhaps in its corner: out of it, or to its other end."""
    cell.table()
    near = _arm(cell, draw)
    middle = (draw.uniform(0.4, 0.52) - near, draw.side() * draw.uniform(0.05, 0.25))
    span, top = (draw.uniform(0.18, 0.36), draw.uniform(0.18, 0.36)), draw.uniform(0.05, 0.16)
    cell.add_object(
        "bin", "tray", (*middle, 0.0), values={"span_x": span[0], "span_y": span[1], "wall": 0.015, "top": top}
    )
    size = (draw.uniform(0.025, 0.06), draw.uniform(0.025, 0.06), draw.uniform(0.025, 0.12))
    room = [s / 2 - 0.5 * math.hypot(size[0], size[1]) - 0.012 for s in span]
    spots: list[Point] = []
    for k in range(draw.integer(1, 5)):
        x, y = (round(m + draw.uniform(-r, r), 4) for m, r in zip(middle, room, strict=True))
        spot = (x, y)
        if any(math.dist(spot, other) < 0.09 for other in spots):
            continue
        spots.append(spot)
        color: dict[str, Any] = {"color": ORANGE} if k == 0 else {}
        other = size if k == 0 else (draw.uniform(0.025, 0.05), draw.uniform(0.025, 0.05), draw.uniform(0.025, 0.1))
        cell.block("thing" if k == 0 else f"other_{k}", other, spot, yaw=draw.angle(), mass=0.15, **color)
    outside = (round(0.42 - near + draw.uniform(-0.05, 0.1), 4), round(-middle[1] - math.copysign(0.12, middle[1]), 4))
    cell.goal("thing", outside, size[2] / 2, (0, 0, draw.angle(-90, 90)))


def under_shelf(cell: Cell, draw: Sampler) -> None:
    """A thing under a low board or against a wall, which a tool may bring out."""
    cell.table()
    near = _arm(cell, draw)
    edge, low = draw.uniform(0.42, 0.54) - near, draw.uniform(0.05, 0.12)
    width, tall = draw.uniform(0.03, 0.07), draw.uniform(0.02, min(0.06, low - 0.012))
    deep = draw.uniform(0.14, 0.28)
    cell.box("board", (deep, 0.6, 0.02), (edge + deep / 2, 0.0), low)
    for k, y in enumerate((-0.29, 0.29)):
        cell.box(f"leg_{k}", (deep, 0.02, low), (edge + deep / 2, y))
    if draw.choice((True, False)):
        cell.box("back", (0.02, 0.6, low), (edge + deep + 0.01, 0.0))
    start = (edge + draw.uniform(0.02, 0.8) * (deep - width), draw.uniform(-0.16, 0.16))
    pulled = draw.choice((True, True, False))
    goal = (edge - draw.uniform(0.06, 0.14), start[1] + draw.uniform(-0.03, 0.03))
    if not pulled:
        goal = (start[0], round(start[1] - math.copysign(draw.uniform(0.08, 0.2), start[1]), 4))
    mass, friction = draw.uniform(0.08, 0.25), draw.uniform(0.4, 0.8)
    cell.block(
        "thing", (width, width, tall), start, yaw=draw.angle(-20, 20), mass=mass, friction=friction, color=ORANGE
    )
    cell.goal("thing", goal, tall / 2, tolerance=0.01, degrees=10.0)
    _tools(cell, draw, [(start, 0.1), (goal, 0.12), ((edge + deep / 2, 0.0), 0.34)], near, 0.03, draw.integer(1, 2))


def two_arms(cell: Cell, draw: Sampler) -> None:
    """A thing between two arms, which either of them may reach, past a wall or in a passage."""
    apart = draw.uniform(0.8, 1.35)
    cell.table().robot("arm", "panda")
    if draw.choice((True, False)):
        cell.robot("arm_2", "panda", x=apart, yaw=180.0)
    else:
        cell.robot("arm_2", "panda", x=0.5, y=-apart / 2 - 0.2, yaw=90.0)
    start = (draw.uniform(0.32, apart - 0.32), draw.side() * draw.uniform(0.08, 0.25))
    goal = (draw.uniform(0.32, apart - 0.32), -start[1] + draw.uniform(-0.1, 0.1))
    size = (draw.uniform(0.04, 0.16), draw.uniform(0.03, 0.07), draw.uniform(0.03, 0.1))
    if draw.choice((True, False)):
        cell.wall("wall", (0.3, 0.0), (apart - 0.3, 0.0), draw.uniform(0.05, 0.2))
    else:
        values = {"length": 0.18, "inner_width": size[1] + 0.02, "height": size[2] + 0.02, "wall": 0.02, "roof": 0.02}
        cell.add_object("passage", "tunnel", {"xyz": [*start, 0.0], "rpy_deg": [0.0, 0.0, 90.0]}, values=values)
        _tools(cell, draw, [(start, 0.2), (goal, 0.15)], 0.0, 0.04, 1)
    cell.block("thing", size, start, yaw=90.0, mass=draw.uniform(0.1, 0.3), color=ORANGE)
    cell.goal("thing", goal, size[2] / 2, (0, 0, 90.0), tolerance=0.01, degrees=5.0)


BUILDS: dict[str, Build] = {
    build.__name__: build for build in (shelf, tunnel, tray, clutter, bin, under_shelf, two_arms)
}
FAMILIES = (*BUILDS, "tasks")


def family_of(number: int, families: tuple[str, ...] = FAMILIES) -> str:
    """The family of the scene with a number: they take turns."""
    return families[number % len(families)]


def make_scene(family: str, seed: int) -> tuple[Scene, str] | None:
    """The scene of a family and a seed, and the text of its task file; None where what was drawn is no scene.

    Raises:
        InputError: there is no such family.
    """
    if family == "tasks":
        task = TASKS[seed % len(TASKS)]
        return load_scene(task, seed), f"# hmap task {task}, seed {seed}\n"
    if family not in BUILDS:
        raise InputError(f"unknown family {family!r}; there are {', '.join(FAMILIES)}")
    cell = Cell(f"{family}-{seed}", (BUILDS[family].__doc__ or "").strip())
    try:
        BUILDS[family](cell, Sampler(np.random.default_rng((zlib.crc32(b"data " + family.encode()), seed))))
        return cell.build(), cell.to_yaml()
    except HmapError:
        return None
