"""Distances that are kept, in metres."""

ROBOT_CLEARANCE = 0.003  # links from everything that stands around
SELF_CLEARANCE = 0.002  # links from other links of the same arm
OBJECT_CLEARANCE = 0.002  # links from the object that is handled, but for what touches it
HELD_CLEARANCE = 0.0015  # the carried object from what stands around, where start and end leave that much
TOUCH_ALLOWANCE = 0.0003  # a touching fingertip, or an object on its support, may be this far inside
