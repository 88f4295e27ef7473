"""HPP's side: a task as a constraint graph of hpp-manipulation, solved by its ManipulationPlanner.

A program of its own, without hmap: it runs in an environment with ``hpp-python`` 9.0.2, reads a problem as JSON from
standard input and writes the answer as JSON to standard output. :mod:`hmap_core.benchmark.hpp_planner` starts it.
Mirabel and Lamiraux, Manipulation planning: addressing the crossed foliation issue, ICRA 2017.
"""

import ctypes
import json
import os
import sys
import time

import numpy as np
import pinocchio
from pyhpp.constraints import ComparisonType, ComparisonTypes, Implicit, LockedJoint, Transformation
from pyhpp.core import Dichotomy, Straight
from pyhpp.manipulation import Device, Graph, ManipulationPlanner, Problem, ProgressiveProjector, RandomShortcut, urdf
from pyhpp.manipulation.constraint_graph_factory import ConstraintGraphFactory

PANDA = "package://example-robot-data/robots/panda_description/"
HAND, GRIPPER = "arm/panda_hand", "arm/gripper"
PLANE = [False, False, True, True, True, False]  # of x, y, z, roll, pitch, yaw: what a support decides
LEVEL_BOUND = 1.01  # of the components of quaternions
STEP = 0.01  # of the projection of paths on the constraints
SAMPLED = 0.05  # of the path's parameter between two configurations of the answer
ERROR, ITERATIONS = 1e-5, 60  # of the projection on a manifold
EMPTY_SRDF = "<robot name='none'/>"


def se3(pose: list[float]) -> pinocchio.SE3:
    """A pose (7,) with the quaternion's w last."""
    return pinocchio.XYZQUATToSE3(np.array(pose, float))


def load(task: dict) -> Device:
    """The robot, the fixed bodies and the objects, with their handles."""
    robot = Device("task")
    urdf.loadModel(robot, 0, "arm", "anchor", PANDA + "urdf/panda.urdf", PANDA + "srdf/panda.srdf", se3(task["base"]))
    for k, limits in enumerate(task["limits"]):
        robot.setJointBounds(f"arm/panda_joint{k + 1}", limits)
    for name, body in task["fixed"].items():
        urdf.loadModelFromString(robot, 0, name, "anchor", body["urdf"], EMPTY_SRDF, se3(body["pose"]))
    for name, body in task["objects"].items():
        urdf.loadModelFromString(robot, 0, name, "freeflyer", body["urdf"], EMPTY_SRDF, pinocchio.SE3.Identity())
        bounds = [value for pair in zip(task["lower"], task["upper"], strict=True) for value in pair]
        robot.setJointBounds(f"{name}/root_joint", bounds + [-LEVEL_BOUND, LEVEL_BOUND] * 4)
    robot.addGripper(HAND, GRIPPER, se3(task["T_hand_ee"]), 0.0)
    for name, body in task["objects"].items():
        for k, contact in enumerate(body["contacts"]):
            handle = f"{name}/contact{k}"
            robot.addHandle(f"{name}/body", handle, se3(contact["T_obj_ee"]), contact["distance"], [True] * 6)
            robot.handles()[handle].approachingDirection = np.array(contact["approach"])
    return robot


def compared(kinds: list) -> ComparisonTypes:
    """Comparison types of a constraint."""
    found = ComparisonTypes()
    found[:] = tuple(kinds)
    return found


def supports(robot: Device, task: dict) -> dict:
    """For each object that it stays on its support, where it stands there, and both."""
    zero, equal, found = ComparisonType.EqualToZero, ComparisonType.Equality, {}
    one = pinocchio.SE3.Identity()
    for name, body in task["objects"].items():
        joint, level, own = robot.model().getJointId(f"{name}/root_joint"), se3(body["start"]), f"place_{name}"
        other = [not along for along in PLANE]
        function = Transformation(own, robot, joint, one, level, PLANE)
        found[own] = Implicit(function, compared([zero] * 3), [True] * 3)
        function = Transformation(f"{own}/complement", robot, joint, one, level, other)
        found[f"{own}/complement"] = Implicit(function, compared([equal] * 3), [True] * 3)
        both = [zero if along else equal for along in PLANE]
        found[f"{own}/hold"] = LockedJoint(robot, f"{name}/root_joint", np.array(body["start"]), compared(both))
        function = Transformation(f"preplace_{name}", robot, joint, one, level, [False] * 6)
        found[f"preplace_{name}"] = Implicit(function, compared([]), [])
    return found


