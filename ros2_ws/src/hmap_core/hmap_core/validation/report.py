"""What the judge says: violations, each with its kind, and a few measures of the whole plan."""

from dataclasses import dataclass, field
from enum import StrEnum


class Kind(StrEnum):
    """Names of the violations; ``docs/validation.md`` says for each what is measured, in which unit, and the limit."""

    JOINT_LIMIT = "joint_limit"
    VELOCITY_LIMIT = "velocity_limit"
    ACCELERATION_LIMIT = "acceleration_limit"
    START_MISMATCH = "start_mismatch"
    NOT_AT_REST = "not_at_rest"
    JUMP = "jump"
    PENETRATION = "penetration"
    UNTOUCHED_MOTION = "untouched_motion"
    WRONG_CONTACT_POSE = "wrong_contact_pose"
    SLIP = "slip"
    CONTACT_MISSING = "contact_missing"
    GRASP_NOT_OPPOSED = "grasp_not_opposed"
    UNSUPPORTED = "unsupported"
    NOT_PHYSICAL = "not_physical"
    GRASP_WIDTH = "grasp_width"
    FRICTION_CONE = "friction_cone"
    GOAL_MISSED = "goal_missed"


@dataclass(frozen=True)
class Violation:
    """One broken rule: the worst instance for these bodies.

    ``time`` is in seconds from the start of the plan; ``amount`` and ``limit`` share a unit, which depends on the kind.
    """

    kind: Kind
    bodies: tuple[str, ...]
    time: float
    amount: float
    limit: float

    def to_dict(self) -> dict:
        """Plain JSON types."""
        return {
            "kind": str(self.kind),
            "bodies": list(self.bodies),
            "time": float(self.time),
            "amount": float(self.amount),
            "limit": float(self.limit),
        }


@dataclass(frozen=True)
class Report:
    """The verdict on a plan.

    Attributes:
        valid: whether no rule is broken.
        violations: sorted by time; at most one for each kind and set of bodies, the worst.
        goal_error: ``position_m`` and ``rotation_deg`` of the goal's object at the end.
        min_clearance_m: smallest distance of a pair that may not touch; None when there is no such pair.
    """

    valid: bool
    violations: tuple[Violation, ...]
    goal_error: dict[str, float]
    min_clearance_m: float | None

    def to_dict(self) -> dict:
        """Plain JSON types, with the keys that ``hmap check --json`` prints."""
        return {
            "valid": self.valid,
            "violations": [violation.to_dict() for violation in self.violations],
            "goal_error": dict(self.goal_error),
            "min_clearance_m": self.min_clearance_m,
        }


@dataclass
class Findings:
    """Collects violations and keeps, for each kind and bodies, the worst."""

    _worst: dict[tuple, tuple[float, Violation]] = field(default_factory=dict)

    def add(self, kind: Kind, bodies: tuple[str, ...], time: float, amount: float, limit: float, excess: float) -> None:
        """Note a broken rule; ``excess`` orders instances of the same kind and bodies (larger is worse)."""
        key = (kind, tuple(sorted(bodies)))
        if key not in self._worst or excess > self._worst[key][0]:
            self._worst[key] = (excess, Violation(kind, tuple(bodies), float(time), float(amount), float(limit)))

    def check(self, kind: Kind, bodies: tuple[str, ...], time: float, amount: float, limit: float) -> bool:
        """Note the rule as broken when ``amount`` is above ``limit``; says whether it was."""
        broken = not amount <= limit
        if broken:
            self.add(kind, bodies, time, amount, limit, amount / limit if limit > 0.0 else amount - limit)
        return broken

    def has(self, kind: Kind, bodies: tuple[str, ...]) -> bool:
        """Whether a violation of this kind is already noted for these bodies."""
        return (kind, tuple(sorted(bodies))) in self._worst

    def violations(self) -> tuple[Violation, ...]:
        """All of them, by time, then kind."""
        return tuple(sorted((v for _, v in self._worst.values()), key=lambda v: (v.time, v.kind, v.bodies)))
