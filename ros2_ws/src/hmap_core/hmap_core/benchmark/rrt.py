"""Object paths: hmap's search of Algorithm 2 against RAI's RRT_PathFinder and OMPL's RRTConnect, judged as poses.

A path is an array (n, 7) of poses of the object, between which it moves straight, and turns at a constant rate about
one axis. RAI interpolates quaternions linearly: along the same arc, and at its step by less than 0.1 mm otherwise.
"""

from functools import partial

import numpy as np

from hmap_core.benchmark.instances import Answer
from hmap_core.benchmark.rai_side import robotic, wxyz
from hmap_core.transforms import wrapped
from hmap_core.types import Body
from hmap_core.validation import rigid
from hmap_core.validation.geometry import Boxes, Gauge, box_gap, solid, transform
from hmap_core.waypoints import ObjectPathProblem
from hmap_core.waypoints.ompl_planner import OmplMotionSpace
from hmap_core.waypoints.search import find_corners

TIME_LIMIT = 60.0  # s
SEED = 0  # of the search
OMPL_PLANNER = "RRTConnect"
# the judge's
MOTION = 0.002  # m that a point moves between two samples
PENETRATION = 1e-3  # m
END_TOLERANCE = 1e-6  # m, and of the quaternion
# RAI's, with which it was fastest while its paths verified; docs/waypoints.md lists what was tried
STEP = {"planar": 0.2, "spatial": 0.1}  # m, rad and quaternion components alike
SUBSAMPLES = {"planar": 16, "spatial": 8}  # of a step that are checked
MAX_ITERATIONS = 50_000
ROUNDING = 1e-3  # m, of the edges: RAI finds no depth between sharp boxes


def prepare_hmap(problem: ObjectPathProblem) -> None:
    """Nothing: all of it is inside of the clock."""


def solve_hmap(problem: ObjectPathProblem, prepared: None) -> Answer:
    """The search as ``plan_waypoints`` begins with it, neither shortened nor resampled."""
    found = find_corners(problem, np.random.default_rng(SEED), TIME_LIMIT)
    return Answer(False) if found is None else Answer(True, found.poses)


def solve_ompl(problem: ObjectPathProblem, prepared: None) -> Answer:
    """OMPL's RRTConnect with hmap's checks, neither shortened nor resampled; the rest of the search is hmap's."""
    make_space = partial(OmplMotionSpace, OMPL_PLANNER)
    found = find_corners(problem, np.random.default_rng(SEED), TIME_LIMIT, make_space)
    return Answer(False) if found is None else Answer(True, found.poses)


def prepare_rai(problem: ObjectPathProblem):
    """A Config in which the object hangs on joints: x, y and yaw, or x, y, z and a quaternion.

    Raises:
        ValueError: the problem has no bounds.
    """
    ry = robotic()
    C = ry.Config()
    C.addFrame("world")
    if problem.bounds is None:
        raise ValueError("the problem has no bounds")
    lower, upper = problem.bounds
    if problem.motion == "planar":
        limits = [lower[0], lower[1], -np.pi, upper[0], upper[1], np.pi]
        C.addFrame("mover", "world").setJoint(ry.JT.transXYPhi, limits=limits)
    else:
        C.addFrame("position", "world").setJoint(ry.JT.trans3, limits=[*lower, *upper])
        C.addFrame("mover", "position").setJoint(ry.JT.quatBall, limits=[-1.0] * 4 + [1.0] * 4)
    frame = C.addFrame(problem.body.name, "mover")
    if problem.motion == "planar":
        frame.setRelativePosition([0.0, 0.0, problem.start[2]])
    _shape(ry, frame, problem.body)
    for body in problem.obstacles:
        frame = C.addFrame(body.name, "world").setPose(wxyz(body.pose))
        _shape(ry, frame, body)
    return C


def _shape(ry, frame, body: Body) -> None:
    frame.setShape(ry.ST.ssBox, [*body.shapes[0].size, ROUNDING]).setContact(1)


