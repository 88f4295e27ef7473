"""The differentiable maps that objectives are made of."""

from hmap_core.komo.features.axis import axis_alignment
from hmap_core.komo.features.base import Feature
from hmap_core.komo.features.joint import joint_position
from hmap_core.komo.features.pose import pose_params, pose_params_all, relative_pose
from hmap_core.komo.features.position import relative_position

__all__ = [
    "Feature",
    "axis_alignment",
    "joint_position",
    "pose_params",
    "pose_params_all",
    "relative_pose",
    "relative_position",
]
