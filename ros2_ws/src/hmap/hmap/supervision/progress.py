"""Whether a robot does what its controller was told to: what is measured, compared with the command."""

import time

import numpy as np

from hmap_core.types import JointTrajectory, Robot, SceneState

STANDS = 2e-3  # rad that a joint may change while it counts as standing
FINGERS_STAND = 5e-4  # m, the same of the opening of a gripper
BEHIND = 0.05  # rad that a joint is off its trajectory where it does not follow it


class Progress:
    """The progress of one command; times are stamps of measured states, so that states may come late.

    Args:
        robot: that was told to move.
        limit: s of standing after which something is wrong.
        motion: of the arm; None: its gripper was told to move.
        start: stamp (s) from which the times of the motion count; None: the command's acceptance.
    """

    def __init__(self, robot: Robot, limit: float, motion: JointTrajectory | None = None, start: float | None = None):
        self._robot, self._limit, self._motion, self._began = robot, limit, motion, start
        self._last: np.ndarray | None = None  # where it stood when it moved last
        self._moved = self._moved_at = 0.0  # when: s of stamps, and of the steady clock

    def problem(self, stamp: float, state: SceneState) -> str:
        """Why a command that was accepted and has not ended is not followed; empty where it is.

        Args:
            stamp: s, of the state.
            state: as measured.
        """
        name = self._robot.name
        now = np.array([state.gripper[name]]) if self._motion is None else state.q[name]
        steady = time.monotonic()
        if self._began is None:
            self._began = stamp
        moved = self._last is None or np.abs(now - self._last).max() > (
            FINGERS_STAND if self._motion is None else STANDS
        )
        if moved:
            self._last, self._moved, self._moved_at = now, stamp, steady
        standing = min(stamp - self._moved, steady - self._moved_at)
        if standing <= self._limit:
            return ""
        if self._motion is None:
            return f"it does not end: its fingers have stood {now[0]:.4f} m apart for {standing:.1f} s"
        return self._of_arm(now, stamp - self._began, standing, self._motion)

    def _of_arm(self, q: np.ndarray, at: float, standing: float, motion: JointTrajectory) -> str:
        """The problem of an arm that stands at q (n,), at a time (s) of its motion."""
        wanted = sampled(motion, at)
        off, before = np.abs(wanted - q), np.abs(sampled(motion, at - self._limit) - q)
        late = np.minimum(off, before)  # a motion may rest itself
        if late.max() > BEHIND:
            i = int(late.argmax())
            return (
                f"it does not move: {motion.names[i]} has stood at {q[i]:.4f} rad for {standing:.1f} s, "
                f"and the trajectory wants it at {wanted[i]:.4f}"
            )
        if at > float(motion.times[-1]) + self._limit:
            return f"it does not end: it has stood for {standing:.1f} s where the trajectory is over"
        return ""


def sampled(motion: JointTrajectory, at: float) -> np.ndarray:
    """The positions (n,) of a motion at a time (s), those of its ends beyond them."""
    return np.array([np.interp(at, motion.times, column) for column in np.asarray(motion.positions).T])


def start_problem(robot: Robot, motion: JointTrajectory, state: SceneState, allowed: float) -> str:
    """Why a motion does not begin where an arm stands, by joint and value; empty where it does.

    Args:
        robot: whose arm.
        motion: that is about to be sent.
        state: as measured.
        allowed: rad that a joint may be off.
    """
    q, first = state.q[robot.name], np.asarray(motion.positions)[0]
    off = np.abs(q - first)
    if off.max() <= allowed:
        return ""
    i = int(off.argmax())
    return (
        f"the trajectory of '{robot.name}' is not sent: it starts with {motion.names[i]} at {first[i]:.4f} rad, "
        f"which is measured at {q[i]:.4f}; at most {allowed:g} rad apart are allowed"
    )
