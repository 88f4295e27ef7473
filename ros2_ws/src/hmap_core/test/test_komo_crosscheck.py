"""The same problems solved by another method: CasADi's Gauss-Newton SQP with HPIPM as its QP solver.

Everything on that side is its own: the kinematics are CasADi expressions of the numbers in the URDF file, distances are
formulas, and the derivatives are CasADi's. Both start from the same path, near enough to an optimum that both go to it:
round an obstacle there are several.
"""

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field

import casadi
import numpy as np
import pytest
from core_fixtures import arm, no_collisions
from scipy.spatial.transform import Rotation

from hmap_core.collision.convex import convex_set, transformed
from hmap_core.kinematics import KinematicModel, PlacedArm
from hmap_core.komo.features import (
    axis_alignment,
    clearance,
    joint_rate_limits,
    relative_pose,
    relative_position,
    stable,
)
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.options import SolverOptions
from hmap_core.komo.result import Status
from hmap_core.komo.transcription import KomoProblem
from hmap_core.transforms import multiply, pose, rotation_matrix, to_matrix
from hmap_core.types import Shape, ShapeKind

STEPS = 8
TAU = 0.2  # s
# The solver stops at what is good enough to execute, and looks between the steps; here it has to go on to the optimum
# at the steps.
CONVERGED = SolverOptions(
    mu=3.0, mu_growth=2.0, mu_max=1e4, tolerance=1e-8, outer=200, inner=50, iterations=3000, damping=1e-9,
    step_tolerance=1e-9, gain_tolerance=1e-14, optimality=1e-7, refinements=0,
)  # fmt: skip
NOISE = 0.02  # rad: of the first guesses
SQP = {
    "qpsol": "hpipm",
    "max_iter": 200,
    "tol_pr": 1e-8,
    "tol_du": 1e-6,
    "print_header": False,
    "print_iteration": False,
    "print_status": False,
    "print_time": False,
}
LESS = -1e10  # no lower bound
SPHERE, MIN_DISTANCE, BALL = (
    0.05,
    0.01,
    0.02,
)  # m: radius of the obstacle, minimum distance from it, radius of the attached ball
BESIDE = np.array(
    [0.04, 0.0, 0.02]
)  # m: how far an obstacle is off the straight line, so that one way round is shorter
HALF_BOX = np.array([0.03, 0.04, 0.3])  # m


def symbolic_tip(name: str, T_base: np.ndarray, q: casadi.SX) -> tuple[casadi.SX, casadi.SX]:
    """Rotation (3, 3) and position (3, 1) of the last moving link, straight from the URDF file."""
    model = arm(name).model
    joints = {j.get("name"): j for j in ElementTree.parse(model.urdf).getroot().findall("joint")}
    by_child = {j.find("child").get("link"): j for j in joints.values()}
    path, link = [], joints[model.joint_names[-1]].find("child").get("link")
    while link in by_child:
        path.append(by_child[link])
        link = path[-1].find("parent").get("link")
    T = casadi.DM(to_matrix(T_base))
    for joint in reversed(path):
        origin = joint.find("origin")
        xyz, rpy = (np.array([float(v) for v in origin.get(key, "0 0 0").split()]) for key in ("xyz", "rpy"))
        fixed = np.eye(4)
        fixed[:3, :3], fixed[:3, 3] = Rotation.from_euler("xyz", rpy).as_matrix(), xyz
        T = T @ casadi.DM(fixed)
        if joint.get("name") in model.joint_names:
            axis = casadi.DM([float(v) for v in joint.find("axis").get("xyz").split()])
            angle, K = q[model.joint_names.index(joint.get("name"))], casadi.skew(axis)
            turn = casadi.SX(casadi.diagcat(casadi.DM.eye(3) + 0, 1))
            turn[:3, :3] = casadi.SX.eye(3) + casadi.sin(angle) * K + (1 - casadi.cos(angle)) * (K @ K)
            T = T @ turn
    return T[:3, :3], T[:3, 3]


