"""The arms that come with a parallel gripper, robot files written anew from their URDFs, and two tasks for them."""

from pathlib import Path

from gripper_fixtures import TASK as PLACE

from hmap_core.cli import main
from hmap_core.scenes import resources

ARMS = ("ur5e_2f85", "xarm7", "iiwa14_wsg50", "gen3_2f85", "fr3")

# A crate that is wider than every gripper opens.
PUSH = """\
schema: 1
mode: physical
motion: planar
parameters:
  x: {{uniform: [0.42, 0.5]}}
  y: {{uniform: [-0.15, -0.05]}}
  turn: {{uniform: [-20, 20]}}
  friction: {{uniform: [0.4, 0.6]}}
fixed:
  table: {{shape: box, size: [2, 2, 0.05], pose: {{xyz: [0.5, 0, -0.025]}}}}
movable:
  crate:
    shape: box
    size: [0.14, 0.14, 0.06]
    pose: {{xyz: [x, y, 0.03], rpy_deg: [0, 0, turn]}}
    mass: 0.4
    friction: friction
robots:
  arm: {{model: {model}, base: {{xyz: [0, 0, 0]}}}}
goal: {{object: crate, pose: {{xyz: [0.47, 0.15, 0.03]}}, position_tolerance: 0.01, rotation_tolerance_deg: 30}}
"""
TASKS = {"place": PLACE, "push": PUSH}


def urdf_of(arm: str) -> Path:
    """The URDF of an arm that comes with hmap."""
    return resources.package_path("hmap_scenes") / "urdf" / f"{arm}.urdf"


def new_robot(folder: Path, urdf: Path, *options: str) -> Path:
    """The robot file that ``hmap robot new`` writes for a URDF."""
    out = folder / f"{urdf.stem}.yaml"
    assert main(["robot", "new", str(urdf), "--out", str(out), *options]) == 0
    return out


def write_task(folder: Path, robot: Path, task: str) -> Path:
    """A task file for a robot file in the same folder."""
    path = folder / f"{robot.stem}_{task}.yaml"
    path.write_text(TASKS[task].format(model=robot.name))
    return path
