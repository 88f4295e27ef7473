"""Tools that are held a little otherwise than planned: the hand moves so that the tool itself follows the plan.

Fingers that close on a tool move and tilt it by up to some millimetres and degrees. A look after it was picked, and
between two of its contacts, tells by how much; the arm's motions are corrected by that until it is placed.
"""

import numpy as np

from hmap_core import transforms
from hmap_core.execution.drift import DriftTolerance
from hmap_core.kinematics.arm import Arm, load_arm
from hmap_core.types import JointTrajectory, Plan, Robot, SceneState

LEAST = DriftTolerance(0.0005, float(np.deg2rad(0.25)))  # of a tool in the fingers; less is not corrected
MOST = DriftTolerance(0.004, float(np.deg2rad(3.0)))  # beyond, the hand does not keep it
BLENDED = 0.6  # share of a motion in which a new correction comes in; a contact is made at its end
ITERATIONS = 3  # of inverse kinematics at each sample, from the planned configuration
DAMPING = 0.03  # of its least squares, m or rad per rad: singular arms do not turn far for a millimetre
SHORTEST = 1e-9  # s
IDENTITY = transforms.IDENTITY


class ToolOffsets:
    """By how much the hands of robots have to be off a plan, so that their tools are not.

    Args:
        plan: that is followed.
    """

    def __init__(self, plan: Plan):
        self._plan = plan
        self._at: dict[str, np.ndarray] = {}  # robot -> what its last motion ended with
        self._next: dict[str, np.ndarray] = {}  # robot -> what its next motions end with

    def look(self, robot: str, tool: str, sample: int, state: SceneState) -> None:
        """See how a tool is held.

        Args:
            robot, tool: names.
            sample: of the plan, up to which it was followed.
            state: measured at rest.
        """
        if tool not in state.poses or robot not in state.q:
            return
        planned_q = self._plan.trajectory.joints[robot][sample]
        planned = self._held(robot, planned_q, self._plan.trajectory.objects[tool][sample])
        found = self._held(robot, state.q[robot], state.poses[tool])
        distance, angle = transforms.distance(planned, found)
        if not (distance <= MOST.position and angle <= MOST.rotation):  # nor if it is not a number
            return
        if distance < LEAST.position and angle < LEAST.rotation:
            self._next.pop(robot, None)
        else:
            self._next[robot] = transforms.multiply(planned, transforms.inverse(found))

    def corrected(self, robot: str, motion: JointTrajectory, holds: bool) -> JointTrajectory:
        """A motion with which the tool follows the plan; once nothing is held, the hand returns to the plan.

        Args:
            robot: name.
            motion: as planned.
            holds: whether the robot holds something throughout.
        """
        if not holds:
            self._next.pop(robot, None)
        before, after = self._at.pop(robot, IDENTITY), self._next.get(robot, IDENTITY)
        if before is IDENTITY and after is IDENTITY:
            return motion
        if after is not IDENTITY:
            self._at[robot] = after
        return _shifted(self._plan.scene.robots[robot], motion, before, after)

    def _held(self, robot: str, q: np.ndarray, T_world_tool: np.ndarray) -> np.ndarray:
        placed = self._plan.scene.robots[robot]
        T_world_ee = transforms.multiply(placed.base_pose, load_arm(placed.model).end_effector(q))
        return transforms.multiply(transforms.inverse(T_world_ee), T_world_tool)


def blend(u: np.ndarray) -> np.ndarray:
    """From 0 at times u <= 0 to 1 at u >= 1, without jumps of velocity and acceleration."""
    u = np.clip(u, 0.0, 1.0)
    return np.clip(u**3 * (10.0 - 15.0 * u + 6.0 * u**2), 0.0, 1.0)  # rounding makes it more than 1


def _shifted(robot: Robot, motion: JointTrajectory, before: np.ndarray, after: np.ndarray) -> JointTrajectory:
    """A motion with the hand displaced in its own frame: by ``before`` (7,) at first, by ``after`` (7,) at the end."""
    arm, times = load_arm(robot.model), np.asarray(motion.times)
    T_ee_tip = transforms.inverse(transforms.from_matrix(arm.T_tip_ee))
    planned, (lower, upper) = np.asarray(motion.positions), robot.model.position_limits
    positions = planned.copy()
    for k, share in enumerate(blend((times - times[0]) / (BLENDED * max(float(times[-1] - times[0]), SHORTEST)))):
        T = transforms.multiply(arm.end_effector(planned[k]), transforms.interpolate(before, after, float(share)))
        positions[k] = np.clip(_reached(arm, transforms.multiply(T, T_ee_tip), planned[k]), lower, upper)
    velocities = np.gradient(positions, times, axis=0)
    velocities[0] = velocities[-1] = 0.0
    return JointTrajectory(motion.names, motion.times, positions, velocities, motion.efforts)


def _reached(arm: Arm, target: np.ndarray, q: np.ndarray) -> np.ndarray:
    """The configuration (n,) near q with the last frame at a pose (7,), base frame; by damped Gauss-Newton steps."""
    R_target = transforms.rotation_matrix(target)
    for _ in range(ITERATIONS):
        R, p = arm.frames(q)
        turn = R_target @ R[-1].T
        angle = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
        J = arm.jacobian(q)
        q = q + J.T @ np.linalg.solve(J @ J.T + DAMPING**2 * np.eye(6), np.r_[target[:3] - p[-1], angle])
    return q
