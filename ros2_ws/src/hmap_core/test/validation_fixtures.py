"""Plans built by hand for the tests of the judge: gantries whose hand is simply where its three joints say.

The table's top is z = 0. A gantry's joints x, y, z are the world position of its end-effector frame; its two fingers
close along y, and their tips are 1 cm below that frame.
"""

import copy
from dataclasses import dataclass, field

import numpy as np

DT = 0.02  # s
SIDE = 0.06  # m, edge of the cube that is carried about
TIP = 0.01  # m, fingertips below the end-effector frame
OPEN = 0.08  # m
REST = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
VELOCITY, ACCELERATION = 3.0, 40.0  # m/s, m/s^2

GANTRY = """<robot name="gantry">
  <link name="base"><collision>
    <origin xyz="0.6 0.6 0.5"/><geometry><box size="0.1 0.1 1"/></geometry></collision></link>
  <link name="carriage_x"/>
  <link name="carriage_y"/>
  <link name="hand"><collision>
    <origin xyz="0 0 0.07"/><geometry><box size="0.03 0.14 0.06"/></geometry></collision></link>
  <link name="left"><collision>
    <origin xyz="0 0.005 0.015"/><geometry><box size="0.02 0.01 0.05"/></geometry></collision></link>
  <link name="right"><collision>
    <origin xyz="0 -0.005 0.015"/><geometry><box size="0.02 0.01 0.05"/></geometry></collision></link>
  {joints}
</robot>
"""


def _prismatic(name: str, parent: str, child: str, axis: str, lower: float, upper: float, velocity: float) -> str:
    return (
        f'<joint name="{name}" type="prismatic"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
        f'<limit lower="{lower}" upper="{upper}" velocity="{velocity}" effort="1"/></joint>'
    )


def write_gantry(folder) -> str:
    """The gantry's URDF in a folder; its path."""
    joints = [
        _prismatic("x", "base", "carriage_x", "1 0 0", -2, 2, VELOCITY),
        _prismatic("y", "carriage_x", "carriage_y", "0 1 0", -2, 2, VELOCITY),
        _prismatic("z", "carriage_y", "hand", "0 0 1", 0, 2, VELOCITY),
        _prismatic("finger_left", "hand", "left", "0 1 0", 0, 0.04, 0.2),
        _prismatic("finger_right", "hand", "right", "0 -1 0", 0, 0.04, 0.2),
    ]
    path = folder / "gantry.urdf"
    path.write_text(GANTRY.format(joints="\n  ".join(joints)))
    return str(path)


def pose(x: float, y: float, z: float) -> list[float]:
    """An upright pose."""
    return [x, y, z, 0.0, 0.0, 0.0, 1.0]


def box(name: str, size, at, kind: str = "movable", friction: float = 0.5) -> dict:
    """A box of the plan file."""
    values = {"shape": "box", "size": list(size), "pose": pose(*at), "mass": 0.2, "friction": friction}
    return {"name": name, "kind": kind, "graspable": [], **values}


def table() -> dict:
    return box("table", (3.0, 3.0, 0.1), (0.0, 0.0, -0.05), "fixed")


def gantry(urdf: str, start) -> dict:
    """A gantry of the plan file."""
    return {
        "model": "gantry",
        "urdf": urdf,
        "base_pose": REST,
        "joint_names": ["x", "y", "z"],
        "q_start": list(start),
        "end_effector_link": "hand",
        "T_link_ee": REST,
        "position_limits": [[-1.0, -1.0, 0.0], [1.0, 1.0, 1.0]],
        "velocity_limits": [VELOCITY] * 3,
        "acceleration_limits": [ACCELERATION] * 3,
        "ignored_collisions": [],
        "gripper": {
            "joint_names": ["finger_left", "finger_right"],
            "per_joint": 0.5,
            "finger_links": ["left", "right"],
            "min_opening": 0.0,
            "max_opening": 0.078,
        },
    }


