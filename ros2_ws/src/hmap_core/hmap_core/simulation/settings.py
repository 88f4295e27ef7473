"""Numbers of the simulation, with their units.

Measured with Pandas dragging, pushing and lifting objects of 0.2-0.6 kg with friction 0.4-0.8: see docs/execution.md.
"""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from hmap_core.exceptions import InputError

TIME_STEP = 1.0 / 240.0  # s
SOLVER_ITERATIONS = 200  # with 100, pushed or lifted bodies creep by millimetres
RENEWAL = float(np.deg2rad(3.0))  # rad that a hand turns before the contacts of its fingers are found anew
GRAVITY = 9.81  # m/s^2, downwards


@dataclass(frozen=True)
class RobotSettings:
    """How a robot is simulated; a robot model's ``simulation`` table overrides any of these by name."""

    position_gain: float = 0.1  # share of the position error removed per step
    velocity_gain: float = 1.0  # share of the velocity error removed per step
    joint_forces: tuple[float, ...] | None = None  # N m per arm joint; None: the efforts in the URDF
    finger_friction: float = 1.0
    finger_spinning_friction: float = 0.005  # m; larger values act like glue
    finger_rolling_friction: float = 0.0  # m
    finger_stiffness: float = 3e5  # N/m; softer fingers sink in
    finger_damping: float = 3e3  # N s/m
    finger_speed: float = 0.1  # m/s, of each finger
    finger_gear_force: float = 50.0  # N or N m, that keeps fingers symmetric, and linkages as their mimic joints say
    finger_gear_erp: float = 0.1  # share of what they are off removed per step
    linkage_inertia: float = 1e-3  # kg m^2, least of a link in a linkage, as if of its motor; lighter ones give way
    finger_force: float = 40.0  # N, of a gripper command that names none

    @classmethod
    def of(cls, model_name: str, table: dict) -> "RobotSettings":
        """The defaults with the entries of ``table``.

        Raises:
            InputError: a key is unknown, or a value is not a number (``joint_forces``: numbers).
        """
        known = [f.name for f in fields(cls)]
        for key in table:
            if key not in known:
                raise InputError(f"robot model {model_name}: unknown simulation setting '{key}'; known are {known}")
        try:
            values: dict[str, Any] = {
                k: tuple(map(float, v)) if isinstance(v, list | tuple) else float(v) for k, v in table.items()
            }
        except (TypeError, ValueError) as error:
            raise InputError(f"robot model {model_name}: simulation settings are numbers: {error}") from error
        return cls(**values)
