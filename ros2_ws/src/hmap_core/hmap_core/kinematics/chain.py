"""The moving joints as the compiled code takes them."""

from collections import namedtuple

#   parent (n,): frame each joint hangs on; frame 0 is the world, frame i + 1 follows joint i
#   R_joint (n,3,3), p_joint (n,3): fixed transform from that frame to the joint at zero
#   prismatic (n,): 1 for sliding joints; lower, upper (n,): limits
#   first (n+1,): first joint of the chain that each frame belongs to
#   reach (n,): no point moved by joint i is farther than this from its axis (1 for sliding joints), so that
#     reach . |dq| bounds the motion of every point
Chain = namedtuple("Chain", "parent R_joint p_joint prismatic first lower upper reach")
