"""Families of everyday tasks for other robots: an xArm 6 with turning fingers, an iiwa without a gripper."""

from hmap_core.benchmark.generality.cell import ORANGE, Cell, Sampler
from hmap_core.benchmark.generality.everyday import HAND_ROOM, TOLERANT, clutter, two_spots
from hmap_core.benchmark.generality.family import solvable

NEAR = {"radius": (0.32, 0.5), "angle": (-45.0, 45.0)}  # where an xArm 6 works well
IIWA_RAISED = (0.0, 0.0, 0.0, -1.5708, 0.0, 1.5708, 0.0)  # rad: the flange looks down, 0.6 m over the base


def xarm6_in_clutter(cell: Cell, draw: Sampler) -> None:
    """An xArm 6 brings a block to another place on a table with other things."""
    size = (draw.uniform(0.035, 0.055), draw.uniform(0.035, 0.055), draw.uniform(0.06, 0.1))
    start, goal = two_spots(draw, 0.18, **NEAR)
    cell.table().robot("xarm", "xarm6")
    cell.block("block", size, start, yaw=draw.angle(), mass=draw.uniform(0.1, 0.3), color=ORANGE)
    clutter(cell, draw, [(start, HAND_ROOM), (goal, HAND_ROOM)], draw.integer(2, 5), size[2] - 0.01)
    cell.goal("block", goal, size[2] / 2, (0, 0, draw.angle()))


def xarm6_over_wall(cell: Cell, draw: Sampler) -> None:
    """An xArm 6 sorts a block to the other side of a wall."""
    size = (draw.uniform(0.035, 0.05), draw.uniform(0.035, 0.05), draw.uniform(0.06, 0.1))
    side = draw.side()
    start = (draw.uniform(0.3, 0.42), side * draw.uniform(0.14, 0.25))
    goal = (draw.uniform(0.3, 0.42), -side * draw.uniform(0.14, 0.25))
    cell.table().robot("xarm", "xarm6")
    cell.wall("wall", (0.25, 0.0), (0.7, 0.0), draw.uniform(0.08, 0.15))
    cell.block("block", size, start, yaw=draw.angle(), mass=draw.uniform(0.1, 0.3), color=ORANGE)
    cell.goal("block", goal, size[2] / 2, (0, 0, draw.angle()))


def iiwa_pushes(cell: Cell, draw: Sampler) -> None:
    """An iiwa without a gripper pushes a box over a bench."""
    size = (draw.uniform(0.1, 0.14), draw.uniform(0.1, 0.14), draw.uniform(0.12, 0.16))
    bench, side = draw.uniform(0.25, 0.35), draw.side()
    cell.box("bench", (0.5, 1.1, bench), (0.64, 0.0), friction=0.4)
    cell.robot("iiwa", "iiwa", q=IIWA_RAISED)
    start = (draw.uniform(0.54, 0.6), side * draw.uniform(0.04, 0.14))
    goal = (start[0] + draw.uniform(0.0, 0.06), -side * draw.uniform(0.04, 0.14))
    cell.block("box", size, start, bench, mass=draw.uniform(0.3, 0.8), friction=0.4, color=ORANGE)
    cell.goal("box", goal, bench + size[2] / 2, **TOLERANT)


FAMILIES = solvable(xarm6_in_clutter, xarm6_over_wall, iiwa_pushes)
