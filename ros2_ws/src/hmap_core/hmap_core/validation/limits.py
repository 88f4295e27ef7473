"""All tolerances of the judge. SI units; ``docs/validation.md`` gives the reasons."""

import math

# --- geometry ---
PENETRATION = 1e-3  # m, deepest allowed overlap of two bodies
HEAD_ON = 2e-4  # m, the same where a held body meets a face of another one; less is the step between flush surfaces
TOUCH_DEPTH = 1e-4  # m, overlap from which on two bodies have met; their normal is well defined there
HEAD_ON_ANGLE = math.radians(60.0)  # between motion and normal; at more, a body slides along the face that it meets
SAME_NORMAL = math.radians(5.0)  # angle up to which two surfaces that carry a body count as flush
MOTION_BOUND = 2e-3  # m, steps are subdivided until no point of a pair moves more than this between two measurements
MAX_SUBDIVISION = 128  # intervals of a step; only a jump, which is a violation itself, would need more
MAX_PAIR_SAMPLES = 2_000_000  # pairs times samples whose bounds are in memory at once
MAX_INSTANTS = 20_000  # instants between samples that are in memory at once

# --- file ---
MAX_NUMBER = 1e9  # largest absolute value of a number of a plan
SIZES = (1e-5, 1e3)  # m, of a shape
QUATERNION_NORM = 1e-3  # deviation of a quaternion's norm from one
TIME_UNIFORMITY = 1e-3  # deviation of a sample's time from the uniform grid, as a part of the step
ROUNDING = 1e-6  # m or rad, rounding error of a sample in a file

# --- joints ---
LIMIT_RELATIVE = 1e-3  # excess of position (of the range), velocity and acceleration limits
# fraction of (acceleration limit * step) that a joint which stops inside the last step can show as its last velocity;
# derived in docs/validation.md
REST_VELOCITY = 0.25
JUMP_FACTOR = 2.0  # multiple of the velocity limit that counts as a discontinuity

# --- objects ---
OBJECT_SPEED = 2.0  # m/s
OBJECT_TURN_RATE = 4.0 * math.pi  # rad/s
START_JOINT = 1e-4  # rad or m, deviation of the first sample from the robot's start configuration
START_POSITION = 1e-4  # m
START_ROTATION = math.radians(0.02)
UNTOUCHED_POSITION = 1e-4  # m, drift of an object over a whole interval without contact
UNTOUCHED_ROTATION = math.radians(0.02)

# --- contacts ---
CONTACT_GAP = 1e-3  # m, largest distance between a manipulator and the surface it touches
SLIP_POSITION = 1e-3  # m
SLIP_ROTATION = math.radians(0.5)
OPPOSITE_NORMALS = math.radians(30.0)  # largest angle between one finger's contact normal and the other's, reversed
ONE_SIDE = math.radians(90.0)  # largest angle between the contact normals of the fingers of a push
PAD_OFFSET = 2e-3  # m that a pad may be off along the face that it grasps; it then still reaches the object

# --- support ---
SUPPORT_GAP = 1e-3  # m, largest distance between an object and its support
STABLE_MARGIN = 1.5e-3  # m, stability margin: distance of the centre of mass from the edge of the support region
SUPPORT_CHECK_STEP = 0.02  # m, travel between two support checks of a pushed object
GRAVITY_SLIDE = 2e-3  # m, raising an object by this distance separates it from its support
REST_TILT = math.tan(math.radians(6.0))  # tilt of gravity that an object in a cradle, or one that could roll, resists
REST_FRICTION = 0.8  # share of the friction coefficient that this relies on
REST_CARRIED = 0.5  # share of its weight that normal forces carry; friction between two walls is not relied on
ROLL_ROOM = 0.02  # m that such an object may move until something stops it

# --- physics ---
PUSH_SPEED = 1e-3  # m/s, speed below which a pushed object counts as at rest
FRICTION_CONE_SLACK = math.radians(5.0)  # angle between the wrench that a push requires and the nearest feasible one
PRESS_ANGLE = math.radians(10.0)  # largest angle between the normal of a press and the vertical
OPENING_SLACK = 1e-4  # m, tolerance of the opening range of a gripper during a grasp
GRAVITY = 9.81  # m/s^2
LIFTED = 1e-3  # m, rise or fall of an object's lowest point from which on its grasp carries it
GRIP_SLACK = 0.02  # share by which the force that a grasp has to hold may exceed what the pads hold
LEAST_LEVER = 0.01  # m between hands, seen from above, from which on lever arms say who carries how much
