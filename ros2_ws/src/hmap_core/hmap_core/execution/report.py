"""What came of executing a plan."""

from dataclasses import asdict, dataclass

from hmap_core.exceptions import Code, HmapError
from hmap_core.types import Plan, SegmentKind


@dataclass(frozen=True)
class Deviation:
    """How far a body is from where the plan has it."""

    position_m: float
    rotation_deg: float


@dataclass(frozen=True)
class SegmentDrift:
    """Deviation of a segment's object from the plan at the start and at the end of the segment."""

    segment: int  # index in the plan
    kind: SegmentKind
    robot: str
    object: str
    start: Deviation
    end: Deviation


@dataclass(frozen=True)
class ExecutionReport:
    """Whether an executed plan solved its task, and if not, why.

    Attributes:
        solved: the object ended within the execution tolerance, nothing fell, nothing that should stay moved.
        goal_error: of the goal's object when the execution ended.
        code: SUCCESS, or why not.
        reason: the same in a sentence; empty when solved.
        drift: of each contact segment that was executed, in order.
        fell: bodies that fell or toppled.
        moved: bodies that the plan leaves alone and that moved too far.
        tracking_error_max: rad, the largest deviation of any joint from its commanded position.
        duration: seconds since the execution began, simulated ones in a simulation, with the waits for grippers.
    """

    solved: bool
    goal_error: Deviation
    code: Code
    reason: str
    drift: tuple[SegmentDrift, ...]
    fell: tuple[str, ...]
    moved: tuple[str, ...]
    tracking_error_max: float
    duration: float

    def to_dict(self) -> dict:
        """The report as plain data for JSON."""
        return asdict(self) | {"code": int(self.code)}


@dataclass(frozen=True)
class Replan:
    """One time that a new plan was asked for.

    Attributes:
        time: seconds since the execution began, simulated ones in a simulation.
        reason: why the plan until then could not go on.
        planning_s: seconds of wall-clock time that planning took.
        failure: why there is no new plan; empty when there is one.
    """

    time: float
    reason: str
    planning_s: float
    failure: str = ""


@dataclass(frozen=True)
class ClosedLoopReport:
    """Whether an execution solved its task, with all new plans on the way.

    Attributes:
        last: the report on the plan that was executed last; its verdict and goal error are those of the whole.
        replans: every time that a new plan was asked for, in order.
        plans: what was executed, the first plan first; of all but the last only a part.
        error: why there is no new plan where one was asked for in vain.
    """

    last: ExecutionReport
    replans: tuple[Replan, ...]
    plans: tuple[Plan, ...]
    error: HmapError | None = None

    @property
    def solved(self) -> bool:
        """Whether the task is solved."""
        return self.last.solved

    @property
    def code(self) -> Code:
        """SUCCESS, or why the task is not solved."""
        return self.last.code

    @property
    def reason(self) -> str:
        """Why not solved, and why there was no new plan where one was asked for; empty when solved."""
        if self.solved or not (self.replans and self.replans[-1].failure):
            return self.last.reason
        return f"{self.replans[-1].reason}; no new plan: {self.replans[-1].failure}"

    @property
    def goal_error(self) -> Deviation:
        """How far the object is from its goal."""
        return self.last.goal_error

    def to_dict(self) -> dict:
        """The report as plain data for JSON, without the plans."""
        return self.last.to_dict() | {"reason": self.reason, "replans": [asdict(replan) for replan in self.replans]}
