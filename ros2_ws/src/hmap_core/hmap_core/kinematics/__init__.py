"""Kinematics of serial arms (from URDF files) and of free bodies: frames, Jacobians and tight link hulls."""

from hmap_core.kinematics.arm import Arm, LinkHull, load_arm
from hmap_core.kinematics.free_body import FreeBody, Freedom, extent_of
from hmap_core.kinematics.model import KinematicModel, PlacedArm

__all__ = ["Arm", "FreeBody", "Freedom", "KinematicModel", "LinkHull", "PlacedArm", "extent_of", "load_arm"]
