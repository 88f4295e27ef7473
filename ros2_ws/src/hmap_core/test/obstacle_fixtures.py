"""Small one-arm tasks in which something has to be put out of the way, written as a user writes them."""

from pathlib import Path

from hmap_core.scenes import load_scene
from hmap_core.types import Scene

HEAD = """
schema: 1
description: {description}
mode: {mode}
motion: {motion}
fixed:
  table: {{shape: box, size: [2.4, 2.4, 0.1], pose: {{xyz: [0, 0, -0.05]}}}}
{fixed}
movable:
  brick: {{shape: box, size: [0.05, 0.05, 0.08], pose: {{xyz: {start}}}, mass: 0.3, friction: 0.6}}
{movable}
robots:
  arm: {{model: panda, base: {{xyz: [0, 0, 0], rpy_deg: [0, 0, 0]}}}}
goal: {{object: brick, pose: {{xyz: {goal}}}}}
removable:
{removable}
"""
WALL = "  {name}: {{shape: box, size: {size}, pose: {{xyz: {at}}}}}"
BOX = "  {name}: {{shape: box, size: {size}, pose: {{xyz: {at}}}, mass: {mass}, friction: 0.6}}"


def task(
    folder: Path,
    description: str,
    walls: dict,
    boxes: dict,
    removable: dict,
    start,
    goal,
    mode="physical",
    motion="planar",
    mass=0.2,
) -> Scene:
    """A task with walls and boxes given as name -> (size, position) in metres; ``removable``: name -> xyz or None."""
    text = HEAD.format(
        description=description,
        mode=mode,
        motion=motion,
        fixed="\n".join(WALL.format(name=n, size=list(s), at=list(at)) for n, (s, at) in walls.items()),
        movable="\n".join(BOX.format(name=n, size=list(s), at=list(at), mass=mass) for n, (s, at) in boxes.items()),
        removable="\n".join(
            f"  {n}: " + ("null" if at is None else f"{{xyz: {list(at)}}}") for n, at in removable.items()
        )
        or "  {}",
        start=list(start),
        goal=list(goal),
    )
    file = folder / "task.yaml"
    file.write_text(text)
    return load_scene(str(file))


# a wall from one end of the table to the other, with a gap 16 cm wide
WALLS = {"left": ((1.60, 0.03, 0.06), (-0.38, 0.25, 0.03)), "right": ((0.60, 0.03, 0.06), (0.88, 0.25, 0.03))}


def gap(folder: Path, removable: dict | None = None, **options) -> Scene:
    """A brick that has to slide through a gap in which two boxes stand."""
    boxes = {"one": ((0.05, 0.05, 0.08), (0.46, 0.25, 0.04)), "two": ((0.05, 0.05, 0.08), (0.54, 0.25, 0.04))}
    removable = {"one": None, "two": None} if removable is None else removable
    start, goal = (0.5, 0.05, 0.04), (0.5, 0.45, 0.04)
    return task(folder, "Through the gap.", WALLS, boxes, removable, start, goal, **options)


def tower(folder: Path, **options) -> Scene:
    """A brick whose goal is taken by a box that carries another one."""
    boxes = {"lower": ((0.06, 0.06, 0.06), (0.5, 0.25, 0.03)), "upper": ((0.05, 0.05, 0.05), (0.5, 0.25, 0.085))}
    removable = {"lower": None, "upper": None}
    start, goal = (0.5, -0.1, 0.04), (0.5, 0.25, 0.04)
    return task(folder, "Where a tower stands.", {}, boxes, removable, start, goal, **options)


