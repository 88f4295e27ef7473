"""Families of tasks without a solution: they have to be refused, with the reason."""

from hmap_core.benchmark.generality.cell import ORANGE, Cell, Sampler
from hmap_core.benchmark.generality.family import refused
from hmap_core.benchmark.generality.other_arms import IIWA_RAISED
from hmap_core.exceptions import Code


def beyond_the_arm(cell: Cell, draw: Sampler) -> None:
    """The goal is beyond the reach of the arm."""
    start, goal = draw.spot(), draw.spot((1.15, 1.4))
    width = draw.uniform(0.04, 0.06)
    cell.table(length=4.0, width=4.0).panda()
    cell.block("block", (width, width, 0.06), start, yaw=draw.angle(), color=ORANGE)
    cell.goal("block", goal, 0.03)


def too_heavy(cell: Cell, draw: Sampler) -> None:
    """A block that is far too heavy for the arm has to be lifted on a step."""
    side, step = draw.side(), draw.uniform(0.06, 0.15)
    width, height = draw.uniform(0.05, 0.065), draw.uniform(0.08, 0.12)
    goal = (draw.uniform(0.45, 0.55), side * draw.uniform(0.2, 0.3))
    cell.table().panda()
    cell.box("step", (0.2, 0.2, step), goal)
    start = (draw.uniform(0.4, 0.5), -side * draw.uniform(0.05, 0.2))
    cell.block("block", (width, width, height), start, mass=draw.uniform(12, 25), color=ORANGE)
    cell.goal("block", goal, step + height / 2)


def too_wide(cell: Cell, draw: Sampler) -> None:
    """A cube that is wider than the gripper opens has to be lifted on a step."""
    side, step, width = draw.side(), draw.uniform(0.06, 0.15), draw.uniform(0.088, 0.11)
    goal = (draw.uniform(0.45, 0.55), side * draw.uniform(0.2, 0.3))
    cell.table().panda()
    cell.box("step", (0.2, 0.2, step), goal)
    start = (draw.uniform(0.42, 0.5), -side * draw.uniform(0.05, 0.2))
    cell.block("cube", (width, width, width), start, yaw=draw.angle(), mass=0.3, color=ORANGE)
    cell.goal("cube", goal, step + width / 2)


def too_wide_in_niche(cell: Cell, draw: Sampler) -> None:
    """A cube that is wider than the gripper opens stands in a niche, from which it cannot be pushed out."""
    width, y = draw.uniform(0.088, 0.105), draw.uniform(-0.1, 0.1)
    x, gap = draw.uniform(0.48, 0.54), draw.uniform(0.002, 0.004)
    half, high = width / 2 + gap, width + 0.02
    cell.table().panda()
    for name, sign in (("left", 1), ("right", -1)):
        cell.box(f"side_{name}", (width + 0.02, 0.02, high), (x + 0.01, y + sign * (half + 0.01)))
    cell.box("back", (0.02, 2 * half, high), (x + half + 0.01, y))
    cell.box("roof", (width + 0.02, 2 * half + 0.04, 0.02), (x + 0.01, y), high)
    cell.block("cube", (width, width, width), (x, y), mass=0.3, color=ORANGE)
    cell.goal("cube", (x - width - draw.uniform(0.03, 0.06), y), width / 2, tolerance=0.01, degrees=5.0)


def closed_room(cell: Cell, draw: Sampler, door: float, width: float) -> tuple[float, float, float]:
    """Add a room with a roof and a door of a width in m towards the robot.

    Returns:
        x and y of the middle of the room, and x of its front wall.
    """
    x, y, half, high = draw.uniform(0.52, 0.56), draw.uniform(-0.1, 0.1), 0.11, width + 0.06
    cell.box("roof", (2 * half + 0.04, 2 * half + 0.04, 0.02), (x, y), high)
    cell.box("back", (0.02, 2 * half + 0.04, high), (x + half + 0.01, y))
    jamb = half - door / 2
    for name, sign in (("left", 1), ("right", -1)):
        cell.box(f"side_{name}", (2 * half, 0.02, high), (x, y + sign * (half + 0.01)))
        cell.box(f"jamb_{name}", (0.02, jamb + 0.02, high), (x - half - 0.01, y + sign * (door + jamb + 0.02) / 2))
    return x, y, x - half - 0.02


