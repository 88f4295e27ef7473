"""Trials and their results, as plain data that can be sent to worker processes."""

from dataclasses import asdict, dataclass
from pathlib import Path

DEFAULT_PLANNER = "hmap"
PYBULLET = "pybullet"  # the engine of executions if no other is chosen
PUBLISHED = "published/"  # prefix of the tasks with the published geometry
NOT_VALID = "NOT_VALID"  # code of a result whose plan the judge rejects
DEFAULT_REPLANS = 3  # number of replans that an execution may request


def is_path(task: str) -> bool:
    """Whether a task is given as the path of a task file."""
    return task.endswith((".yaml", ".yml"))


@dataclass(frozen=True)
class Trial:
    """A trial: a task with a seed and limits.

    Attributes:
        task: a name of ``hmap tasks``, or the path of a task file.
        seed: seed of the randomisation and of the planner.
        time_limit: wall-clock time for each plan, s; None: as :func:`hmap_core.planner.plan` without one.
        max_replans: number of replans that the execution may request.
        warm_up: the task that a worker process plans before its first trial, once for each; empty: ``task``.
        engine: the physics engine of the execution.
        perturbation: how far the world is off that executes the plan; empty: not at all.
        sample: seed of the perturbation.
        planner: the method, a name of ``hmap plugins``.
        proposer: proposes contacts before they are sampled, as ``hmap plan --proposer``; empty: the default one.
    """

    task: str
    seed: int
    time_limit: float | None
    max_replans: int
    warm_up: str = ""
    engine: str = PYBULLET
    perturbation: str = ""
    sample: int = 0
    planner: str = DEFAULT_PLANNER
    proposer: str = ""

    @property
    def name(self) -> str:
        """Name of the task without ``published/``, or name of its file without suffix."""
        return Path(self.task).stem if is_path(self.task) else self.task.removeprefix(PUBLISHED)


@dataclass(frozen=True)
class TrialResult:
    """The result of a trial.

    Attributes:
        seed: of the trial.
        valid: the judge accepts the plan.
        solved: the plan is valid and, for a physical task, its execution solved the task.
        reason: why the trial is not solved; empty if it is.
        planning_s: wall-clock time of planning without the judge, s; if planning failed, the time until it did; None if
            planning did not start.
        cpu_s: the same in processor time, including the judge, s.
        executed: the plan was executed.
        replans: number of replans during the execution.
        replan_reasons: the reason of each replan.
        waypoints, contact_tries, mode_switches: of the first plan; None if there is none.
        segments: number of its segments.
        duration_s: its duration, s.
        goal_error: error of the object at the end of the execution, or of the plan if it was not executed.
        code: name of the :class:`hmap_core.exceptions.Code` of that; ``NOT_VALID`` if the judge rejects the plan; empty
            if the trial is solved, or if its process ended.
        claimed: the method returned a plan, whatever the judge says.
        method_s: wall-clock time of the method as a whole, s; also where it looks at its plans with the judge itself.
    """

    seed: int
    valid: bool = False
    solved: bool = False
    reason: str = ""
    planning_s: float | None = None
    cpu_s: float | None = None
    executed: bool = False
    replans: int = 0
    replan_reasons: tuple[str, ...] = ()
    waypoints: int | None = None
    contact_tries: int | None = None
    mode_switches: int | None = None
    segments: int | None = None
    duration_s: float | None = None
    goal_error: dict[str, float] | None = None
    code: str = ""
    claimed: bool = False
    method_s: float | None = None

    def to_dict(self) -> dict:
        """The result as plain JSON types."""
        return asdict(self) | {"replan_reasons": list(self.replan_reasons)}