@dataclass
class Storyboard:
    """Builds the trajectory of one gantry move by move; each move starts and ends at rest.

    A contact move carries its object along. Other bodies and robots stay where they are.
    """

    start: tuple[float, float, float]
    opening: float
    bodies: list[dict]
    robot: str = "gantry"
    q: list = field(default_factory=list)
    openings: list = field(default_factory=list)
    segments: list = field(default_factory=list)
    objects: dict = field(default_factory=dict)

    def __post_init__(self):
        self.q = [np.array(self.start, float)]
        self.openings = [self.opening]
        self.objects = {b["name"]: [np.array(b["pose"], float)] for b in self.bodies if b["kind"] != "fixed"}

    def move(self, kind: str, to, seconds: float, opening: float | None = None, carries=(), manipulator="hand"):
        """Go to a hand position along a quintic; ``carries`` are the bodies that come along, the touched one first."""
        steps = round(seconds / DT)
        first = len(self.q) - 1
        u = np.arange(1, steps + 1) / steps
        s = (10 * u**3 - 15 * u**4 + 6 * u**5)[:, None]
        begin, end = self.q[-1], np.array(to, float)
        self.q += list(begin + s * (end - begin))
        closed = self.openings[-1] if opening is None else opening
        self.openings += list(self.openings[-1] + s[:, 0] * (closed - self.openings[-1]))
        for name, poses in self.objects.items():
            offset = np.zeros((steps, 7))
            if name in carries:
                offset[:, :3] = np.array(self.q[first + 1 :]) - begin
            poses += list(poses[-1] + offset)
        self._note(kind, first, carries, manipulator)
        return self

    def _note(self, kind: str, first: int, carries, manipulator: str) -> None:
        target = carries[0] if carries else None
        contact = None
        if target is not None:
            place = self.q[first] if manipulator == "hand" else self.objects[manipulator][first][:3]
            contact = pose(*(place - self.objects[target][first][:3]))
        entry = {"start": first * DT, "end": (len(self.q) - 1) * DT, "robot": self.robot, "manipulator": manipulator}
        self.segments.append({**entry, "object": target, "kind": kind, "contact_pose": contact})

    def plan(self, urdf: str, goal: dict, mode: str = "kinematic", others: dict | None = None) -> dict:
        """The plan file; ``others`` are further gantries that stand still, by name, with where."""
        N = len(self.q)
        places = {self.robot: self.start, **(others or {})}
        plan = {
            "format": "hmap-plan",
            "version": 1,
            "task": "hand-made",
            "seed": 0,
            "mode": mode,
            "scene": {"bodies": self.bodies},
            "goal": goal,
            "robots": {name: gantry(urdf, at) for name, at in places.items()},
            "trajectory": {
                "time": [k * DT for k in range(N)],
                "joints": {name: [list(at)] * N for name, at in places.items()},
                "gripper": {name: [OPEN] * N for name in places},
                "objects": {name: [p.tolist() for p in poses] for name, poses in self.objects.items()},
            },
            "segments": self.segments,
            "waypoints": [],
            "stats": {},
        }
        plan["trajectory"]["joints"][self.robot] = [q.tolist() for q in self.q]
        plan["trajectory"]["gripper"][self.robot] = [float(o) for o in self.openings]
        return copy.deepcopy(plan)


def goal(name: str, at, position: float = 0.005, rotation: float = 0.035) -> dict:
    tolerances = {"position_tolerance_m": position, "rotation_tolerance_rad": rotation}
    return {"object": name, "pose": pose(*at), **tolerances}


GRASP_Z, ABOVE = SIDE / 2, 0.3


def carry(urdf: str, extra=(), others: dict | None = None) -> dict:
    """A valid physical plan: grasp the cube at the origin, carry it 20 cm along x, put it down, and withdraw."""
    bodies = [table(), box("cube", (SIDE,) * 3, (0.0, 0.0, SIDE / 2)), *extra]
    board = Storyboard((0.0, 0.0, ABOVE), OPEN, bodies)
    board.move("transit", (0.0, 0.0, GRASP_Z), 1.0)
    board.move("transit", (0.0, 0.0, GRASP_Z), 0.4, opening=SIDE)
    board.move("grasp", (0.0, 0.0, 0.1), 0.6, carries=("cube",))
    board.move("grasp", (0.2, 0.0, 0.1), 0.8, carries=("cube",))
    board.move("grasp", (0.2, 0.0, GRASP_Z), 0.6, carries=("cube",))
    board.move("transit", (0.2, 0.0, GRASP_Z), 0.4, opening=OPEN)
    board.move("transit", (0.2, 0.0, ABOVE), 1.0)
    return board.plan(urdf, goal("cube", (0.2, 0.0, SIDE / 2)), "physical", others)


