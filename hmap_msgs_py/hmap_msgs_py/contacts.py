"""Conversions of contact candidates and of their feasibility."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hmap_msgs.msg import ContactCandidate, ContactFeasibility, ErrorCode
from hmap_msgs_py.checks import ConversionError, field, finite, one_of
from hmap_msgs_py.poses import (
    direction_from_message,
    direction_to_message,
    point_from_message,
    point_to_message,
    pose_from_message,
    pose_to_message,
)

KINDS = (ContactCandidate.TOUCH, ContactCandidate.GRASP, ContactCandidate.PUSH, ContactCandidate.PRESS)


def contact_to_message(
    contact: Any,
    robot: str,
    object_name: str,
    reach: int = 0,
    keyframes: np.ndarray | None = None,
    clear: Sequence[str] = (),
) -> ContactCandidate:
    """Convert a contact of ``robot`` with an object.

    Args:
        contact: has ``kind``, ``T_obj_ee`` (7,), ``point`` (3,), ``normal`` (3,), ``opening``, ``approach`` (3,) and
            ``score``, and a press ``force`` (N).
        robot: name of the robot.
        object_name: name of the object.
        reach: index of the last object pose that the contact reaches.
        keyframes: arm configurations (reach + 1, n) in rad at the object poses.
        clear: other robots that have to move to their home configurations first.

    Raises:
        ConversionError: a value is not allowed.
    """
    return ContactCandidate(
        robot=robot,
        object=object_name,
        kind=one_of("kind of contact", field(contact, "kind"), KINDS),
        pose=pose_to_message(field(contact, "T_obj_ee"), "contact pose"),
        point=point_to_message(field(contact, "point"), "contact point"),
        normal=direction_to_message(field(contact, "normal"), "contact normal"),
        opening=float(finite("opening", field(contact, "opening"), ())),
        approach=direction_to_message(field(contact, "approach"), "approach"),
        score=float(finite("score", field(contact, "score"), ())),
        force=float(finite("force", field(contact, "force", 0.0), ())),
        reach=reach,
        keyframes=_flat(keyframes),
        clear=list(clear),
    )


def contact_from_message(message: ContactCandidate) -> dict:
    """Convert to ``{kind, T_obj_ee, point, normal, opening, approach, score}``, and ``force`` of a press, without the
    other fields of the message.

    Raises:
        ConversionError: a value is not allowed.
    """
    fields: dict[str, Any] = {
        "kind": one_of("kind of contact", message.kind, KINDS),
        "T_obj_ee": pose_from_message(message.pose, "contact pose"),
        "point": point_from_message(message.point, "contact point"),
        "normal": direction_from_message(message.normal, "contact normal"),
        "opening": float(finite("opening", message.opening, ())),
        "approach": direction_from_message(message.approach, "approach"),
        "score": float(finite("score", message.score, ())),
    }
    if message.kind == ContactCandidate.PRESS:
        fields["force"] = float(finite("force", message.force, ()))
    return fields


def feasibility_to_message(
    keyframes: np.ndarray | None, error: ErrorCode | None = None, clear: Sequence[str] = ()
) -> ContactFeasibility:
    """Convert the result of a feasibility check.

    Args:
        keyframes: arm configurations (P, n) in rad that keep the contact at the first P object poses; None: the contact
            is infeasible.
        error: the reason if it is infeasible.
        clear: other robots that have to move to their home configurations first.

    Raises:
        ConversionError: the configurations are not finite.
    """
    if keyframes is None:
        return ContactFeasibility(feasible=False, error=error or ErrorCode(code=ErrorCode.NO_CONTACT, stage="contacts"))
    reach = len(keyframes) - 1
    return ContactFeasibility(feasible=True, reach=reach, keyframes=_flat(keyframes), clear=list(clear))


def keyframes_from_message(message: ContactCandidate | ContactFeasibility, joints: int) -> np.ndarray:
    """Convert to arm configurations (P, joints) in rad; P is 0 if the message has none.

    Raises:
        ConversionError: the number of values is no multiple of ``joints``, or a value is not finite.
    """
    if len(message.keyframes) % joints:
        raise ConversionError(f"keyframes has {len(message.keyframes)} values; it must have rows of {joints}")
    return finite("keyframes", message.keyframes).reshape(-1, joints)


def _flat(keyframes: np.ndarray | None) -> list[float]:
    return [] if keyframes is None else finite("keyframes", keyframes, (None, None)).ravel().tolist()