def corridor(folder: Path, **options) -> Scene:
    """A brick whose place is at the end of a roofed corridor, behind two boxes one after the other."""
    walls = {
        "left": ((0.10, 0.03, 0.12), (0.71, -0.055, 0.06)),
        "right": ((0.10, 0.03, 0.12), (0.71, 0.055, 0.06)),
        "end": ((0.03, 0.14, 0.12), (0.775, 0.0, 0.06)),
        "roof": ((0.10, 0.14, 0.03), (0.71, 0.0, 0.135)),
    }
    boxes = {"inner": ((0.05, 0.05, 0.08), (0.695, 0.0, 0.04)), "outer": ((0.05, 0.05, 0.08), (0.63, 0.0, 0.04))}
    removable = {"inner": None, "outer": None}
    start, goal = (0.45, -0.3, 0.04), (0.695, 0.0, 0.04)
    return task(folder, "Into the corridor.", walls, boxes, removable, start, goal, mode="kinematic", **options)


def crowded(folder: Path, **options) -> Scene:
    """A brick between boxes that leave no room for a hand beside it, nor above it for long."""
    place = (0.5, 0.0)
    boxes = {
        name: ((0.05, 0.05, 0.08), (place[0] + dx, place[1] + dy, 0.04))
        for name, dx, dy in (("east", 0.06, 0.0), ("west", -0.06, 0.0), ("north", 0.0, 0.06), ("south", 0.0, -0.06))
    }
    removable = dict.fromkeys(boxes)
    return task(folder, "Out of the crowd.", {}, boxes, removable, (*place, 0.04), (0.4, 0.35, 0.04), **options)


def eight(folder: Path, **options) -> Scene:
    """A brick whose place is taken by two of eight boxes."""
    at = [
        (0.45, 0.30),
        (0.51, 0.30),
        (0.35, -0.35),
        (0.45, -0.35),
        (0.55, -0.35),
        (0.65, -0.2),
        (0.65, 0.0),
        (0.3, 0.45),
    ]
    boxes = {f"box_{k}": ((0.05, 0.05, 0.08), (x, y, 0.04)) for k, (x, y) in enumerate(at)}
    removable = dict.fromkeys(boxes)
    return task(folder, "Among eight.", {}, boxes, removable, (0.45, -0.1, 0.04), (0.48, 0.30, 0.04), **options)


def heavy_slab(folder: Path, **options) -> Scene:
    """A brick whose place is taken by a slab too wide for any gripper, in the middle of a pit that it fills."""
    boxes = {"slab": ((0.16, 0.16, 0.08), (0.5, 0.25, 0.04))}
    walls = {
        "south": ((0.24, 0.03, 0.08), (0.5, 0.15, 0.04)), "north": ((0.24, 0.03, 0.08), (0.5, 0.35, 0.04)),
        "west": ((0.03, 0.16, 0.08), (0.4, 0.25, 0.04)), "east": ((0.03, 0.16, 0.08), (0.6, 0.25, 0.04)),
    }  # fmt: skip
    start, goal = (0.5, -0.1, 0.04), (0.5, 0.25, 0.04)
    return task(folder, "Into the pit.", walls, boxes, {"slab": None}, start, goal, **options)


def side_door(folder: Path, **options) -> Scene:
    """A brick fits through the side door of a cell; the box in it only through the front, where another one stands."""
    walls = {
        "north_1": ((0.015, 0.02, 0.12), (0.6125, 0.048, 0.06)),
        "north_2": ((0.025, 0.02, 0.12), (0.6925, 0.048, 0.06)),
        "south": ((0.10, 0.02, 0.12), (0.655, -0.048, 0.06)),
        "end": ((0.03, 0.116, 0.12), (0.72, 0.0, 0.06)),
        "roof": ((0.13, 0.116, 0.03), (0.67, 0.0, 0.135)),
    }
    boxes = {"inner": ((0.07, 0.07, 0.08), (0.65, 0.0, 0.04)), "outer": ((0.07, 0.07, 0.08), (0.56, 0.0, 0.04))}
    removable = {"inner": None, "outer": None}
    start, goal = (0.5, 0.3, 0.04), (0.65, 0.03, 0.04)
    return task(folder, "In by the side door.", walls, boxes, removable, start, goal, mode="kinematic", **options)
