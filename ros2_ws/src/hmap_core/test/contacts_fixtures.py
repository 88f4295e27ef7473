"""A simple hand for tests of the contacts."""

import numpy as np

from hmap_core.contacts.candidates import Hand
from hmap_core.types import Gripper

TIP_OFFSET = 0.0072
# two closed fingers as one box, 17 x 26 mm, ending 7.2 mm beyond the frame
TIP = np.array([[x, y, z] for x in (-0.0087, 0.0087) for y in (-0.013, 0.013) for z in (-0.04, TIP_OFFSET)])
GRIPPER = Gripper(
    joint_names=("left", "right"),
    per_joint=0.5,
    finger_links=("left", "right"),
    min_opening=0.0,
    max_opening=0.0778,
    open_opening=0.08,
    tip_offset=TIP_OFFSET,
    pad_half_width=0.0087,
    force=40.0,
)
HAND = Hand(TIP, GRIPPER)
