"""The judge on real arms: two Pandas, one of which carries a box by the touch of its closed fingertips."""

import copy

import numpy as np
import pytest
import validation_fixtures as plans
from scipy.spatial.transform import Rotation

from hmap_core.validation import Kind, arm, check, document
from hmap_core.validation.reader import Reader

READY = np.array([0.0, -0.785398, 0.0, -2.356194, 0.0, 1.570796, 0.785398])
LOWER = [-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973]
UPPER = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973]
CARRY = 0.05  # m


def panda(base, q=READY) -> dict:
    fingers = ["panda_finger_joint1", "panda_finger_joint2"]
    links = ["panda_leftfinger", "panda_rightfinger"]
    return {
        "urdf": "pybullet_data://franka_panda/panda.urdf",
        "base_pose": base,
        "q_start": list(q),
        "joint_names": [f"panda_joint{i}" for i in range(1, 8)],
        "end_effector_link": "panda_hand",
        "T_link_ee": [0, 0, 0.105, 0, 0, 0, 1],
        "position_limits": [LOWER, UPPER],
        "velocity_limits": [2.175] * 4 + [2.61] * 3,
        "acceleration_limits": [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0],
        "ignored_collisions": [],
        "gripper": {"joint_names": fingers, "per_joint": 0.5, "finger_links": links},
    }


def error(robot: arm.Arm, position, q: np.ndarray) -> np.ndarray:
    """How far the configurations (N, 7) are from fingers straight down at a position, (N, 6)."""
    R, p = robot.end_effector(robot.frames(robot.values(q, np.zeros(len(q)))))
    return np.hstack([p - position, Rotation.from_matrix(R @ np.diag([1, -1, -1])).as_rotvec()])


def solve(robot: arm.Arm, position, q: np.ndarray) -> np.ndarray:
    """A configuration near ``q`` with the fingers straight down at a position, by Gauss-Newton steps of least norm."""
    h = 1e-6
    for _ in range(50):
        values = error(robot, position, np.vstack([q, q + h * np.eye(7)]))
        if np.abs(values[0]).max() < 1e-10:
            return q
        step = np.linalg.pinv((values[1:] - values[0]).T / h) @ values[0]
        q = q - step * min(1.0, 0.3 / np.abs(step).max())
    raise AssertionError(f"no configuration reaches {position}")


def ramp(seconds: float) -> np.ndarray:
    u = np.arange(1, round(seconds / plans.DT) + 1) / round(seconds / plans.DT)
    return 10 * u**3 - 15 * u**4 + 6 * u**5


def fingertip_depth(robot: arm.Arm) -> float:
    """How far the fingers reach beyond the end-effector frame."""
    shapes = [shape for shape in robot.tree.shapes if shape.link == "panda_leftfinger"]
    return max(float((shape.solid.points[:, 2] + shape.p[2]).max()) for shape in shapes) + 0.0584 - 0.105


@pytest.fixture(scope="module")
def valid():
    """Down to a box, 5 cm along x on a straight line, and up again; the other arm stands by."""
    base = plans.pose(-0.5, 0.0, 0.0)
    robot = arm.build(document._robot("left", Reader(panda(base), "left")))
    side = 0.08
    on_top = side + fingertip_depth(robot)
    above = solve(robot, [0.0, 0.0, on_top + 0.1], READY)
    down = solve(robot, [0.0, 0.0, on_top], above)
    line = [down]
    for s in ramp(1.0):
        line.append(solve(robot, [CARRY * s, 0.0, on_top], line[-1]))
    up = solve(robot, [CARRY, 0.0, on_top + 0.1], line[-1])
    approach = [above + s * (down - above) for s in ramp(1.0)]
    retreat = [line[-1] + s * (up - line[-1]) for s in ramp(1.0)]
    q = [above, *approach, *line[1:], *retreat]
    shift = np.concatenate([np.zeros(51), CARRY * ramp(1.0), np.full(50, CARRY)])
    N = len(q)
    segments = [(0.0, 1.0, "transit"), (1.0, 2.0, "touch"), (2.0, 3.0, "transit")]
    R, p = robot.end_effector(robot.frames(robot.values(down[None], np.zeros(1))))
    contact = [*(p[0] - [0, 0, side / 2]), *Rotation.from_matrix(R[0]).as_quat()]
    return {
        "format": "hmap-plan",
        "version": 1,
        "mode": "kinematic",
        "scene": {"bodies": [plans.table(), plans.box("box", (side,) * 3, (0.0, 0.0, side / 2))]},
        "goal": plans.goal("box", (CARRY, 0.0, side / 2)),
        "robots": {"left": panda(base, above), "right": panda(plans.pose(0.0, 0.9, 0.0))},
        "trajectory": {
            "time": [k * plans.DT for k in range(N)],
            "joints": {"left": [x.tolist() for x in q], "right": [READY.tolist()] * N},
            "gripper": {"left": [0.0] * N, "right": [0.0] * N},
            "objects": {"box": [plans.pose(float(x), 0.0, side / 2) for x in shift]},
        },
        "segments": [
            {
                "start": start,
                "end": end,
                "robot": "left",
                "manipulator": "panda_hand",
                "object": "box" if kind == "touch" else None,
                "kind": kind,
                "contact_pose": contact if kind == "touch" else None,
            }
            for start, end, kind in segments
        ],
    }


