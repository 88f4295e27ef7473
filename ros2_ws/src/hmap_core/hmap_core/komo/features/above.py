"""An object above its support: standing on it, upright, and not beyond its edges."""

from __future__ import annotations  # those that name CasADi would load it

from collections.abc import Sequence

import casadi
import numpy as np

from hmap_core.komo.features.base import Feature
from hmap_core.komo.features.symbolic import FrameSymbols, symbolic_feature
from hmap_core.transforms import rotation_numbers


def _bottom(frames: Sequence[FrameSymbols], params: casadi.SX) -> tuple[casadi.SX, casadi.SX]:
    """Middle of the object's bottom and its upward axis, both (3, 1), in the support frame."""
    body, reference = frames
    support = reference.rotation @ casadi.reshape(params[10:19], 3, 3).T
    top = reference.position + reference.rotation @ params[7:10]
    up = body.rotation @ params[3:6]
    bottom = body.position + body.rotation @ params[:3] - params[6] * up
    return support.T @ (bottom - top), support.T @ up


def _standing(frames: Sequence[FrameSymbols], params: casadi.SX) -> casadi.SX:
    bottom, up = _bottom(frames, params)
    return casadi.vertcat(bottom[2], up - casadi.DM([0.0, 0.0, 1.0]))


def _within(frames: Sequence[FrameSymbols], params: casadi.SX) -> casadi.SX:
    bottom, _ = _bottom(frames, params)
    beyond = casadi.vertcat(bottom[:2], -bottom[:2])
    return beyond - casadi.vertcat(params[19:21], params[19:21])


def above(
    frame: int,
    T_frame_object: np.ndarray,
    bottom: float,
    T_reference_support: np.ndarray,
    half_size: Sequence[float] | np.ndarray,
    reference: int = 0,
) -> tuple[Feature, Feature]:
    """The equality and the inequality that keep an object on a support (KOMO's ``above``, with standing upright).

    Args:
        frame: frame that carries the object, at T_frame_object (7,).
        bottom: distance of the object's bottom below its origin, along its own z axis, m.
        T_reference_support: (7,) middle of the support's top, z up, seen from the frame ``reference``.
        half_size: half extents (2,) of the rectangle along the support's x and y in which the middle of the object's
            bottom may lie, m.

    Returns:
        (standing (4,): height of the bottom over the support in m, then the object's z axis less the support's;
        within (4,): how far the middle is beyond the edges +x, +y, -x, -y, in m).
    """
    up = rotation_numbers(T_frame_object)[2::3]
    support = *T_reference_support[:3].tolist(), *rotation_numbers(T_reference_support)
    params = np.array((*T_frame_object[:3].tolist(), *up, bottom, *support, *half_size))
    frames = (frame, reference)
    return (
        symbolic_feature("above: standing", _standing, frames, params, "m, 1", metres=1),
        symbolic_feature("above: within", _within, frames, params, "m"),
    )