def touch(urdf: str) -> dict:
    """A valid kinematic plan: closed fingertips on top of the cube carry and place it."""
    bodies = [table(), box("cube", (SIDE,) * 3, (0.0, 0.0, SIDE / 2))]
    on_top = SIDE + TIP
    board = Storyboard((0.0, 0.0, ABOVE), 0.0, bodies)
    board.move("transit", (0.0, 0.0, on_top), 1.0)
    board.move("touch", (0.0, 0.0, on_top + 0.05), 0.6, carries=("cube",))
    board.move("touch", (0.0, 0.2, on_top + 0.05), 0.8, carries=("cube",))
    board.move("touch", (0.0, 0.2, on_top), 0.6, carries=("cube",))
    board.move("transit", (0.0, 0.2, ABOVE), 1.0)
    return board.plan(urdf, goal("cube", (0.0, 0.2, SIDE / 2)))


def push(urdf: str, to=(0.1, 0.0), friction: float = 0.5, table_end: float = 1.5) -> dict:
    """A physical plan: the closed fingers stand behind the cube and push it along the table to a place (x, y)."""
    board_size = (table_end + 1.5, 3.0, 0.1)
    ground = box("table", board_size, (table_end / 2 - 0.75, 0.0, -0.05), "fixed")
    bodies = [ground, box("cube", (SIDE,) * 3, (0.0, 0.0, SIDE / 2), friction=friction)]
    behind = -SIDE / 2 - 0.01  # the fingers are 2 cm deep along x
    board = Storyboard((behind, 0.0, ABOVE), 0.0, bodies)
    board.move("transit", (behind, 0.0, GRASP_Z), 1.0)
    board.move("push", (behind + to[0], to[1], GRASP_Z), 1.0, carries=("cube",))
    board.move("transit", (behind + to[0], to[1], ABOVE), 1.0)
    return board.plan(urdf, goal("cube", (*to, SIDE / 2)), "physical")


PLATE = (0.12, 0.1, 0.01)  # m


def press(
    urdf: str,
    to=(0.15, 0.0),
    force: float = 5.0,
    ground: float = 0.6,
    at: tuple[float, float, float] = (0.0, 0.0, PLATE[2] + TIP),
    rise: float = 0.0,
    table_end: float = 1.5,
) -> dict:
    """A physical plan: closed fingertips press on a plate of 0.2 kg and drag it over the table to a place (x, y).

    Args:
        urdf: of the gantry.
        to: (x, y) of the plate at the end.
        force: N.
        ground: friction coefficient of the table.
        at: of the hand where it presses.
        rise: m that hand and plate rise on the way.
        table_end: x at which the table ends.
    """
    carrier = box("table", (table_end + 1.5, 3.0, 0.1), (table_end / 2 - 0.75, 0.0, -0.05), "fixed", ground)
    bodies = [carrier, box("plate", PLATE, (0.0, 0.0, PLATE[2] / 2))]
    board = Storyboard((at[0], at[1], ABOVE), 0.0, bodies)
    board.move("transit", at, 1.0)
    middle = (at[0] + to[0] / 2, at[1] + to[1] / 2, at[2] + rise)
    board.move("press", middle, 1.0, carries=("plate",))
    board.move("press", (at[0] + to[0], at[1] + to[1], at[2]), 1.0, carries=("plate",))
    board.move("transit", (at[0] + to[0], at[1] + to[1], ABOVE), 1.0)
    plan = board.plan(urdf, goal("plate", (*to, PLATE[2] / 2)), "physical")
    for segment in plan["segments"]:
        if segment["kind"] == "press":
            segment["force"] = force
    return plan


