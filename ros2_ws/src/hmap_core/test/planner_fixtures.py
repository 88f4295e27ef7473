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
