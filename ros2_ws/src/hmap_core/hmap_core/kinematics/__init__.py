"""Serial arms from URDF files: frames, Jacobians and tight link hulls."""

from hmap_core.kinematics.arm import Arm, LinkHull, load_arm

__all__ = ["Arm", "LinkHull", "load_arm"]
