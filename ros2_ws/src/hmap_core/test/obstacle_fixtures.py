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
        ),
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
