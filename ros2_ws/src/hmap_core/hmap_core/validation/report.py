"""The verdict of the judge: violations with their kinds, and measures of the whole plan."""

from dataclasses import dataclass, field
from enum import StrEnum


class Kind(StrEnum):
    """Kinds of violations. ``docs/validation.md`` gives the measured quantity, unit and limit of each."""

    JOINT_LIMIT = "joint_limit"
    VELOCITY_LIMIT = "velocity_limit"
    ACCELERATION_LIMIT = "acceleration_limit"
    START_MISMATCH = "start_mismatch"
    NOT_AT_REST = "not_at_rest"
    JUMP = "jump"
    PENETRATION = "penetration"
    HEAD_ON = "head_on"
    UNTOUCHED_MOTION = "untouched_motion"
    WRONG_CONTACT_POSE = "wrong_contact_pose"
    SLIP = "slip"
    TORN_GRASP = "torn_grasp"
    CONTACT_MISSING = "contact_missing"
    GRASP_NOT_OPPOSED = "grasp_not_opposed"
    GRASP_AT_EDGE = "grasp_at_edge"
    GRASP_TURNS = "grasp_turns"
    PUSH_NOT_ONE_SIDED = "push_not_one_sided"
    PUSH_TOPPLES = "push_topples"
    NOT_REMOVABLE = "not_removable"
    UNSUPPORTED = "unsupported"
    NOT_PHYSICAL = "not_physical"
    GRASP_WIDTH = "grasp_width"
    FRICTION_CONE = "friction_cone"
    GRIP_FORCE = "grip_force"
    PRESS_DIRECTION = "press_direction"
    PRESS_FRICTION = "press_friction"
    PRESS_LIFTED = "press_lifted"
    PAYLOAD = "payload"
    GOAL_MISSED = "goal_missed"


@dataclass(frozen=True)
class Violation:
    """A violated rule: the worst instance for a set of bodies.

    Attributes:
        kind: the rule.
        bodies: names of the bodies, links or joints involved.
        time: s from the start of the plan.
        amount, limit: measured value and its limit; their unit depends on the kind.
    """

    kind: Kind
    bodies: tuple[str, ...]
    time: float
    amount: float
    limit: float

    def to_dict(self) -> dict:
        """The violation as plain JSON types."""
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
        valid: whether no rule is violated.
        violations: sorted by time; for each kind and set of bodies only the worst.
        goal_error: ``position_m`` and ``rotation_deg`` of the goal's object at the end.
        min_clearance_m: smallest distance of a pair that does not touch by design; None if there is no such pair.
        min_held_clearance_m: the same of a body that a contact moves and another body; None if there is no such pair
            that comes nearer than half a metre.
    """

    valid: bool
    violations: tuple[Violation, ...]
    goal_error: dict[str, float]
    min_clearance_m: float | None
    min_held_clearance_m: float | None

    def to_dict(self) -> dict:
        """The report as plain JSON types, with the keys that ``hmap check --json`` prints."""
        return {
            "valid": self.valid,
            "violations": [violation.to_dict() for violation in self.violations],
            "goal_error": dict(self.goal_error),
            "min_clearance_m": self.min_clearance_m,
            "min_held_clearance_m": self.min_held_clearance_m,
        }


@dataclass
class Findings:
    """Collects violations; keeps the worst for each kind and set of bodies."""

    _worst: dict[tuple, tuple[float, Violation]] = field(default_factory=dict)

    def add(self, kind: Kind, bodies: tuple[str, ...], time: float, amount: float, limit: float, excess: float) -> None:
        """Records a violation.

        Args:
            kind: the rule.
            bodies: names of the bodies, links or joints involved.
            time: s.
            amount, limit: measured value and its limit.
            excess: severity, to compare instances of the same kind and bodies; larger is worse.
        """
        key = (kind, tuple(sorted(bodies)))
        if key not in self._worst or excess > self._worst[key][0]:
            self._worst[key] = (excess, Violation(kind, tuple(bodies), float(time), float(amount), float(limit)))

    def check(self, kind: Kind, bodies: tuple[str, ...], time: float, amount: float, limit: float) -> bool:
        """Records a violation if ``amount`` exceeds ``limit``.

        Returns:
            Whether the rule is violated.
        """
        broken = not amount <= limit
        if broken:
            self.add(kind, bodies, time, amount, limit, amount / limit if limit > 0.0 else amount - limit)
        return broken

    def has(self, kind: Kind, bodies: tuple[str, ...]) -> bool:
        """Whether a violation of this kind is already recorded for these bodies."""
        return (kind, tuple(sorted(bodies))) in self._worst

    def violations(self) -> tuple[Violation, ...]:
        """All violations, sorted by time, then kind."""
        return tuple(sorted((v for _, v in self._worst.values()), key=lambda v: (v.time, v.kind, v.bodies)))