TURRET = """<robot name="turret">
  <link name="base"/>
  <link name="paw"><collision>
    <origin xyz="{radius} 0 0.03"/><geometry><box size="0.02 0.02 0.05"/></geometry></collision></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="paw"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" velocity="3" effort="1"/></joint>
</robot>
"""


def arc_push(folder, radius: float, dt: float = DT, aside: float = 0.0) -> dict:
    """A physical plan: a paw on a turntable pushes the cube round an arc of one radian in two seconds.

    ``aside`` shifts the cube outwards from the middle of the paw.
    """
    urdf = folder / f"turret_{radius}.urdf"
    urdf.write_text(TURRET.format(radius=radius))
    u = np.linspace(0.0, 1.0, round(2.0 / dt) + 1)
    q = 10 * u**3 - 15 * u**4 + 6 * u**5
    x, y = radius + aside, 0.01 + SIDE / 2
    cos, sin = np.cos(q), np.sin(q)
    level = np.full(len(q), SIDE / 2)
    poses = np.column_stack([x * cos - y * sin, x * sin + y * cos, level, 0 * q, 0 * q, np.sin(q / 2), np.cos(q / 2)])
    cube = box("cube", (SIDE,) * 3, poses[0, :3])
    end = goal("cube", (0, 0, 0)) | {"pose": poses[-1].tolist()}
    turret = gantry(str(urdf), [0.0]) | {"joint_names": ["turn"], "end_effector_link": "paw", "gripper": None}
    turret |= {"position_limits": [[-3.0], [3.0]], "velocity_limits": [3.0], "acceleration_limits": [40.0]}
    contact = pose(-x, -y, -SIDE / 2)
    push = {"start": 0.0, "end": 2.0, "robot": "turret", "manipulator": "paw", "object": "cube", "kind": "push"}
    return {
        "format": "hmap-plan",
        "version": 1,
        "mode": "physical",
        "scene": {"bodies": [table(), cube]},
        "goal": end,
        "robots": {"turret": turret},
        "trajectory": {
            "time": [k * dt for k in range(len(q))],
            "joints": {"turret": q[:, None].tolist()},
            "objects": {"cube": poses.tolist()},
        },
        "segments": [push | {"contact_pose": contact}],
    }


def tool_use(urdf: str) -> dict:
    """A valid kinematic plan: the gantry grasps a stick, carries it to the cube, and the stick carries the cube."""
    bodies = [
        table(),
        box("stick", (0.3, SIDE, SIDE), (0.0, 0.0, SIDE / 2), "tool"),
        box("cube", (SIDE,) * 3, (0.4, 0.0, SIDE / 2)),
    ]
    reach = 0.4 - SIDE / 2 - 0.15  # the stick's end meets the cube
    board = Storyboard((0.0, 0.0, ABOVE), OPEN, bodies)
    board.move("transit", (0.0, 0.0, GRASP_Z), 1.0)
    board.move("transit", (0.0, 0.0, GRASP_Z), 0.4, opening=SIDE)
    board.move("grasp", (reach, 0.0, GRASP_Z), 1.0, carries=("stick",))
    board.move("touch", (reach, 0.2, GRASP_Z), 1.0, carries=("cube", "stick"), manipulator="stick")
    board.move("grasp", (0.0, 0.2, GRASP_Z), 1.0, carries=("stick",))
    board.move("transit", (0.0, 0.2, GRASP_Z), 0.4, opening=OPEN)
    board.move("transit", (0.0, 0.2, ABOVE), 1.0)
    return board.plan(urdf, goal("cube", (0.4, 0.2, SIDE / 2)))


def kinds(report) -> set[str]:
    """The kinds of violation in a report."""
    return {str(violation.kind) for violation in report.violations}


def worst(report, kind: str):
    """The violation of a kind; fails when there is none."""
    found = [violation for violation in report.violations if violation.kind == kind]
    assert found, f"no {kind} in {kinds(report)}"
    return max(found, key=lambda violation: violation.amount)


def segment(plan: dict, kind: str) -> dict:
    """The first segment of a kind."""
    return next(entry for entry in plan["segments"] if entry["kind"] == kind)


def sample(plan: dict, time: float) -> int:
    """The index of the sample at a time."""
    return round(time / DT)
