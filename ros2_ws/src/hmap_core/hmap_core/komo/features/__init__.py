"""The differentiable maps that objectives are made of."""

from hmap_core.komo.features.above import above
from hmap_core.komo.features.axis import axis_alignment
from hmap_core.komo.features.base import Feature
from hmap_core.komo.features.joint import joint_position
from hmap_core.komo.features.pose import pose_params, pose_params_all, relative_pose
from hmap_core.komo.features.position import relative_position
from hmap_core.komo.features.symbolic import symbolic_feature

__all__ = [
    "Feature",
    "above",
    "axis_alignment",
    "joint_position",
    "pose_params",
    "pose_params_all",
    "relative_pose",
    "relative_position",
    "symbolic_feature",
]
