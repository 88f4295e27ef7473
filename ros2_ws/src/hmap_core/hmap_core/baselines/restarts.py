"""Restarts of a method until the judge accepts a plan, or until the time is up."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from hmap_core.baselines.given_moves import Move
from hmap_core.exceptions import Code, MotionError, PlannerError
from hmap_core.plan_file import to_dict
from hmap_core.planner.assembly import assemble, scene_at
from hmap_core.planner.interfaces import Progress, ProgressCallback, SubTrajectory
from hmap_core.planner.protocols import Cancel
from hmap_core.planner.segments.motion_sequence import MotionSequence
from hmap_core.types import Plan, Scene, SceneState, SegmentKind
from hmap_core.validation import check


@dataclass
class Job:
    """One call of a method that restarts.

    Attributes:
        name: of the method, for people.
        scene: the task, with everything where the job starts.
        start: where everything is.
        rng: the only source of randomness.
        deadline: ``time.monotonic()`` after which nothing new is begun.
        counts: ``restarts``, and ``claims``: the plans that the method itself took for solutions.
        failure: why the last restart that raised an error had no motions.
    """

    name: str
    scene: Scene
    start: SceneState
    rng: np.random.Generator
    deadline: float
    progress: ProgressCallback
    cancel: Cancel
    began: float
    counts: dict[str, int] = field(default_factory=lambda: {"restarts": 0, "claims": 0})
    failure: str = ""

    def check_time(self) -> None:
        """Raise PlannerError, CANCELED or TIME_LIMIT, if the job has to end."""
        if self.cancel():
            raise PlannerError("canceled", Code.CANCELED)
        if time.monotonic() > self.deadline:
            why = f"; last: {self.failure}" if self.failure else ""
            raise PlannerError(f"{self.name} found no plan in time, in {self.counts['restarts']} restarts{why}")

    def plan(self, attempt: Callable[[], list[SubTrajectory] | None]) -> Plan:
        """Restart until the judge accepts a plan.

        Args:
            attempt: one try; its motions, or None.

        Returns:
            The accepted plan. When the time is up, the last one that the method claimed; the judge rejects it.

        Raises:
            PlannerError: TIME_LIMIT, and no plan was claimed; CANCELED.
        """
        claimed: Plan | None = None
        while True:
            try:
                self.check_time()
                self.progress(Progress("motion", text=f"{self.name}, restart {self.counts['restarts']}"))
                motions = self._tried(attempt)
            except PlannerError as error:
                if claimed is None or error.code is not Code.TIME_LIMIT:
                    raise
                return claimed
            if motions is None:
                continue
            claimed = self._claimed(motions)
            if check(to_dict(claimed)).valid:
                return claimed

    def _tried(self, attempt: Callable[[], list[SubTrajectory] | None]) -> list[SubTrajectory] | None:
        self.counts["restarts"] += 1
        try:
            return attempt()
        except MotionError as error:
            self.failure = error.reason
            return None

    def _claimed(self, motions: list[SubTrajectory]) -> Plan:
        self.counts["claims"] += 1
        kinds = [segment.kind for motion in motions for segment in motion.segments]
        stats = {
            "planning_time_s": time.monotonic() - self.began,
            "waypoints": 0,
            "contacts": sum(kind != SegmentKind.TRANSIT for kind in kinds),
            "mode_switches": max(0, len(kinds) - 1),
            **self.counts,
        }
        return assemble(self.scene, self.start, motions, self.scene.goal.pose[None], stats)


def new_job(
    name: str,
    scene: Scene,
    state: SceneState | None,
    seed: int,
    time_limit: float,
    progress: ProgressCallback | None,
    cancel: Cancel | None,
) -> Job:
    """A job with the arguments of :meth:`hmap_core.planner.protocols.ManipulationPlanner.plan`."""
    began = time.monotonic()
    start = scene.start_state() if state is None else state.copy()
    return Job(
        name,
        scene if state is None else scene_at(scene, state),
        start,
        np.random.default_rng(seed),
        began + time_limit,
        progress or (lambda progress: None),
        cancel or (lambda: False),
        began,
    )


def move_by_move(
    job: Job, moves: Sequence[Move], one_move: Callable[[Job, SceneState, Move], list[SubTrajectory] | None]
) -> list[SubTrajectory] | None:
    """The motions of moves one after the other; None where one fails.

    Args:
        job: the job.
        moves: in their order.
        one_move: the motions of a move from a state, or None.
    """
    sequence, found = MotionSequence(job.start), list[SubTrajectory]()
    for move in moves:
        motions = one_move(job, sequence.state, move)
        if motions is None:
            return None
        for motion in motions:
            sequence.add(motion)
        found += motions
    return found