def constraint_graph(robot: Device, task: dict, problem: Problem) -> Graph:
    """One state for each contact and one for free hands; objects slide on their supports in all of them."""
    graph = Graph("graph", robot, problem)
    graph.maxIterations(ITERATIONS)
    graph.errorThreshold(ERROR)
    constraints, names = supports(robot, task), list(task["objects"])
    for name in names:
        graph.registerConstraints(*(constraints[f"place_{name}{end}"] for end in ("", "/complement", "/hold")))
    factory = ConstraintGraphFactory(graph, constraints)
    factory.setGrippers([GRIPPER])
    handles = [[f"{name}/contact{k}" for k in range(len(task["objects"][name]["contacts"]))] for name in names]
    factory.setObjects(names, handles, [[] for _ in names])
    factory.generate()
    for name, own in zip(names, handles, strict=True):
        for handle in own:
            state = graph.getState(f"{GRIPPER} grasps {handle}")
            graph.addNumericalConstraintsToState(state, [constraints[f"place_{name}"]])
    half = task["opening"] / 2.0
    fingers = [LockedJoint(robot, f"arm/panda_finger_joint{k}", np.array([half])) for k in (1, 2)]
    graph.addNumericalConstraintsToGraph(fingers)
    return graph


def configuration(robot: Device, task: dict, key: str) -> np.ndarray:
    """The whole configuration with the objects at ``start`` or ``goal``."""
    q = robot.currentConfiguration().copy()
    model = robot.model()

    def set_joint(joint: str, values: list[float]) -> None:
        first = model.joints[model.getJointId(joint)].idx_q
        q[first : first + len(values)] = values

    for k, value in enumerate(task["q"]):
        set_joint(f"arm/panda_joint{k + 1}", [value])
    for k in (1, 2):
        set_joint(f"arm/panda_finger_joint{k}", [task["opening"] / 2.0])
    for name, body in task["objects"].items():
        set_joint(f"{name}/root_joint", body[key])
    return q


def solve(task: dict) -> dict:
    """The answer: whether it is solved, and each part of the path as configurations of the arm and poses of objects."""
    ctypes.CDLL(None).srand(task["seed"])
    robot = load(task)
    problem = Problem(robot)
    graph = constraint_graph(robot, task, problem)
    problem.steeringMethod = Straight(problem)
    problem.pathValidation = Dichotomy(robot, 0)
    problem.pathProjector = ProgressiveProjector(problem.distance(), problem.steeringMethod, STEP)
    graph.initialize()
    start, goal = (configuration(robot, task, key) for key in ("start", "goal"))
    problem.initConfig(start)
    problem.addGoalConfig(goal)
    problem.constraintGraph(graph)
    planner = ManipulationPlanner(problem)
    planner.maxIterations(10**8)
    planner.timeOut(float(task["time_limit"]))
    began = time.monotonic()
    try:
        path = planner.solve()
    except Exception as error:
        return {"solved": False, "reason": f"{type(error).__name__}: {error}"}
    left = task["time_limit"] - (time.monotonic() - began)
    if left > 0.0:
        path = RandomShortcut(problem).optimize(path)
    return {"solved": True, "parts": parts(robot, task, path)}


def parts(robot: Device, task: dict, path) -> list[dict]:
    """The parts of a path, sampled."""
    model = robot.model()
    arm = [model.joints[model.getJointId(f"arm/panda_joint{k + 1}")].idx_q for k in range(len(task["q"]))]
    root = {name: model.joints[model.getJointId(f"{name}/root_joint")].idx_q for name in task["objects"]}
    found = []
    for part in flat(path):
        first, length = part.timeRange().first, part.length()
        count = max(2, int(np.ceil(length / SAMPLED)) + 1)
        rows = np.array([part(first + s)[0] for s in np.linspace(0.0, length, count)])
        poses = {name: rows[:, at : at + 7].tolist() for name, at in root.items()}
        found.append({"q": rows[:, arm].tolist(), "poses": poses})
    return found


def flat(path) -> list:
    """The paths of which a path is made, each within one transition of the graph."""
    if not hasattr(path, "pathAtRank"):
        return [path]
    return [own for k in range(path.numberPaths()) for own in flat(path.pathAtRank(k))]


if __name__ == "__main__":
    out = os.dup(1)
    os.dup2(2, 1)  # libraries print to standard output
    answer = json.dumps(solve(json.load(sys.stdin)))
    os.write(out, answer.encode())
