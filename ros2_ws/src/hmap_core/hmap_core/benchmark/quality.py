"""How good the motions of plans are: how long they last, how far the joints go, and how often contacts begin."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from hmap_core.trajectory.samples import index_at
from hmap_core.types import BodyKind, Plan, Segment, SegmentKind

STILL = 1e-7  # rad; joints that move less between two samples stand
LONG = 0.3  # rad; shorter motions say nothing about the ratio of path and straight line


@dataclass(frozen=True)
class Quality:
    """The motions of one plan.

    Attributes:
        duration: s, of the whole plan.
        free: s, in which only a free hand moves.
        loaded: s, in which a robot moves an object or an attached body.
        standing: s, in which no joint moves: fingers open, close and settle.
        detour: median over the free motions of the joint path's length by that of the straight joint line.
        swing: rad, largest travel of one joint in a free motion beyond what its end requires.
        tool_swing: rad, largest travel of one joint in a motion that brings a tool from one place to the next.
        episodes: contacts of a hand, or of what is attached to it, with an object.
    """

    duration: float
    free: float
    loaded: float
    standing: float
    detour: float
    swing: float
    tool_swing: float
    episodes: int


def quality(plan: Plan) -> Quality:
    """The quality of a plan's motions."""
    time = plan.trajectory.time
    moving = np.zeros(len(time) - 1, bool)
    loaded = np.zeros(len(time) - 1, bool)
    detours, swings, tool_swings = [], [], []
    for segment in plan.segments:
        rows = _samples(plan, segment)
        q = plan.trajectory.joints[segment.robot][rows]
        steps = np.linalg.norm(np.diff(q, axis=0), axis=1)
        window = slice(rows.start, rows.stop - 1)
        moving[window] |= steps > STILL
        if segment.kind != SegmentKind.TRANSIT:
            loaded[window] |= steps > STILL
            if segment.kind == SegmentKind.GRASP and _is_tool(plan, segment.contact_object):
                tool_swings.append(float(np.abs(np.diff(q, axis=0)).sum(axis=0).max(initial=0.0)))
            continue
        line = float(np.linalg.norm(q[-1] - q[0]))
        if line > LONG:
            detours.append(float(steps.sum()) / line)
        swings.append(float((np.abs(np.diff(q, axis=0)).sum(axis=0) - np.abs(q[-1] - q[0])).max(initial=0.0)))
    dt = float(time[1] - time[0]) if len(time) > 1 else 0.0
    return Quality(
        duration=float(time[-1]),
        free=dt * int((moving & ~loaded).sum()),
        loaded=dt * int(loaded.sum()),
        standing=dt * int((~moving).sum()),
        detour=float(np.median(detours)) if detours else 1.0,
        swing=max(swings, default=0.0),
        tool_swing=max(tool_swings, default=0.0),
        episodes=_episodes(plan),
    )


def _is_tool(plan: Plan, body: str) -> bool:
    return plan.scene.bodies[body].kind == BodyKind.TOOL and body != plan.scene.goal.object


def _samples(plan: Plan, segment: Segment) -> slice:
    """The samples of a segment, its last one included."""
    time = plan.trajectory.time
    return slice(index_at(time, segment.start), index_at(time, segment.end) + 1)


def _episodes(plan: Plan) -> int:
    """How often a hand, or what is attached to it, begins to touch an object."""
    count = 0
    grasped, touched = dict[str, str | None](), dict[str, str | None]()  # by robot: by its hand, by what is attached
    for segment in sorted(plan.segments, key=lambda segment: segment.start):
        robot = segment.robot
        if segment.kind == SegmentKind.TRANSIT:
            grasped.pop(robot, None)
            touched.pop(robot, None)
        elif segment.manipulator == plan.scene.robots[robot].model.end_effector_link:
            count += grasped.get(robot) != segment.object
            grasped[robot] = segment.object
            touched.pop(robot, None)
        else:
            count += touched.get(robot) != segment.object
            touched[robot] = segment.object
    return count


def medians(found: Sequence[Quality]) -> dict[str, float]:
    """The median of each attribute over several plans."""
    return {field.name: float(np.median([getattr(one, field.name) for one in found])) for field in fields(Quality)}
