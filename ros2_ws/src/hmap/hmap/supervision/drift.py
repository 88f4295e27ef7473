"""Whether what was moved is so far off its plan that the rest of the plan is of no use."""

import numpy as np

from hmap_core import transforms
from hmap_core.types import BodyKind, Plan, SceneState

DRIFT_POSITION, DRIFT_ANGLE = 0.01, np.deg2rad(5.0)  # m, rad off the plan that the contacts to come make up for


def drifted(plan: Plan, sample: int, state: SceneState) -> str | None:
    """The sentence that says which body is how far off the plan at a sample; None where all are near enough."""
    for name, body in plan.scene.bodies.items():
        if body.kind is BodyKind.FIXED or name not in state.poses:
            continue
        distance, angle = transforms.distance(plan.trajectory.objects[name][sample], state.poses[name])
        if distance > DRIFT_POSITION or angle > DRIFT_ANGLE:
            return (
                f"{name!r} is {distance * 1e3:.1f} mm and {np.rad2deg(angle):.1f} deg off the plan at "
                f"{plan.trajectory.time[sample]:.2f} s; {DRIFT_POSITION * 1e3:g} mm and "
                f"{np.rad2deg(DRIFT_ANGLE):g} deg are allowed between two contacts"
            )
    return None
