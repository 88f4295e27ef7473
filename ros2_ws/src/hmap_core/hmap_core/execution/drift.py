"""How far the world may be off a plan before a new one is needed: pure, so that simulations and robots share it."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hmap_core import transforms

DRIFT_POSITION = 0.010  # m off the plan that a body may be between two contacts
DRIFT_ROTATION = float(np.deg2rad(5.0))  # rad, likewise


@dataclass(frozen=True)
class DriftTolerance:
    """What a body may be off: metres and radians."""

    position: float = DRIFT_POSITION
    rotation: float = DRIFT_ROTATION


def drift_reason(
    planned: Mapping[str, np.ndarray], measured: Mapping[str, np.ndarray], tolerance: DriftTolerance | None = None
) -> str | None:
    """Why what was planned is no longer what is: names the body that is off the most, or None when all are near.

    Args:
        planned: body -> the pose (7,) that the plan has it at.
        measured: body -> the pose (7,) at which it was found; bodies that are only here do not count.
        tolerance: what is allowed; None: the defaults of this module.
    """
    allowed = tolerance or DriftTolerance()
    worst, reason = 1.0, None
    for name, pose in planned.items():
        distance, angle = transforms.distance(pose, measured[name])
        share = max(distance / allowed.position, angle / allowed.rotation)
        if not np.isfinite(share):
            share = np.inf  # a pose that is not a number is as far off as can be
        if share > worst:
            worst = share
            reason = (
                f"'{name}' is {distance * 1e3:.1f} mm and {np.rad2deg(angle):.1f} deg off the plan; "
                f"{allowed.position * 1e3:.1f} mm and {np.rad2deg(allowed.rotation):.1f} deg are allowed"
            )
    return reason
