"""Bodies that a plan may move: the goal's object, tools, and those that the scene calls removable."""

from hmap_core.validation import limits
from hmap_core.validation.objects import deviation
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.world import World


def check(world: World, findings: Findings) -> None:
    """Reports movable bodies that the plan moves without permission; files that name no ``removable`` allow all."""
    allowed = world.document.removable
    if allowed is None:
        return
    for name, body in world.document.bodies.items():
        if body.kind != "movable" or name in allowed or name == world.document.goal.object:
            continue
        distance, angle = deviation(world.poses[name], body.pose)
        moved = (distance > limits.UNTOUCHED_POSITION) | (angle > limits.UNTOUCHED_ROTATION)
        if moved.any():
            begin = world.document.time[int(moved.argmax())]
            findings.add(Kind.NOT_REMOVABLE, (name,), begin, distance.max(), limits.UNTOUCHED_POSITION, 1.0)