@dataclass
class Both:
    """One problem in two forms: ours, and cost, constraints and bounds of CasADi's."""

    name: str
    T_base: np.ndarray
    residuals: list = field(default_factory=list)
    constraints: list = field(default_factory=list)
    lower: list = field(default_factory=list)
    upper: list = field(default_factory=list)

    def __post_init__(self):
        placed = PlacedArm("arm", arm(self.name), self.T_base)
        self.model = KinematicModel([placed])
        self.home = placed.arm.model.home
        self.n = n = self.model.n
        self.problem = KomoProblem(self.model.chain, (STEPS,), no_collisions(), CONVERGED, tau=TAU)
        self.x = casadi.SX.sym("x", n, STEPS)
        home = casadi.DM(self.home)
        self.q = casadi.horzcat(home, home, self.x)  # step t is column t + 2
        self.add_cost(self.q[:, 2:] - 2 * self.q[:, 1:-1] + self.q[:, :-2])
        # our last frame has its axis along z; what is fixed to it is given in the axes of the URDF's link
        R, p = symbolic_tip(self.name, self.T_base, home)
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = np.array(casadi.DM(R)), np.array(casadi.DM(p)).ravel()
        ours = placed.arm.frames(self.home)
        tip = np.eye(4)
        tip[:3, :3], tip[:3, 3] = ours[0][-1], ours[1][-1]
        self.T_tip_link = np.linalg.inv(to_matrix(self.T_base) @ tip) @ matrix
        self.tip = self.model.tip("arm")

    def in_tip(self, point) -> np.ndarray:
        """A point (3,) of the URDF's link in our last frame."""
        return self.T_tip_link[:3, :3] @ point + self.T_tip_link[:3, 3]

    def point(self, step: int, local) -> casadi.SX:
        """World position (3, 1) of a point of the link at a step, -2 and -1 being the start."""
        R, p = symbolic_tip(self.name, self.T_base, self.q[:, step + 2])
        return p + R @ casadi.DM(local)

    def rotation(self, step: int) -> casadi.SX:
        return symbolic_tip(self.name, self.T_base, self.q[:, step + 2])[0]

    def add_cost(self, value: casadi.SX, weight: float = 1.0) -> None:
        self.residuals.append(casadi.vec(np.sqrt(weight) * value))

    def equal(self, value: casadi.SX) -> None:
        self.constraints.append(value)
        self.lower += [0.0] * value.numel()
        self.upper += [0.0] * value.numel()

    def below(self, value: casadi.SX, bound=0.0) -> None:
        self.constraints.append(value)
        self.lower += [LESS] * value.numel()
        self.upper += [bound] * value.numel()

    def solve(self, initial: np.ndarray):
        """(our result, their path (STEPS, n), their cost) from an initial path (STEPS, n)."""
        bounds = {"lbg": self.lower, "ubg": self.upper}
        bounds |= {"lbx": np.tile(self.model.chain.lower, STEPS), "ubx": np.tile(self.model.chain.upper, STEPS)}
        x, residual, g = casadi.vec(self.x), casadi.vertcat(*self.residuals), casadi.vertcat(*self.constraints)
        nlp = {"x": x, "f": casadi.sumsqr(residual) / 2, "g": g}
        J, weights = casadi.jacobian(residual, x), [casadi.SX.sym("f"), casadi.SX.sym("g", g.numel())]
        hessian = casadi.Function("hessian", [x, casadi.SX.sym("p", 0, 0), *weights], [weights[0] * J.T @ J])
        whole = {"N": 0, "nx": [x.numel()], "nu": [0], "ng": [g.numel()], "error_on_fail": False}  # as one stage
        sqp = casadi.nlpsol("sqp", "sqpmethod", nlp, SQP | {"hess_lag": hessian, "qpsol_options": whole})
        found = sqp(x0=initial.ravel(), **bounds)
        assert sqp.stats()["success"], sqp.stats()["return_status"]
        result = self.problem.solve(self.home, initial)
        assert result.status in (Status.FEASIBLE, Status.BETWEEN_STEPS), result.worst
        return result, np.array(found["x"]).reshape(STEPS, self.n), float(found["f"])


def reach_a_point(both: Both):
    """The link's point has to be 20 cm aside and lower at the end, its axis stays upright as well as it can."""
    local = np.array([0.0, 0.0, 0.1])
    start = np.array(casadi.DM(both.point(-1, local))).ravel()
    goal = start + [0.05, 0.2, -0.15]
    feature = relative_position(both.tip, both.in_tip(local), goal)
    both.problem.add(Objective(feature, ObjectiveType.EQ, [STEPS - 1]))
    both.equal(both.point(STEPS - 1, local) - casadi.DM(goal))
    upright = np.array(casadi.DM(both.rotation(-1)))[:, 2]
    axis = both.T_tip_link[:3, 2]
    weight = 0.5
    both.problem.add(Objective(axis_alignment(both.tip, axis, upright), ObjectiveType.SOS, range(STEPS), weight))
    for step in range(STEPS):
        both.add_cost(both.rotation(step)[:, 2] - casadi.DM(upright), weight)
    return start, goal


def reach_a_pose(both: Both):
    """The whole pose, 20 cm and 0.5 rad away, by position and by the nine numbers of the rotation."""
    R, p = (np.array(casadi.DM(value)) for value in symbolic_tip(both.name, both.T_base, casadi.DM(both.home)))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p.ravel()
    goal = multiply(pose(p.ravel() + [0.0, 0.2, -0.1], Rotation.from_matrix(R).as_quat()),
                    pose((0, 0, 0), Rotation.from_rotvec([0.2, 0.4, 0.2]).as_quat()))  # fmt: skip
    offset = pose(both.T_tip_link[:3, 3], Rotation.from_matrix(both.T_tip_link[:3, :3]).as_quat())
    both.problem.add(Objective(relative_pose(both.tip, offset, goal), ObjectiveType.EQ, [STEPS - 1]))
    error = casadi.DM(rotation_matrix(goal)).T @ both.rotation(STEPS - 1)
    both.equal(both.point(STEPS - 1, np.zeros(3)) - casadi.DM(goal[:3]))
    both.equal(casadi.inv_skew((error - error.T) / 2))


