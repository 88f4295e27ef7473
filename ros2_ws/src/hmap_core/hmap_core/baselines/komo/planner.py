"""One NLP over the whole task with the skeleton given, restarted until the time is up."""

from dataclasses import dataclass, replace

import numpy as np

from hmap_core.baselines.given_moves import Move, given_moves
from hmap_core.baselines.komo.places import Places
from hmap_core.baselines.move_contacts import contacts_of_move
from hmap_core.baselines.restarts import Job, new_job
from hmap_core.baselines.transfers import NOT_ON_THE_WAY, Transfer, TransferProblem
from hmap_core.planner.interfaces import ProgressCallback, SubTrajectory
from hmap_core.planner.protocols import Cancel
from hmap_core.types import ContactPoint, Plan, Scene, SceneState

GUESSES = 2  # further first guesses of the path with the same contacts
USES = 8  # restarts for which the contacts of a move are used before others are sampled


@dataclass
class Komo:
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
        job = new_job("komo", scene, state, seed, time_limit, progress, cancel)
        return job.plan(_Attempts(job, given_moves(job.scene, self.skeletons)).next)


class _Attempts:
    """The restarts: each draws contacts, and places of release where the skeleton leaves them open."""

    def __init__(self, job: Job, moves: list[Move]):
        self._job, self._moves, self._uses = job, moves, 0
        self._pools: list[tuple[Move, np.ndarray, np.ndarray, list[ContactPoint]]] = []

    def next(self) -> list[SubTrajectory] | None:
        """One restart; its motions, or None."""
        if self._uses % USES == 0:
            self._pools = self._sampled()
        self._uses += 1
        if not self._pools:
            self._uses = 0
            return None
        rng = self._job.rng
        transfers = [
            Transfer(
                move.robot, move.object, pool[rng.integers(len(pool))], T_start, T_end, NOT_ON_THE_WAY, move.slides_on
            )
            for move, T_start, T_end, pool in self._pools
        ]
        return TransferProblem(self._job.scene, self._job.start, transfers).solve(rng, GUESSES)

    def _sampled(self) -> list[tuple[Move, np.ndarray, np.ndarray, list[ContactPoint]]]:
        """Each move with where its object is before and after it, and contacts; empty where one has no contacts."""
        job, state, found = self._job, self._job.start.copy(), []
        for move in self._moves:
            job.check_time()
            T_start = state.poses[move.object]
            T_end = move.T_end
            if move.intermediate:
                goal = replace(job.scene.goal, object=move.object)
                drawn = Places(job.scene, state, goal).draw(job.rng)
                if drawn is None:
                    return []
                T_end = drawn
            pool = contacts_of_move(job.scene, state, move.robot, move.object, np.array([T_start, T_end]), job.rng)
            if not pool:
                return []
            found.append((move, T_start, T_end, pool))
            state.poses[move.object] = T_end
        return found
