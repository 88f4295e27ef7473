"""A crate that is pushed, and whether a path can be pushed."""

from dataclasses import replace

import numpy as np
from geometry_fixtures import box

from hmap_core.contacts.friction import in_cone, needed_wrench
from hmap_core.contacts.push import SlidingBody
from hmap_core.contacts.push_path import sides
from hmap_core.types import BodyKind

CRATE = replace(box("crate", (0.12, 0.12, 0.08), (0, 0, 0), kind=BodyKind.MOVABLE), friction=0.4)


def assert_can_be_pushed(path, body=CRATE):
    """At each step some force on one side, within 70 % of the friction, is what the motion needs."""
    slide = SlidingBody(body, path[0])
    width = 0.06
    lines = []
    for side in sides(body, slide):
        inward = np.array([np.cos(side.heading), np.sin(side.heading)])
        across = np.array([-inward[1], inward[0]])
        forces = [inward + sign * 0.7 * body.friction * across for sign in (1, -1)]
        ends = [-0.06 * inward + sign * width * across for sign in (1, -1)]
        lines.append([[*f, e[0] * f[1] - e[1] * f[0]] for f in forces for e in ends])
    lines = np.array(lines)
    for twists in slide.twists(path):
        for twist in twists:
            wrench = needed_wrench(twist, slide.length)
            assert in_cone(lines, wrench / np.linalg.norm(wrench)).any()
