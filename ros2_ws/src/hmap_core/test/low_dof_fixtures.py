"""Robots with fewer than six joints: a disc on rails, a paddle, a SCARA and a five-joint arm; and tasks for them."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

from gripper_fixtures import GRIPPERS, box, joint, link, shape, slide_urdf

HAND = ("hand", "left_finger", "right_finger")
GRIPPER = GRIPPERS["slide"][1].replace("40.0", "60.0")
TIP = "0 0 0.115"  # of the sliding gripper, hand frame


def cylinder(radius: float, length: float) -> str:
    return f'<cylinder radius="{radius}" length="{length}"/>'


def rails_urdf(tool: str, lift: bool = True) -> str:
    """Two rails, yaw and lift above the table, with a tool below; its end effector looks up."""
    up = dict(axis="0 0 1", limits=(0.0, 0.4))
    return "".join(
        [
            link("base", 5.0, ""),
            link("bridge", 2.0, ""),
            link("carriage", 2.0, ""),
            link("spindle", 1.0, ""),
            link("tool", 0.5, tool, 1e-3),
            joint("slide_x", "prismatic", "base", "bridge", axis="1 0 0", limits=(-0.8, 0.8)),
            joint("slide_y", "prismatic", "bridge", "carriage", axis="0 1 0", limits=(-0.8, 0.8)),
            joint("yaw", "revolute", "carriage", "spindle", axis="0 0 1", limits=(-3.2, 3.2)),
            joint("lift", "prismatic" if lift else "fixed", "spindle", "tool", "0 0 0.02", **up),
        ]
    )


ROD = shape(cylinder(0.01, 0.4), "0 0 0.2")
TOOLS = {
    "disc": shape(cylinder(0.04, 0.03)) + ROD,
    "paddle": shape(box(0.1, 0.02, 0.03)) + ROD,
    "stick": shape('<sphere radius="0.012"/>') + ROD,
}


def scara_urdf() -> str:
    """Two joints about the vertical, a quill, and a gripper that looks down and turns."""
    return "".join(
        [
            link("base", 5.0, shape(cylinder(0.06, 0.55), "0 0 0.275")),
            link("upper", 2.0, shape(box(0.35, 0.07, 0.05), "0.175 0 0.03")),
            link("fore", 1.5, shape(box(0.3, 0.06, 0.04), "0.15 0 0.03")),
            link("quill", 0.5, shape(cylinder(0.015, 0.5), "0 0 0.2"), 2e-3),
            joint("shoulder", "revolute", "base", "upper", "0 0 0.56", axis="0 0 1", limits=(-2.9, 2.9)),
            joint("elbow", "revolute", "upper", "fore", "0.35 0 0.06", axis="0 0 1", limits=(-2.6, 2.6)),
            joint("quill_slide", "prismatic", "fore", "quill", "0.3 0 -0.06", axis="0 0 -1", limits=(0.0, 0.44)),
            joint("turn", "revolute", "quill", "hand", "0 0 -0.05", "3.14159265 0 0", "0 0 -1", (-3.1, 3.1)),
            slide_urdf(),
        ]
    )


def five_urdf() -> str:
    """Pan, three parallel pitch joints, and a roll joint behind the gripper."""
    return "".join(
        [
            link("base", 4.0, shape(cylinder(0.07, 0.1), "0 0 0.05")),
            link("column", 2.0, shape(cylinder(0.05, 0.1), "0 0 0.05")),
            link("upper", 2.0, shape(box(0.06, 0.05, 0.34), "0 0 0.17")),
            link("fore", 1.5, shape(box(0.05, 0.05, 0.3), "0 0 0.15")),
            link("wrist", 0.5, shape(cylinder(0.025, 0.05), "0 0 0.025"), 2e-3),
            joint("pan", "revolute", "base", "column", "0 0 0.1", axis="0 0 1", limits=(-3.1, 3.1)),
            joint("pitch1", "revolute", "column", "upper", "0 0 0.1", axis="0 1 0", limits=(-1.9, 1.9)),
            joint("pitch2", "revolute", "upper", "fore", "0 0 0.35", axis="0 1 0", limits=(-2.6, 2.6)),
            joint("pitch3", "revolute", "fore", "wrist", "0 0 0.33", axis="0 1 0", limits=(-2.0, 2.0)),
            joint("roll", "revolute", "wrist", "hand", "0 0 0.06", axis="0 0 1", limits=(-3.1, 3.1)),
            slide_urdf(),
        ]
    )


RAILS = ("slide_x", "slide_y", "yaw", "lift")
NEIGHBOURS = [("base", "upper"), ("upper", "fore"), (HAND[0], HAND[1]), (HAND[0], HAND[2]), (HAND[1], HAND[2])]
# joints, link and pose of the end effector, home, joint forces, ignored collisions, gripper
ROBOTS = {
    **{
        name: (rails_urdf(tool), RAILS, "tool", "0 0 0", (-0.4, 0.0, 0.0, 0.2), (400, 400, 60, 400), [], "")
        for name, tool in TOOLS.items()
    },
    "flat": (rails_urdf(TOOLS["disc"], False), RAILS[:3], "tool", "0 0 0", (-0.4, 0.0, 0.0), (400, 400, 60), [], ""),
    "scara": (
        scara_urdf(),
        ("shoulder", "elbow", "quill_slide", "turn"),
        "hand",
        TIP,
        (-0.6, 1.4, 0.05, 0.0),
        (200, 200, 400, 40),
        [*NEIGHBOURS, ("fore", "quill"), *[("fore", part) for part in HAND], ("quill", "hand")],
        GRIPPER,
    ),
    "five": (
        five_urdf(),
        ("pan", "pitch1", "pitch2", "pitch3", "roll"),
        "hand",
        TIP,
        (0.0, -0.3, 1.9, 1.5, 0.0),
        (200, 200, 200, 80, 40),
        [*NEIGHBOURS, ("base", "column"), ("column", "upper"), ("fore", "wrist"), *[("wrist", p) for p in HAND]],
        GRIPPER,
    ),
}

urdf, joints, *hand, home, forces, ignored, gripper = ROBOTS["five"]
fixed = urdf.replace('<joint name="roll" type="revolute">', '<joint name="roll" type="fixed">')
ROBOTS["four"] = (fixed, joints[:4], *hand, home[:4], forces[:4], ignored, gripper)  # without the roll joint


def _listed(values: Sequence[float]) -> str:
    return f"[{', '.join(str(value) for value in values)}]"


def robot_text(name: str) -> str:
    urdf, joints, tip_link, tip, home, forces, ignored, gripper = ROBOTS[name]
    limits = {j.get("name"): j.find("limit") for j in ET.fromstring(f"<robot>{urdf}</robot>").iter("joint")}
    lower, upper = ([float(limits[name].get(key)) for name in joints] for key in ("lower", "upper"))
    n = len(joints)
    fingers = f"gripper:\n  {gripper}  finger_links: [left_finger, right_finger]\n" if gripper else ""
    pairs = ", ".join(f"[{a}, {b}]" for a, b in ignored)
    return f"""\
