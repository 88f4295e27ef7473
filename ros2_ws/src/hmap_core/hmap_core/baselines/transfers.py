"""Transfers with chosen contacts as one optimisation problem, and its path as the motions of a plan.

A transfer is one move with one contact: transit, straight approach, hold, straight retreat. The problem of several of
them is one NLP over the whole path (KOMO; Toussaint, A tutorial on Newton methods for constrained trajectory
optimization, 2017), in the modes of their skeleton. The paths of the objects are left to it, but for the poses given.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from hmap_core.komo.features import joint_position
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.segment import APPROACH_STEPS, Phase, approach_entry, contact_entries, retreat_entry
from hmap_core.komo.skeleton import Skeleton, SkeletonEntry, Symbol
from hmap_core.komo.skeleton_problem import SkeletonProblem
from hmap_core.komo.workspace import Workspace
from hmap_core.planner.interfaces import RobotContact, SubTrajectory
from hmap_core.planner.segments.contact_segment import ContactSegment
from hmap_core.planner.segments.motion_sequence import MotionSequence
from hmap_core.planner.segments.transits import path_options
from hmap_core.transforms import interpolate
from hmap_core.types import ContactPoint, Scene, SceneState

TRANSIT_STEPS = 12  # of the motion to the pre-contact pose
HOLD_STEPS = 16  # of the motion with the object, at least, where no pose is given on its way
LEG_STEPS = 8  # of the motion between two given poses
COARSE_STEPS = 20  # of each transfer, at which collisions are looked at first
NOT_ON_THE_WAY = np.zeros((0, 7))  # poses through which an object that moves freely has to go
ITERATIONS, OUTER = 500, 40  # Newton steps and multiplier updates at most; paths through narrow passages take many


@dataclass(frozen=True)
class Transfer:
    """A move with a contact.

    Attributes:
        robot, object: names.
        contact: of the robot with the object.
        T_start, T_end: (7,) of the object, world frame.
        through: (m, 7) poses of the object on the way.
        slides_on: the body on which the object stays; None: it may be lifted.
    """

    robot: str
    object: str
    contact: ContactPoint
    T_start: np.ndarray
    T_end: np.ndarray
    through: np.ndarray
    slides_on: str | None = None

    @property
    def legs(self) -> int:
        """Number of phases of the hold: one more than the poses on the way."""
        return len(self.through) + 1

    @property
    def hold(self) -> tuple[int, ...]:
        """Steps of each phase of the hold."""
        return (max(LEG_STEPS, HOLD_STEPS // self.legs),) * self.legs

    @property
    def steps(self) -> tuple[int, ...]:
        """Steps of each phase."""
        return (TRANSIT_STEPS, APPROACH_STEPS, *self.hold, APPROACH_STEPS)

    def skeleton(self, straight: bool = False) -> Skeleton:
        """The modes, and the poses that are given.

        Args:
            straight: the object goes straight from one pose to the next, too.
        """
        first = Phase.APPROACH.end
        last = first + self.legs
        entries = [
            approach_entry(self.robot, self.contact, self.T_start),
            *contact_entries(self.robot, self.object, self.contact, first, last),
        ]
        if self.slides_on is not None:
            entries.append(SkeletonEntry(first, last, Symbol.ABOVE, (self.object, self.slides_on)))
        poses = [*self.through, self.T_end]
        if straight:
            ends = zip([self.T_start, *poses], poses, self.hold, strict=False)
            line = [interpolate(a, b, shares(steps)) for a, b, steps in ends]
            entries.append(SkeletonEntry(first, last, Symbol.POSE_EQ, (self.object,), np.concatenate(line)))
        else:
            at = range(first + 1, last + 1)
            entries += [SkeletonEntry(t, t, Symbol.POSE_EQ, (self.object,), T) for t, T in zip(at, poses, strict=True)]
        leaving, later = retreat_entry(self.robot, self.contact, self.T_end), self.legs - 1
        entries.append(replace(leaving, phase0=leaving.phase0 + later, phase1=leaving.phase1 + later))
        return Skeleton(entries)


def shares(steps: int) -> np.ndarray:
    """Even shares (steps,) of a way, the last one 1."""
    return np.arange(1, steps + 1) / steps


class TransferProblem:
    """One problem over transfers that follow each other.

    Args:
        scene, state: the world, and where everything is before them.
        transfers: in their order. A robot stands still while another one moves.
    """

    def __init__(self, scene: Scene, state: SceneState, transfers: Sequence[Transfer]):
        self.scene, self.state, self.transfers = scene, state, tuple(transfers)
        self.robots = tuple(dict.fromkeys(transfer.robot for transfer in transfers))
        self.workspace = Workspace(scene, state, self.robots)
        self.problem = self._problem(straight=False)

    def _problem(self, straight: bool) -> SkeletonProblem:
        """The problem; with objects that go straight, it is that of a first guess."""
        first, *others = (transfer.skeleton(straight) for transfer in self.transfers)
        skeleton = reduce(Skeleton.then, others, first)
        steps = [count for transfer in self.transfers for count in transfer.steps]
        longest = max(sum(transfer.steps) for transfer in self.transfers)
        options = replace(
            path_options(longest), coarse=COARSE_STEPS * len(self.transfers), iterations=ITERATIONS, outer=OUTER
        )
        problem = SkeletonProblem(skeleton, self.workspace, steps, options)
        self._keep_idle_robots_still(problem)
        return problem

    def guess(self, rng: np.random.Generator) -> np.ndarray:
        """A first guess (T, n): the objects go straight from one pose to the next, whatever stands there."""
        return self._problem(straight=True).solve(self.workspace.start, rng=rng).path

    def solve(self, rng: np.random.Generator, restarts: int) -> list[SubTrajectory] | None:
        """Solve it; None where the solver finds no feasible path.

        Args:
            rng: the only source of randomness.
            restarts: further first guesses, with random bumps.

        Raises:
            MotionError: the path found cannot be timed within the joint limits.
        """
        result = self.problem.solve(self.workspace.start, self.guess(rng), restarts, rng)
        return self.motions(result.path) if result.feasible else None

    def motions(self, path: np.ndarray) -> list[SubTrajectory]:
        """The motions along a path (T, n), one after the other."""
        path = np.concatenate([self.workspace.start[None], path])
        sequence, found, first = MotionSequence(self.state), [], 0
        for transfer in self.transfers:
            columns = self.workspace.model.joints(transfer.robot)
            contact = first + TRANSIT_STEPS + APPROACH_STEPS
            end = first + sum(transfer.steps[:-1])
            last = end + APPROACH_STEPS
            ends = np.array([transfer.T_start, transfer.T_end])
            held = RobotContact(transfer.robot, transfer.contact, 1, path[[contact, end]][:, columns])
            segment = ContactSegment(self.scene, sequence.state, transfer.object, held, ends)
            parts = path[first : contact + 1], path[contact : end + 1], path[end : last + 1]
            for motion in segment.trajectories(*(part[:, columns] for part in parts)):
                if len(motion.trajectory.time) > 1:
                    sequence.add(motion)
                    found.append(motion)
            first = last
        return found

    def _keep_idle_robots_still(self, problem: SkeletonProblem) -> None:
        """The joints of a robot do not change while another one moves."""
        first = 0
        for transfer in self.transfers:
            steps = range(first, first + sum(transfer.steps))
            for name in self.robots:
                if name != transfer.robot:
                    joints = self.workspace.model.joints(name)
                    feature = joint_position(np.zeros(joints.stop - joints.start), joints.start)
                    problem.add(Objective(feature, ObjectiveType.EQ, steps, order=1))
            first = steps.stop
