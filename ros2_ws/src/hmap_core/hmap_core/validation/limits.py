"""Every tolerance of the judge, in one place. SI units; the reasons are in ``docs/validation.md``."""

import math

# --- geometry ---
PENETRATION = 1e-3  # m, deepest overlap of two bodies
MOTION_BOUND = 2e-3  # m, two samples are subdivided until no point of a pair moves more than this between looks
MAX_SUBDIVISION = 128  # looks between two samples; only a jump, which is reported anyway, could ask for more
SAMPLES_AT_ONCE = 2_000_000  # samples of pairs whose bounds are held in memory together
INSTANTS_AT_ONCE = 20_000  # instants between samples that are held in memory together

# --- file ---
LARGEST = 1e9  # no number of a plan is larger
SIZES = (1e-5, 1e3)  # m, of a shape
QUATERNION_NORM = 1e-3  # deviation of a quaternion's norm from one
TIME_UNIFORMITY = 1e-3  # deviation of a sample's time from the uniform grid, as a part of the step
ROUNDING = 1e-6  # m or rad, what decimals cut off in a file may add to a sample

# --- joints ---
LIMIT_RELATIVE = 1e-3  # excess of position (of the range), velocity and acceleration limits
# A joint that stops inside the last step can show this part of (acceleration limit * step) as its last velocity;
# derived in docs/validation.md
REST_VELOCITY = 0.25
JUMP_FACTOR = 2.0  # a step this many times the velocity limit is a discontinuity

# --- objects ---
OBJECT_SPEED = 2.0  # m/s
OBJECT_TURN_RATE = 4.0 * math.pi  # rad/s
START_JOINT = 1e-4  # rad or m, distance of the first sample from the robot's start
START_POSITION = 1e-4  # m
START_ROTATION = math.radians(0.02)
UNTOUCHED_POSITION = 1e-4  # m, drift of an object over a whole stretch in which nothing touches it
UNTOUCHED_ROTATION = math.radians(0.02)

# --- contacts ---
CONTACT_GAP = 1e-3  # m, farthest a manipulator may be from the surface it touches
SLIP_POSITION = 1e-3  # m
SLIP_ROTATION = math.radians(0.5)
OPPOSITE_NORMALS = math.radians(30.0)  # how far the contact normals of two fingers may be from opposite

# --- support ---
SUPPORT_GAP = 1e-3  # m, between an object and what carries it
STABLE_MARGIN = 1.5e-3  # m, how far inside its region of support the centre of mass must lie
SUPPORT_CHECK_STEP = 0.02  # m, travel between two looks at the support of a pushed object
GRAVITY_SLIDE = 2e-3  # m, raising an object by this must free it from what only carries it

# --- physics ---
PUSH_SPEED = 1e-3  # m/s, below this a pushed object counts as standing still
FRICTION_CONE_SLACK = math.radians(5.0)  # between the wrench a push needs and the nearest it can supply
OPENING_SLACK = 1e-4  # m, on the opening range of a gripper while it grasps