schema: 1
urdf: {name}.urdf
joints: [{", ".join(joints)}]
end_effector: {{link: {tip_link}, pose: {{xyz: [{", ".join(tip.split())}]}}}}
home: {_listed(home)}
position_limits: {{lower: {_listed(lower)}, upper: {_listed(upper)}}}
velocity_limits: {_listed([1.0] * n)}
acceleration_limits: {_listed([3.0] * n)}
{fingers}ignored_collisions: [{pairs}]
simulation: {{joint_forces: {_listed(forces)}}}
"""


def write_robot(folder: Path, name: str) -> Path:
    """A robot file and its URDF in a folder."""
    (folder / f"{name}.urdf").write_text(f'<robot name="{name}">{ROBOTS[name][0]}</robot>')
    path = folder / f"{name}.yaml"
    path.write_text(robot_text(name))
    return path


HEAD = "schema: 1\nparameters: {x: {uniform: [%s]}, y: {uniform: [%s]}, turn: {uniform: [%s]}}\n"
PUCK = (
    HEAD % ("0.35, 0.45", "-0.25, -0.15", "-180, 180")
    + """\
mode: kinematic
motion: planar
fixed:
  table: {shape: box, size: [2, 2, 0.05], pose: {xyz: [0, 0, -0.025]}}
  wall: {shape: box, size: [0.3, 0.02, 0.06], pose: {xyz: [0.45, 0, 0.03]}}
movable:
  puck: {shape: cylinder, size: [0.03, 0.02], pose: {xyz: [x, y, 0.01]}, mass: 0.2}
robots:
  arm: {model: MODEL, base: {xyz: [0, 0, 0]}}
goal: {object: puck, pose: {xyz: [0.42, 0.2, 0.01]}, rotation_tolerance_deg: 180}
"""
)
CRATE = (
    HEAD % ("0.38, 0.44", "-0.2, -0.1", "-30, 30")
    + """\
mode: physical
motion: planar
fixed:
  table: {shape: box, size: [2, 2, 0.05], pose: {xyz: [0, 0, -0.025]}}
movable:
  crate: {shape: box, size: [0.14, 0.12, 0.06], pose: {xyz: [x, y, 0.03], rpy_deg: [0, 0, turn]}, mass: 0.4}
robots:
  arm: {model: MODEL, base: {xyz: [0, 0, 0]}}
goal: {object: crate, pose: {xyz: [0.45, 0.15, 0.03]}, position_tolerance: 0.01, rotation_tolerance_deg: 180}
"""
)
BRICK = (
    HEAD % ("0.38, 0.46", "-0.24, -0.14", "-40, 40")
    + """\
mode: physical
motion: spatial
fixed:
  table: {shape: box, size: [2, 2, 0.05], pose: {xyz: [0.5, 0, -0.025]}}
  wall: {shape: box, size: [0.3, 0.02, 0.1], pose: {xyz: [0.45, 0.02, 0.05]}}
movable:
  brick: {shape: box, size: [0.07, 0.04, 0.08], pose: {xyz: [x, y, 0.04], rpy_deg: [0, 0, turn]}, mass: 0.3}
robots:
  arm: {model: MODEL, base: {xyz: [0, 0, 0]}}
goal: {object: brick, pose: {xyz: [0.42, 0.22, 0.04]}}
"""
)
LEANING = BRICK.replace("0.04], rpy_deg: [0, 0, turn]", "0.0402], rpy_deg: [0.25, 0.1, turn]")  # as measured poses do
TASKS = {"puck": PUCK, "crate": CRATE, "brick": BRICK, "leaning": LEANING}


def write_task(folder: Path, task: str, robot: str) -> Path:
    """A task for a robot, and that robot, in a folder; returns the task's file."""
    write_robot(folder, robot)
    path = folder / f"{task}_{robot}.yaml"
    path.write_text(TASKS[task].replace("MODEL", f"{robot}.yaml"))
    return path
