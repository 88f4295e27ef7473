"""Small one-arm tasks, written as a user writes them."""

from pathlib import Path

from hmap_core.scenes import load_scene
from hmap_core.types import Scene

CARRY = """
schema: 1
description: Carry a box over a low wall.
mode: {mode}
motion: {motion}
fixed:
  table: {{shape: box, size: [2.4, 2.4, 0.1], pose: {{xyz: [0, 0, -0.05]}}}}
  wall: {{shape: box, size: [0.3, 0.02, {wall}], pose: {{xyz: [0.5, 0, {wall_z}]}}}}
movable:
  brick: {{shape: box, size: [0.05, 0.05, 0.08], pose: {{xyz: {start}}}, mass: 0.3, friction: 0.6}}
robots:
  arm: {{model: {model}, base: {{xyz: [0, 0, 0], rpy_deg: [0, 0, 0]}}}}
goal: {{object: brick, pose: {{xyz: {goal}}}}}
"""
START, GOAL = (0.5, -0.15, 0.04), (0.5, 0.15, 0.04)


def carry(folder: Path, model="panda", mode="physical", motion="auto", wall=0.05, start=START, goal=GOAL) -> Scene:
    """A box on one side of a wall of some height (m), wanted on the other."""
    text = CARRY.format(
        model=model, mode=mode, motion=motion, wall=wall, wall_z=wall / 2, start=list(start), goal=list(goal)
    )
    file = folder / "carry.yaml"
    file.write_text(text)
    return load_scene(str(file))


CRATE = """
schema: 1
description: Push a crate that is too wide for the gripper past a wall, and turn it.
mode: physical
motion: planar
fixed:
  table: {shape: box, size: [2.4, 2.4, 0.1], pose: {xyz: [0, 0, -0.05]}}
  wall: {shape: box, size: [0.1, 0.02, 0.1], pose: {xyz: [0.31, 0, 0.05]}}
movable:
  crate: {shape: box, size: [0.12, 0.12, 0.08], pose: {xyz: [0.4, -0.15, 0.04]}, mass: 0.3, friction: 0.4}
robots:
  arm: {model: panda, base: {xyz: [0, 0, 0]}}
goal:
  object: crate
  pose: {xyz: [0.45, 0.2, 0.04], rpy_deg: [0, 0, 40]}
  position_tolerance: 0.01
  rotation_tolerance_deg: 3
"""


def crate(folder: Path) -> Scene:
    """A crate that no hand can grip, to be pushed past a wall and turned by 40 deg."""
    file = folder / "crate.yaml"
    file.write_text(CRATE)
    return load_scene(str(file))


DRAGGED = """
schema: 1
description: Bring a flat body to another place of the table.
mode: physical
fixed:
  table: {{shape: box, size: [2.4, 2.4, 0.1], pose: {{xyz: [0, 0, -0.05]}}, friction: {ground}}}
movable:
  {name}: {{{shape}, pose: {{xyz: [0.45, -0.12, {z}]}}, mass: 0.15, friction: 0.5}}
robots:
  arm: {{model: panda, base: {{xyz: [0, 0, 0]}}}}
goal:
  object: {name}
  pose: {{xyz: [0.5, 0.12, {z}]}}
  position_tolerance: 0.01
  rotation_tolerance_deg: 5
"""


def plate(folder: Path, size=(0.12, 0.11, 0.008), ground: float = 0.6) -> Scene:
    """A plate of a size in m on a table with a friction coefficient, wanted 24 cm farther."""
    return _dragged(folder, f"shape: box, size: {list(size)}", size[2], "plate", ground)


def disc(folder: Path, radius: float = 0.055, height: float = 0.028) -> Scene:
    """A disc of a size in m that is too wide for the gripper, wanted 24 cm farther."""
    return _dragged(folder, f"shape: cylinder, size: [{radius}, {height}]", height, "disc")


def _dragged(folder: Path, shape: str, height: float, name: str, ground: float = 0.6) -> Scene:
    file = folder / f"{name}.yaml"
    file.write_text(DRAGGED.format(shape=shape, ground=ground, z=height / 2, name=name))
    return load_scene(str(file))


ROW = """
schema: 1
description: Take a book out of a row, flush with its neighbours, and stand it elsewhere.
mode: physical
fixed:
  table: {shape: box, size: [2.4, 2.4, 0.1], pose: {xyz: [0, 0, -0.05]}}
  platform: {shape: box, size: [0.4, 1.2, 0.14], pose: {xyz: [0.6, 0, 0.07]}}
  left: {shape: box, size: [0.115, 0.08, 0.17], pose: {xyz: [0.56, 0.113, 0.225]}}
  right: {shape: box, size: [0.115, 0.08, 0.17], pose: {xyz: [0.56, -0.013, 0.225]}}
  back: {shape: box, size: [0.02, 0.22, 0.17], pose: {xyz: [0.63, 0.05, 0.225]}}
movable:
  book: {shape: box, size: [0.115, 0.04, 0.17], pose: {xyz: [0.56, 0.05, 0.225]}, mass: 0.2, friction: 0.6}
robots:
  arm: {model: panda, base: {xyz: [0, 0, 0]}}
goal: {object: book, pose: {xyz: [0.5, -0.3, 0.225]}}
"""


def row(folder: Path) -> Scene:
    """A book in a row, 3 mm from its neighbours on both sides, too close for fingers."""
    file = folder / "row.yaml"
    file.write_text(ROW)
    return load_scene(str(file))
