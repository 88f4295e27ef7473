"""What came of executing a plan."""

from dataclasses import asdict, dataclass

from hmap_core.exceptions import Code
from hmap_core.types import SegmentKind


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
        duration: simulated seconds, with the waits for grippers.
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
