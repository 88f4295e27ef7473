"""One trial: a task with a seed, and what came of it. Plain data, so that it can be sent to where it is done."""

from dataclasses import asdict, dataclass
from pathlib import Path

PUBLISHED = "published/"  # prefix of the tasks with the published geometry
DEFAULT_REPLANS = 3  # new plans that an execution may ask for


def is_file(task: str) -> bool:
    """Whether a task is given by the path of its file."""
    return task.endswith((".yaml", ".yml"))


@dataclass(frozen=True)
class Trial:
    """What is tried.

    Attributes:
        task: a name of ``hmap tasks``, or the path of a task file.
        seed: of the randomisation and of the planner.
        time_limit: s for each planning.
        max_replans: new plans that the execution may ask for.
    """

    task: str
    seed: int
    time_limit: float
    max_replans: int

    @property
    def name(self) -> str:
        """The task without ``published/``; of a file its name without the suffix."""
        return Path(self.task).stem if is_file(self.task) else self.task.removeprefix(PUBLISHED)


@dataclass(frozen=True)
class TrialResult:
    """What came of a trial.

    Attributes:
        valid: the judge accepts the plan.
        solved: the plan is valid and, where the task is physical, its execution solved the task.
        reason: why it is not solved; empty when it is.
        planning_s: wall-clock seconds until there was a plan, before the judge looked at it; where there was none,
            until the planner gave up; None where it did not come to that.
        cpu_s: the same in seconds of processor time, with the time of the judge.
        executed: the plan was executed.
        replans: new plans that were asked for during the execution.
        replan_reasons: why, for each.
        waypoints, contact_tries, mode_switches: of the first plan; None where there is none.
        segments: its segments.
        duration_s: how long it takes to execute, s.
        goal_error: of the object at the end of the execution, or of the plan where it was not executed.
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

    def to_dict(self) -> dict:
        """Plain data for JSON."""
        return asdict(self) | {"replan_reasons": list(self.replan_reasons)}
