"""Controllers between commands and joint targets, without ROS: what stands behind a robot's actions.

They are stepped with the present time and neither know nor care whether the joints are simulated or real.
"""

from hmap_core.execution.outcome import Outcome
from hmap_core.simulation.gripper_controller import STALL_TIME, GripperController, GripperResult
from hmap_core.simulation.trajectory_controller import (
    StartsElsewhere,
    Tolerances,
    Tracking,
    TrajectoryController,
    from_instant,
)

__all__ = [
    "STALL_TIME",
    "GripperController",
    "GripperResult",
    "Outcome",
    "StartsElsewhere",
    "Tolerances",
    "Tracking",
    "TrajectoryController",
    "from_instant",
]
