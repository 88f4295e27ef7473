"""The direction of a contact's force within its friction cone."""

from __future__ import annotations  # those that name CasADi would load it

from collections.abc import Sequence

import casadi
import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.komo.features.base import Feature
from hmap_core.komo.features.symbolic import FrameSymbols, symbolic_feature


def _beyond(frames: Sequence[FrameSymbols], params: casadi.SX) -> casadi.SX:
    pusher, pushed = frames
    cosine = casadi.dot(pusher.rotation @ params[:3], pushed.rotation @ params[3:6])
    return (1.0 - casadi.sqrt(1.0 + params[6] ** 2) * cosine) / params[6]


def _unit(name: str, vector) -> np.ndarray:
    vector = np.asarray(vector, float)
    length = np.linalg.norm(vector)
    if vector.shape != (3,) or not 0.0 < length < np.inf:
        raise InputError(f"friction_cone: {name} is {vector}; allowed: three numbers, not all zero")
    return vector / length


def friction_cone(frame: int, axis, normal, friction: float, reference: int = 0) -> Feature:
    """How far a force is outside of Coulomb's cone, (1,); not above zero within it.

    With the angle phi between the force and the inward normal and the cone's half-angle alpha = atan(friction), it is
    (cos alpha - cos phi) / sin alpha = (1 - sqrt(1 + friction^2) cos phi) / friction. It is zero on the cone's surface,
    where its slope by phi is 1, so near the surface it is the angle beyond it in radians. It depends on the directions
    by their scalar product alone and so is smooth everywhere, on the axis of the cone too, where the angle itself has
    no derivative. The slope is zero on the axis, deep inside, and for a force straight out of the surface.

    Args:
        frame: frame that pushes; ``axis`` (3,) in it is the direction of its force.
        normal: (3,) of the contact, into what is pushed, in the frame ``reference``.
        friction: Coulomb's coefficient, above 0.

    Raises:
        InputError: a direction without length, or a coefficient that is not above 0.
    """
    if not 0.0 < friction < np.inf:
        raise InputError(f"friction_cone: friction is {friction:g}; allowed: above 0")
    params = np.concatenate([_unit("axis", axis), _unit("normal", normal), [friction]])
    return symbolic_feature("friction_cone", _beyond, (frame, reference), params, "rad")
