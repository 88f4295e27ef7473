"""Tools that robots have in their hands in the middle of a plan, and what it takes to go on with them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hmap_core.execution.stretches import held_tool
from hmap_core.trajectory.samples import index_at
from hmap_core.types import Plan


@dataclass(frozen=True)
class AttachedTool:
    """A tool that a robot has taken.

    Attributes:
        robot, tool: names.
        contact_pose: (7,) of the end-effector frame in the tool's.
        opening: of the gripper that holds it, m.
        q_place: (n,) configuration in which it was taken.
        T_place: (7,) where it stood, world.
    """

    robot: str
    tool: str
    contact_pose: np.ndarray
    opening: float
    q_place: np.ndarray
    T_place: np.ndarray


def attached_tools(plan: Plan, sample: int, before: Mapping[str, AttachedTool]) -> dict[str, AttachedTool]:
    """Robot -> the tool in its hand at a sample of a plan; ``before`` are those with which the plan begins.

    A tool of which the plan does not say how it is held is left out.
    """
    time, found = plan.trajectory.time, dict(before)
    for segment in plan.segments:
        first, robot = index_at(time, segment.start), segment.robot
        if first >= sample:
            break
        tool = held_tool(plan, segment)
        if tool is None:
            found.pop(robot, None)
        elif (robot not in found or found[robot].tool != tool) and segment.contact_pose is not None:
            found[robot] = AttachedTool(
                robot,
                tool,
                segment.contact_pose,
                float(plan.trajectory.gripper[robot][first]),
                plan.trajectory.joints[robot][first],
                plan.trajectory.objects[tool][first],
            )
    return found
