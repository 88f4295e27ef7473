"""Robot files with grippers other than the Panda's on a six-joint arm of cylinders, and a task for them."""

from itertools import combinations
from pathlib import Path

ARM_JOINTS = ("pan", "lift", "elbow", "wrist1", "wrist2", "wrist3")
OPEN_ANGLE, BAR = 0.6, 0.06  # rad from the approach, m: the bars of the four-bar gripper when open
CLOSED = 0.7  # rad that its knuckles turn until the fingers meet
PIVOT = (0.012, 0.05)  # m: y and z of a knuckle's axis, hand frame
FINGER = (0.018, 0.012, 0.05)  # m, box
SLIDE_START = 0.0027  # m that a sliding finger's joint is at when the gripper is closed

ARM = {  # link: mass, and cylinders as (origin, rpy, radius, length)
    "base": (4.0, [("0 0 0.04", "0 0 0", 0.07, 0.08)]),
    "shoulder": (2.0, [("0 0 0", "0 0 0", 0.06, 0.15)]),
    "upper": (6.0, [("0 0 0.138", "0 0 0", 0.06, 0.13), ("-0.2125 0 0.138", "0 1.5708 0", 0.05, 0.425)]),
    "forearm": (3.0, [("0 0 0.02", "0 0 0", 0.055, 0.12), ("-0.196 0 0.007", "0 1.5708 0", 0.045, 0.392)]),
    "link1": (1.0, [("0 0 0", "0 0 0", 0.04, 0.12)]),
    "link2": (1.0, [("0 0 0", "0 0 0", 0.04, 0.1)]),
    "link3": (0.3, [("0 0 -0.02", "0 0 0", 0.038, 0.04)]),
}
ORIGINS = (  # of the arm's joints
    ("0 0 0.1625", "0 0 0"), ("0 0 0", "1.570796 0 0"), ("-0.425 0 0", "0 0 0"), ("-0.3922 0 0.1333", "0 0 0"),
    ("0 -0.0997 0", "1.570796 0 0"), ("0 0.0996 0", "1.570796 3.141593 3.141593"),
)  # fmt: skip
APART = (("base", "link2"), ("shoulder", "link2"), ("forearm", "link2"))  # links of the arm that never meet
CABLE = ("link1", "link2", "link3")  # and those that never meet the hand


def shape(geometry: str, xyz: str = "0 0 0", rpy: str = "0 0 0") -> str:
    return f'<collision><origin xyz="{xyz}" rpy="{rpy}"/><geometry>{geometry}</geometry></collision>'


def box(*size: float) -> str:
    return f'<box size="{" ".join(map(str, size))}"/>'


def link(name: str, mass: float, shapes: str, inertia: float = 0.02) -> str:
    tensor = " ".join(f'i{a}="{inertia if a[0] == a[1] else 0}"' for a in ("xx", "xy", "xz", "yy", "yz", "zz"))
    return f'<link name="{name}"><inertial><mass value="{mass}"/><inertia {tensor}/></inertial>{shapes}</link>\n'


def joint(name, kind, parent, child, xyz="0 0 0", rpy="0 0 0", axis="1 0 0", limits=(-0.1, 1.0), mimic="") -> str:
    limit = f'<limit lower="{limits[0]}" upper="{limits[1]}" velocity="2" effort="150"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{limit}{mimic}</joint>\n'
    )


def mimic(name: str, multiplier: float = 1.0) -> str:
    return f'<mimic joint="{name}" multiplier="{multiplier}"/>'


def arm_urdf() -> str:
    parts = []
    for name, (mass, shapes) in ARM.items():
        parts.append(
            link(name, mass, "".join(shape(f'<cylinder radius="{r}" length="{h}"/>', x, a) for x, a, r, h in shapes))
        )
    for name, (parent, child), (xyz, rpy) in zip(
        ARM_JOINTS, zip(ARM, list(ARM)[1:], strict=False), ORIGINS, strict=True
    ):
        parts.append(joint(name, "revolute", parent, child, xyz, rpy, "0 0 1", (-6.28, 6.28)))
    return "".join(parts) + joint("flange", "fixed", "link3", "hand")


def four_bar_urdf() -> str:
    """Fingers at the ends of knuckles, kept parallel by joints that mimic; a second bar outside moves along."""
    y, z = PIVOT
    parts = [link("hand", 0.6, shape(box(0.06, 0.12, z), f"0 0 {z / 2}"))]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        lean, straight = f"{-sign * OPEN_ANGLE} 0 0", f"{sign * OPEN_ANGLE} 0 0"
        parts += [
            link(f"{side}_knuckle", 0.03, shape(box(0.012, 0.008, BAR), f"0 0 {BAR / 2}"), 5e-5),
            link(f"{side}_bar", 0.02, shape(box(0.012, 0.004, 0.05), "0 0 0.025"), 5e-5),
            link(f"{side}_finger", 0.05, shape(box(*FINGER), f"0 0 {FINGER[2] / 2}"), 5e-5),
            joint(f"{side}_knuckle_joint", "revolute", "hand", f"{side}_knuckle", f"0 {sign * y} {z}", lean,
                  f"{sign} 0 0", mimic=mimic("left_knuckle_joint") if side == "right" else ""),
            joint(f"{side}_bar_joint", "revolute", "hand", f"{side}_bar", f"0 {sign * (y + 0.016)} {z}", lean,
                  f"{sign} 0 0", mimic=mimic("left_knuckle_joint")),
            joint(f"{side}_finger_joint", "revolute", f"{side}_knuckle", f"{side}_finger", f"0 0 {BAR}", straight,
                  f"{-sign} 0 0", mimic=mimic(f"{side}_knuckle_joint")),
        ]  # fmt: skip
    return "".join(parts)