def round_a_sphere(both: Both):
    start, goal = reach_a_point(both)
    center = (start + goal) / 2 + BESIDE
    ball = convex_set([Shape(ShapeKind.SPHERE, (BALL,), pose(both.in_tip([0.0, 0.0, 0.1])))])
    obstacle = convex_set([Shape(ShapeKind.SPHERE, (SPHERE,), pose(center))])
    feature = clearance(both.tip, ball, 0, obstacle, MIN_DISTANCE)
    both.problem.add(Objective(feature, ObjectiveType.INEQ, range(STEPS)))
    for step in range(STEPS):
        apart = casadi.norm_2(both.point(step, [0.0, 0.0, 0.1]) - casadi.DM(center))
        both.below(SPHERE + BALL + MIN_DISTANCE - apart)


def round_a_box(both: Both):
    """Where the ball meets an upright edge or a face of the box, told by the sizes of what is beyond its faces."""
    start, goal = reach_a_point(both)
    T = pose((start + goal) / 2 + BESIDE, Rotation.from_rotvec([0, 0, 0.5]).as_quat())
    box = transformed(convex_set([Shape(ShapeKind.BOX, tuple(2 * HALF_BOX))]), T)
    ball = convex_set([Shape(ShapeKind.SPHERE, (BALL,), pose(both.in_tip([0.0, 0.0, 0.1])))])
    both.problem.add(Objective(clearance(both.tip, ball, 0, box, MIN_DISTANCE), ObjectiveType.INEQ, range(STEPS)))
    for step in range(STEPS):
        local = casadi.DM(rotation_matrix(T)).T @ (both.point(step, [0.0, 0.0, 0.1]) - casadi.DM(T[:3]))
        beyond = casadi.fmax(casadi.fabs(local) - casadi.DM(HALF_BOX), 0.0)
        both.below(BALL + MIN_DISTANCE - casadi.sqrt(casadi.sumsqr(beyond) + 1e-16))


def with_limited_rates(both: Both):
    reach_a_point(both)
    limit = np.array([0.12, 0.35])  # rad/s
    feature, target = joint_rate_limits(-limit, limit, 0)
    both.problem.add(Objective(feature, ObjectiveType.INEQ, range(STEPS), target=target, order=1))
    rate = (both.q[:2, 2:] - both.q[:2, 1:-1]) / TAU
    for step in range(STEPS):
        both.below(rate[:, step] - casadi.DM(limit))
        both.below(-rate[:, step] - casadi.DM(limit))


def smooth_in_the_world(both: Both):
    """A cost on the acceleration of a point, and the last steps in which nothing may move or turn."""
    local = np.array([0.0, 0.0, 0.1])
    middle, weight = STEPS // 2, 1e-3
    start = np.array(casadi.DM(both.point(-1, local))).ravel()
    goal = start + [0.05, 0.2, -0.15]
    both.problem.add(Objective(relative_position(both.tip, both.in_tip(local), goal), ObjectiveType.EQ, [middle]))
    both.equal(both.point(middle, local) - casadi.DM(goal))
    point = relative_position(both.tip, both.in_tip(local))
    both.problem.add(Objective(point, ObjectiveType.SOS, range(STEPS), weight, order=2))
    for step in range(STEPS):
        ends = [both.point(step - k, local) for k in range(3)]
        both.add_cost((ends[0] - 2 * ends[1] + ends[2]) / TAU**2, weight)
    still = range(middle + 1, STEPS)
    both.problem.add(Objective(stable(both.tip, 0, both.in_tip(local)), ObjectiveType.EQ, still, order=1))
    for step in still:
        turn = both.rotation(step - 1).T @ both.rotation(step)
        both.equal(both.point(step, local) - both.point(step - 1, local))
        both.equal(casadi.inv_skew((turn - turn.T) / 2))


@pytest.mark.parametrize("name", ["panda", "iiwa"])
@pytest.mark.parametrize(
    "build", [reach_a_point, reach_a_pose, round_a_sphere, round_a_box, with_limited_rates, smooth_in_the_world]
)
def test_two_methods_find_one_optimum(build, name):
    both = Both(name, pose((0.1, -0.2, 0.3), (0.1, 0.0, 0.2, 1.0)))
    build(both)
    rng = np.random.default_rng(0)
    rough = both.problem.solve(both.home, both.home + NOISE * rng.normal(size=(STEPS, both.n)))
    result, path, cost = both.solve(rough.path + NOISE * rng.normal(size=(STEPS, both.n)))
    assert result.cost == pytest.approx(cost, rel=1e-5)
    np.testing.assert_allclose(result.path, path, atol=1e-4)
