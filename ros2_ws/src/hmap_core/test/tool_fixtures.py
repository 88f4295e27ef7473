"""A box in a tunnel, out of a hand's reach, and something to push it out with; written as a user writes it."""

from pathlib import Path

from hmap_core.scenes import load_scene
from hmap_core.types import Scene

PUSH_OUT = """
schema: 1
description: Push a box out of a tunnel with a stick.
mode: {mode}
motion: planar
fixed:
  table: {{shape: box, size: [2, 2, 0.1], pose: {{xyz: [0, 0, 0]}}}}
  left: {{shape: box, size: [0.30, 0.03, 0.10], pose: {{xyz: [0.0, 0.455, 0.10]}}}}
  right: {{shape: box, size: [0.30, 0.03, 0.10], pose: {{xyz: [0.0, 0.345, 0.10]}}}}
  roof: {{shape: box, size: [0.30, 0.14, 0.03], pose: {{xyz: [0.0, 0.40, 0.165]}}}}
movable:
  crate: {{shape: box, size: [0.10, 0.06, 0.06], pose: {{xyz: [0.03, 0.40, 0.08]}}, mass: 0.2, friction: 0.5}}
{kind}:
  stick: {{shape: box, size: [0.40, 0.04, 0.04], pose: {{xyz: [0.40, 0.25, 0.07]}}, mass: 0.2}}
  cube: {{shape: box, size: [0.05, 0.05, 0.05], pose: {{xyz: [0.30, 0.10, 0.075]}}, mass: 0.1}}
robots:
  arm: {{model: panda, base: {{xyz: [0.3, -0.2, 0.05], rpy_deg: [0, 0, 90]}}}}
goal: {{object: crate, pose: {{xyz: [-0.10, 0.40, 0.08]}}}}
"""


def push_out(folder: Path, mode: str = "physical", kind: str = "tools") -> Scene:
    """The stick and a cube are tools, or with ``kind`` "movable" bodies like any other."""
    file = folder / "push_out.yaml"
    file.write_text(PUSH_OUT.format(mode=mode, kind=kind))
    return load_scene(str(file))
