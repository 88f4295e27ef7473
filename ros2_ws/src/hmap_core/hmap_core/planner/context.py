"""What one planning job carries along: the problem, the parts that solve it, its limits, and what has happened."""

import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from hmap_core.contacts.camera import Cloud
from hmap_core.deadline import cpu_time_used_up, usable
from hmap_core.exceptions import Code, HmapError, PlannerError
from hmap_core.planner.components import PlannerComponents
from hmap_core.planner.interfaces import Progress, ProgressCallback, ToolGrasp
from hmap_core.planner.outcome import Failure
from hmap_core.planner.protocols import Cancel, ContactQuery, ContactSearchQuery
from hmap_core.planner.search_tree import SearchTree
from hmap_core.timed_work import work_until
from hmap_core.types import Scene, SceneState

_MAX_SEED = 2**31 - 1
NOTHING_TRIED = "nothing was tried yet"


@dataclass
class Record:
    """What has happened so far; shared by all contexts of one job.

    Attributes:
        tree: what was tried.
        reason, code: of the last failure.
        earlier: the last reason before a job within the job began.
        error: the last failure itself, if it was an error.
        counts: statistics of the plan.
        contact_searches: how often contacts were searched, with or without success.
        cut_paths: motions along an object's path in which the object itself came too close to another body.
        nothing_fits: object, robots and poses for which no hand alone can make a contact, and the scene of each.
    """

    tree: SearchTree
    reason: str = NOTHING_TRIED
    code: Code = Code.NO_MOTION
    error: HmapError | None = None
    contact_searches: int = 0
    earlier: str = NOTHING_TRIED
    nothing_fits: dict[tuple, Scene] = field(default_factory=dict)
    cut_paths: Counter[tuple[str, bytes]] = field(default_factory=Counter)
    counts: dict[str, int] = field(
        default_factory=lambda: {
            "waypoint_plans": 0,
            "contact_proposals": 0,  # contact searches that found some
            "contacts_checked": 0,  # in these, until the first was feasible
            "learned_contacts": 0,  # feasible contacts that the learned proposer proposed
            "contact_tries": 0,
        }
    )

    def failed(self, error: HmapError) -> None:
        """Remember an error as the last failure."""
        self.reason, self.code, self.error = str(error), error.code, error

    def last_reason(self) -> str:
        """Of the last failure, whichever job within the job it was of."""
        return self.earlier if self.reason == NOTHING_TRIED else self.reason

    def last_failure(self) -> Failure:
        """The last failure as the outcome of a strategy."""
        return Failure.of(self.error or PlannerError(self.reason, self.code))

    def forget(self) -> None:
        """Start anew with the last failure, as a job of its own does."""
        self.earlier = self.last_reason()
        self.reason, self.code, self.error = NOTHING_TRIED, Code.NO_MOTION, None


@dataclass(frozen=True)
class Budget:
    """The limits of a job.

    Attributes:
        began: when it began, ``time.monotonic()``.
        time_limit: seconds.
        cancel: asked between two steps; True stops the job.
    """

    began: float
    time_limit: float
    cancel: Cancel

    @property
    def deadline(self) -> float:
        """When its work has to end, ``time.monotonic()``: a little before the time limit."""
        return self.began + usable(self.time_limit)


@dataclass(frozen=True)
class SearchContext:
    """A planning job as the strategies see it.

    Attributes:
        scene: the scene of the problem; a relaxed problem has fewer bodies.
        start: where everything is at the beginning of the job.
        components: the parts that do the work.
        rng: the only source of randomness.
        budget: time limit and cancel.
        record: what has happened.
        clouds: what cameras measured on each object, in its own frame.
        on_progress: called whenever something new begins.
        start_grasp: the grasp on the tool that a robot holds at the beginning.
    """

    scene: Scene
    start: SceneState
    components: PlannerComponents
    rng: np.random.Generator
    budget: Budget
    record: Record
    clouds: Mapping[str, Cloud]
    on_progress: ProgressCallback
    start_grasp: ToolGrasp | None = None

    def within(self, scene: Scene) -> "SearchContext":
        """The same job in another scene."""
        return self if scene is self.scene else replace(self, scene=scene)

    def using(self, **parts: Any) -> "SearchContext":
        """The same job with some components replaced."""
        return replace(self, components=replace(self.components, **parts))

    def seed(self) -> int:
        """The next seed for a component."""
        return int(self.rng.integers(_MAX_SEED))

    def child_rng(self) -> np.random.Generator:
        """A generator of its own for a component."""
        return np.random.default_rng(self.seed())

    def time_left(self) -> float:
        """Seconds left.

        Raises:
            PlannerError: TIME_LIMIT, there are none; CANCELED.
        """
        if self.budget.cancel():
            raise PlannerError("planning was canceled", Code.CANCELED)
        if cpu_time_used_up():
            allowed = "the processor time that planning has by default; give a time limit for more"
            raise PlannerError(f"no plan within {allowed}; last: {self.record.last_reason()}", Code.TIME_LIMIT)
        left = self.budget.deadline - time.monotonic()
        if left <= 0.0:
            limit = self.budget.time_limit
            raise PlannerError(f"no plan within {limit:g} s; last: {self.record.last_reason()}", Code.TIME_LIMIT)
        return left

    @contextmanager
    def within_time(self) -> Iterator[None]:
        """Run a block whose long steps look at the clock (:mod:`hmap_core.deadline`).

        Raises:
            PlannerError: TIME_LIMIT, with the last failure.
        """
        try:
            with work_until(self.budget.deadline):
                yield
        except PlannerError:
            self.time_left()  # says what failed last
            raise

    def report(self, phase: str, waypoint: int = 0, waypoints: int = 0, attempt: int = 0, text: str = "") -> None:
        """Tell people what begins now. Raises PlannerError as :meth:`time_left`."""
        self.on_progress(Progress(phase, waypoint, waypoints, attempt, text, self.record.tree.root.to_dict))
        self.time_left()

    def contact_search(
        self,
        scene: Scene,
        state: SceneState,
        object: str,
        poses: np.ndarray,
        robots: Iterable[str],
        count: int,
        cloud: Cloud | None = None,
    ) -> ContactSearchQuery:
        """A query for contacts on an object along poses (M, 7), with the next seed and the time that is left."""
        return ContactSearchQuery(
            scene, state, object, poses, tuple(robots), cloud, count, self.seed(), self.time_left()
        )

    def contact_query(
        self, scene: Scene, state: SceneState, object: str, poses: np.ndarray, robot: str, rng: np.random.Generator
    ) -> ContactQuery:
        """A query for one robot's contacts on an object along poses (M, 7)."""
        return ContactQuery(scene, state, object, poses, robot, rng, self.clouds.get(object))