def slide_urdf() -> str:
    """Fingers on rails; one opens towards negative values of its joint, and both joints are off zero when closed."""
    parts = [link("hand", 0.6, shape(box(0.06, 0.16, 0.08), "0 0 0.04"))]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        at = f"0 {sign * (FINGER[1] / 2 - SLIDE_START)} {FINGER[2] / 2}"
        limits = (-0.0427, -0.0027) if side == "left" else (0.0027, 0.0427)
        parts += [
            link(f"{side}_finger", 0.05, shape(box(*FINGER), at), 5e-5),
            joint(f"{side}_slide", "prismatic", "hand", f"{side}_finger", "0 0 0.08", "0 0 0", "0 -1 0", limits),
        ]
    return "".join(parts)


GRIPPERS = {
    "four_bar": (
        four_bar_urdf,
        f"joints: [left_knuckle_joint]\n  closed: {CLOSED}\n  open: 0.0\n  pad_half_width: 0.009\n  force: 40.0\n",
        "0 0 0.1447",
    ),
    "slide": (
        slide_urdf,
        "joints: [left_slide, right_slide]\n  per_joint: [-0.5, 0.5]\n  at_zero: [-0.0027, 0.0027]\n"
        "  max_opening: 0.078\n  open_opening: 0.08\n  pad_half_width: 0.009\n  force: 40.0\n",
        "0 0 0.115",
    ),
}


def ignored(kind: str) -> list[tuple[str, str]]:
    hand = ["hand", "left_finger", "right_finger"]
    hand += ["left_knuckle", "right_knuckle", "left_bar", "right_bar"] if kind == "four_bar" else []
    neighbours = list(zip(ARM, list(ARM)[1:], strict=False))
    return [*neighbours, *APART, *((a, b) for a in CABLE for b in hand), *combinations(hand, 2)]


def robot_text(kind: str) -> str:
    _, gripper, tip = GRIPPERS[kind]
    six = "[6.28, 6.28, 3.1, 6.28, 6.28, 6.28]"
    pairs = "".join(f"  - [{a}, {b}]\n" for a, b in ignored(kind))
    return f"""\
schema: 1
urdf: {kind}.urdf
joints: [{", ".join(ARM_JOINTS)}]
end_effector: {{link: hand, pose: {{xyz: [{", ".join(tip.split())}]}}}}
home: [3.14, -1.57, 1.8, -1.8, -1.57, 0.0]
position_limits:
  lower: {six.replace("6.28", "-6.28").replace("3.1,", "-3.1,")}
  upper: {six}
velocity_limits: [3.14, 3.14, 3.14, 3.14, 3.14, 3.14]
acceleration_limits: [10, 10, 10, 10, 10, 10]
gripper:
  {gripper}  finger_links: [left_finger, right_finger]
ignored_collisions:
{pairs}simulation: {{joint_forces: [150, 150, 150, 28, 28, 28]}}
"""


def write_robot(folder: Path, kind: str) -> Path:
    """A robot file and its URDF in a folder."""
    (folder / f"{kind}.urdf").write_text(f'<robot name="{kind}">{arm_urdf()}{GRIPPERS[kind][0]()}</robot>')
    path = folder / f"{kind}.yaml"
    path.write_text(robot_text(kind))
    return path


TASK = """\
schema: 1
mode: physical
motion: spatial
parameters:
  x: {{uniform: [0.38, 0.5]}}
  y: {{uniform: [-0.25, -0.1]}}
  width: {{uniform: [0.03, 0.06]}}
  turn: {{uniform: [-40, 40]}}
fixed:
  table: {{shape: box, size: [2, 2, 0.05], pose: {{xyz: [0.5, 0, -0.025]}}}}
  wall: {{shape: box, size: [0.3, 0.02, 0.1], pose: {{xyz: [0.45, 0.02, 0.05]}}}}
movable:
  brick: {{shape: box, size: [0.07, width, 0.08], pose: {{xyz: [x, y, 0.04], rpy_deg: [0, 0, turn]}}, mass: 0.3}}
robots:
  arm: {{model: {model}, base: {{xyz: [0, 0, 0]}}}}
cameras:
  overhead: {{position: [-0.4, 0, 1.6], look_at: [0.45, 0.1, 0]}}
goal: {{object: brick, pose: {{xyz: [0.42, 0.25, 0.04]}}}}
"""


def write_task(folder: Path, kind: str) -> Path:
    """A brick to be put to the other side of a wall by the robot of a kind; returns the task's file."""
    write_robot(folder, kind)
    path = folder / f"{kind}_task.yaml"
    path.write_text(TASK.format(model=f"{kind}.yaml"))
    return path