def solve_rai(problem: ObjectPathProblem, config) -> Answer:
    """RRT_PathFinder on a prepared Config."""
    ry = robotic()
    ry.rnd_seed(SEED)
    finder = ry.RRT_PathFinder()
    finder.setOptions(stepsize=STEP[problem.motion], subsamples=SUBSAMPLES[problem.motion], maxIters=MAX_ITERATIONS)
    finder.setProblem(config)
    finder.setStartGoal(*(_joints(problem, T) for T in (problem.start, problem.goal)))
    result = finder.solve(0)
    return Answer(True, _poses(problem, np.array(result.x))) if result.feasible else Answer(False)


def _joints(problem: ObjectPathProblem, T: np.ndarray) -> np.ndarray:
    """RAI's joint state at T_world_obj (7,)."""
    if problem.motion == "planar":
        return np.array([T[0], T[1], wrapped(2.0 * np.arctan2(T[5], T[6]))])
    return np.array(wxyz(T))


def _poses(problem: ObjectPathProblem, path: np.ndarray) -> np.ndarray:
    """Poses (n, 7) of RAI's joint states."""
    poses = np.zeros((len(path), 7))
    if problem.motion == "planar":
        poses[:, :2], poses[:, 2] = path[:, :2], problem.start[2]
        poses[:, 5], poses[:, 6] = np.sin(path[:, 2] / 2), np.cos(path[:, 2] / 2)
        return poses
    poses[:, :3], poses[:, 3:] = path[:, :3], path[:, [4, 5, 6, 3]]
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    return poses


def judge(problem: ObjectPathProblem, path: np.ndarray) -> list[str]:
    """What is wrong with a path (n, 7), in words: its ends, leaving the plane, and penetrations by coal."""
    wrong = [
        f"its {name} is not the problem's"
        for name, T, wanted in (("start", path[0], problem.start), ("end", path[-1], problem.goal))
        if np.abs(T[:3] - wanted[:3]).max() > END_TOLERANCE or rigid.angle_between(T[3:], wanted[3:]) > END_TOLERANCE
    ]
    R, p = _samples(problem.body, path)
    if problem.motion == "planar":
        z = R[:, :, 2] - R[0, :, 2]
        if np.abs(p[:, 2] - p[0, 2]).max() > END_TOLERANCE or np.abs(z).max() > END_TOLERANCE:
            wrong.append("it leaves the plane")
    for body in problem.obstacles:
        depth = _penetration(problem.body, R, p, body)
        if depth > PENETRATION:
            wrong.append(f"it penetrates '{body.name}' by {1e3 * depth:.1f} mm")
    return wrong


def _samples(body: Body, path: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotations (N, 3, 3) and positions (N, 3) so near to each other that no point of the body moves by MOTION."""
    reach = np.linalg.norm(body.shapes[0].size) / 2.0
    rows = [path[:1]]
    for a, b in zip(path[:-1], path[1:], strict=True):
        moved = np.linalg.norm(b[:3] - a[:3]) + reach * rigid.angle_between(a[3:], b[3:])
        s = np.linspace(0.0, 1.0, int(np.ceil(moved / MOTION)) + 1)[1:]
        q = rigid.slerp(np.tile(a[3:], (len(s), 1)), np.tile(b[3:], (len(s), 1)), s)
        rows.append(np.column_stack([a[:3] + s[:, None] * (b[:3] - a[:3]), q]))
    poses = np.concatenate(rows)
    return rigid.matrices(poses[:, 3:]), poses[:, :3]


def _penetration(body: Body, R: np.ndarray, p: np.ndarray, other: Body) -> float:
    """Greatest depth in m of a one-shape body at N samples in another that stands; 0 when they stay apart."""
    a, b = (solid(str(s.kind), s.size) for s in (body.shapes[0], other.shapes[0]))
    R_other, p_other = rigid.matrices(other.pose[3:]), other.pose[:3]
    gaps = box_gap(Boxes.around(a, R, p), Boxes.around(b, R_other[None], p_other[None]))
    near = np.flatnonzero(gaps <= 0.0)
    gauge, there = Gauge(a, b), transform(R_other, p_other)
    return max((-gauge.distance(transform(R[k], p[k]), there) for k in near), default=0.0)