@pytest.fixture
def plan(valid):
    return copy.deepcopy(valid)


def test_valid_plan_is_accepted(plan):
    report = check(plan)
    assert report.violations == ()
    assert report.goal_error["position_m"] < 1e-9
    assert 0.02 < report.min_clearance_m < 0.1  # the hand over the box


def sweep(plan: dict, robot: str, to) -> None:
    """Let a robot that has nothing to do move to a configuration, one second long."""
    N = len(plan["trajectory"]["time"])
    s = np.concatenate([[0.0], ramp(3.0)])[:N, None]
    q = READY + s * (np.asarray(to) - READY)
    plan["trajectory"]["joints"][robot] = q.tolist()


def test_robot_robot_collision(plan):
    plan["robots"]["right"]["base_pose"] = [0.45, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0]  # face to face
    sweep(plan, "right", READY + [0, 0.6, 0, 0, 0, 0, 0])
    found = plans.worst(check(plan), Kind.PENETRATION)
    assert {body.split("/")[0] for body in found.bodies} == {"left", "right"}


def test_self_collision(plan):
    sweep(plan, "right", READY * [1, 1, 1, 1, 1, 0, 1])  # the wrist folds back into the forearm
    report = check(plan)
    assert plans.kinds(report) == {"penetration"}
    assert {body.split("/")[0] for violation in report.violations for body in violation.bodies} == {"right"}


def test_the_sweep_alone_is_no_violation(plan):
    sweep(plan, "right", READY + [0.5, 0.2, 0, 0.2, 0, 0, 0])
    assert check(plan).valid


def test_thin_wall_between_samples(plan):
    # the right arm swings round; a sheet of 2 mm stands on end where its fingers are between two samples
    sweep(plan, "right", READY + [1.0, 0, 0, 0, 0, 0, 0])
    clear = check(plan)
    assert clear.valid
    robot = arm.build(document._robot("right", Reader(plan["robots"]["right"], "right")))
    q = np.array(plan["trajectory"]["joints"]["right"])
    q = q[::6]  # fast enough to leave gaps: six times the speed
    q[:, 6] -= np.pi / 2  # the narrow side of the fingers ahead
    time = np.arange(len(q)) * plans.DT
    k = len(q) // 2
    _, p = robot.end_effector(robot.frames(robot.values(q, np.zeros(len(q)))))
    middle, along = (p[k] + p[k + 1]) / 2, p[k + 1] - p[k]
    yaw = np.arctan2(along[1], along[0])
    sheet = plans.box("sheet", (0.002, 0.2, 0.02), (*middle[:2], middle[2]), "fixed")
    sheet["pose"][3:] = [0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)]
    short = copy.deepcopy(plan)
    short["scene"]["bodies"].append(sheet)
    short["trajectory"] = {
        "time": time.tolist(),
        "joints": {"left": [short["robots"]["left"]["q_start"]] * len(q), "right": q.tolist()},
        "gripper": {"left": [0.0] * len(q), "right": [0.0] * len(q)},
        "objects": {},
    }
    short["segments"] = [plan["segments"][0] | {"end": float(time[-1])}]
    found = [v for v in check(short).violations if v.kind == Kind.PENETRATION and "sheet" in v.bodies]
    assert found
    assert any(time[k] < v.time < time[k + 1] for v in found)
