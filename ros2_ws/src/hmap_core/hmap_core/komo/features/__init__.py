"""The differentiable maps that objectives are made of."""

from hmap_core.komo.features.above import above
from hmap_core.komo.features.axis import axis_alignment
from hmap_core.komo.features.base import Feature
from hmap_core.komo.features.distance import clearance, distance
from hmap_core.komo.features.friction import friction_cone
from hmap_core.komo.features.joint import joint_position
from hmap_core.komo.features.limits import joint_limits, joint_rate_limits
from hmap_core.komo.features.pose import pose_params, pose_params_all, relative_pose
from hmap_core.komo.features.position import relative_position
from hmap_core.komo.features.stable import stable
from hmap_core.komo.features.symbolic import symbolic_feature

__all__ = [
    "Feature",
    "above",
    "axis_alignment",
    "clearance",
    "distance",
    "friction_cone",
    "joint_limits",
    "joint_position",
    "joint_rate_limits",
    "pose_params",
    "pose_params_all",
    "relative_pose",
    "relative_position",
    "stable",
    "symbolic_feature",
]
