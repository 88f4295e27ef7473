"""Kinematic chains in the form that compiled code needs."""

from collections import namedtuple

#   parent (n,): index of the parent frame of each joint; frame 0 is the world, frame i + 1 follows joint i
#   R_joint (n,3,3), p_joint (n,3): fixed transform from the parent frame to the joint frame at value zero
#   prismatic (n,): 1 for prismatic joints; lower, upper (n,): limits, rad or m
#   first (n+1,): first joint of the chain that each frame belongs to
#   reach (n,): bound on the distance of the points that joint i moves from its axis, m (1 for prismatic joints);
#     reach . |dq| bounds the motion of every point
Chain = namedtuple("Chain", "parent R_joint p_joint prismatic first lower upper reach")
