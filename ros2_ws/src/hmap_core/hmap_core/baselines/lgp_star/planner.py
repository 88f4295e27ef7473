"""One NLP for each move of a given skeleton, through given poses; backtracks to the start where a move fails."""

from dataclasses import dataclass

import numpy as np

from hmap_core.baselines.given_moves import Move, given_moves
from hmap_core.baselines.move_contacts import contacts_of_move
from hmap_core.baselines.restarts import Job, move_by_move, new_job
from hmap_core.baselines.transfers import Transfer, TransferProblem
from hmap_core.exceptions import MotionError
from hmap_core.planner.interfaces import ProgressCallback, SubTrajectory
from hmap_core.planner.protocols import Cancel
from hmap_core.types import Plan, Scene, SceneState

GUESSES = 2  # further first guesses of the path with the same contact
CONTACTS = 6  # of a move that are tried before all begins anew


@dataclass
class LgpStar:
    """Implements :class:`hmap_core.planner.protocols.ManipulationPlanner`.

    Attributes:
        skeletons: path of a file of skeletons; empty: those of the published tasks.
    """

    skeletons: str = ""

    def plan(
        self,
        scene: Scene,
        state: SceneState | None = None,
        seed: int = 0,
        time_limit: float = 60.0,
        progress: ProgressCallback | None = None,
        cancel: Cancel | None = None,
    ) -> Plan:
        """Plan a task; arguments as of :class:`hmap_core.planner.protocols.ManipulationPlanner`.

        Raises:
            InputError: no skeleton is given for the task.
            PlannerError: TIME_LIMIT, no restart was feasible; CANCELED.
        """
        job = new_job("lgp*", scene, state, seed, time_limit, progress, cancel)
        moves = given_moves(job.scene, self.skeletons)
        return job.plan(lambda: move_by_move(job, moves, _one_move))


def _one_move(job: Job, state: SceneState, move: Move) -> list[SubTrajectory] | None:
    """The motions of a move from a state; None where none of several contacts leads to any."""
    T_start = state.poses[move.object]
    poses = np.array([T_start, *move.through, move.T_end])
    for contact in contacts_of_move(job.scene, state, move.robot, move.object, poses, job.rng)[:CONTACTS]:
        job.check_time()
        transfer = Transfer(move.robot, move.object, contact, T_start, move.T_end, move.through, move.slides_on)
        try:
            motions = TransferProblem(job.scene, state, [transfer]).solve(job.rng, GUESSES)
        except MotionError:
            continue
        if motions is not None:
            return motions
    return None