def gap_too_narrow(cell: Cell, draw: Sampler) -> None:
    """A block in a room has to come out through a door that is narrower than the block."""
    width = draw.uniform(0.05, 0.065)
    cell.table().panda()
    x, y, _ = closed_room(cell, draw, width - draw.uniform(0.008, 0.02), width)
    cell.block("cube", (width, width, width), (x, y), mass=0.2, color=ORANGE)
    cell.goal("cube", (0.4, -0.3 if y > 0 else 0.3), width / 2)


def immovable_obstacle(cell: Cell, draw: Sampler) -> None:
    """A post that is fixed stands in the only door of a room."""
    width = draw.uniform(0.045, 0.06)
    door = width + draw.uniform(0.02, 0.05)
    cell.table().panda()
    x, y, front = closed_room(cell, draw, door, width)
    cell.box("post", (0.02, 0.02, width + 0.05), (front - 0.014, y))
    cell.block("cube", (width, width, width), (x, y), mass=0.2, color=ORANGE)
    cell.goal("cube", (0.4, -0.3 if y > 0 else 0.3), width / 2)


def stuck_obstacle(cell: Cell, draw: Sampler) -> None:
    """A removable plug fills a room so deep that no hand reaches what is behind it; nothing can pull the plug out."""
    width, plug = draw.uniform(0.045, 0.055), draw.uniform(0.09, 0.105)
    x, gap = draw.uniform(0.44, 0.5), draw.uniform(0.002, 0.004)
    deep, inner, high = plug + width + 0.03, plug + 2 * gap, plug + gap
    cell.table().panda()
    values = {"length": deep, "inner_width": inner, "height": high, "wall": 0.02, "roof": 0.02}
    cell.add_object("room", "tunnel", (x + deep / 2, 0.0, 0.0), values=values)
    cell.box("back", (0.02, inner + 0.04, high + 0.02), (x + deep + 0.01, 0.0))
    cell.block("cube", (width, width, width), (x + plug + width / 2 + 0.018, 0.0), color=ORANGE)
    cell.block("plug", (plug, plug, plug), (x + plug / 2 + 0.004, 0.0), mass=0.3, removable=True)
    cell.goal("cube", (0.38, draw.side() * 0.3), width / 2)


def goal_in_wall(cell: Cell, draw: Sampler) -> None:
    """The goal overlaps a fixed body by more than its tolerance and what is allowed."""
    width = draw.uniform(0.04, 0.06)
    start = draw.spot((0.4, 0.6), (-45, -10))
    x, y = draw.uniform(0.4, 0.55), draw.uniform(0.15, 0.25)
    cell.table().panda()
    cell.box("wall", (0.3, 0.03, 0.1), (x, y))
    cell.block("block", (width, width, width), start, color=ORANGE)
    cell.goal("block", (x, y - 0.015 - width / 2 + draw.uniform(0.008, 0.02)), width / 2)


def no_gripper(cell: Cell, draw: Sampler) -> None:
    """An arm without a gripper has to lift a box on a step."""
    bench, step, side = draw.uniform(0.2, 0.3), draw.uniform(0.05, 0.1), draw.side()
    goal = (draw.uniform(0.58, 0.64), side * draw.uniform(0.2, 0.25))
    cell.box("bench", (0.5, 1.1, bench), (0.64, 0.0))
    cell.box("step", (0.2, 0.2, step), goal, bench)
    cell.robot("iiwa", "iiwa", q=IIWA_RAISED)
    cell.block("box", (0.1, 0.1, 0.12), (draw.uniform(0.54, 0.6), -side * 0.1), bench, mass=0.4, color=ORANGE)
    cell.goal("box", goal, bench + step + 0.06)


NO_HAND = (Code.NO_CONTACT, Code.NO_OBJECT_PATH, Code.OUT_OF_REACH)
FAMILIES = (
    refused(beyond_the_arm, Code.OUT_OF_REACH, reason=r"block.*\d"),
    refused(too_heavy, Code.NO_CONTACT, reason=r"block.*\d.*(kg|\bN\b)"),
    refused(too_wide, Code.NO_CONTACT, reason=r"cube.*\d+ mm.*(gripper|opens|opening)"),
    refused(too_wide_in_niche, *NO_HAND, reason=r"cube.*\d+ mm.*(gripper|opens|opening)"),
    refused(gap_too_narrow, Code.NO_OBJECT_PATH, reason="cube"),
    refused(immovable_obstacle, Code.NO_OBJECT_PATH, reason="cube"),
    refused(stuck_obstacle, *NO_HAND, reason="plug.* mm"),
    refused(goal_in_wall, Code.GOAL_IN_COLLISION, reason=r"block.*wall.*mm|block.*mm.*wall"),
    refused(no_gripper, *NO_HAND, reason="gripper"),
)
