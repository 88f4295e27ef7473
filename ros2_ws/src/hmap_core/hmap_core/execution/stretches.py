"""A plan cut where its robots may stop: the pieces that are sent to the controllers one by one."""

from dataclasses import dataclass

import numpy as np

from hmap_core.contacts.press_efforts import press_efforts
from hmap_core.exceptions import Code, InputError
from hmap_core.trajectory.samples import index_at
from hmap_core.types import BodyKind, JointTrajectory, Plan, Segment, SegmentKind, TaskMode

REST_SHARE = 0.55  # of acceleration limit * sampling period; starting from rest the first difference is half of it
GRIPPER_CHANGE = 1e-6  # m per sample; a smaller change of the opening counts as none


@dataclass(frozen=True)
class Stretch:
    """Samples ``first`` to ``last`` of a plan, all arms at rest at both.

    Attributes:
        held: robot -> the body that it grips throughout.
        label: what happens, for people.
        touched: bodies that are moved by contact meanwhile.
        free: nothing is held or touched, and a transit ends with it: all robots have drawn back, so another plan may
            take over from here.
    """

    first: int
    last: int
    held: dict[str, str]
    label: str
    touched: tuple[str, ...]
    free: bool
    apart: bool


def check_executable(plan: Plan) -> None:
    """Make sure that a plan can be executed under dynamics.

    Raises:
        InputError: the plan is a kinematic one, or is inconsistent with its scene.
    """
    if plan.scene.mode is TaskMode.KINEMATIC:
        raise InputError(
            f"the plan of '{plan.scene.task}' is kinematic: its contacts carry the object in any direction, which no "
            "real contact does, so it can be checked but not executed"
        )
    time = plan.trajectory.time
    if len(time) < 2 or time[0] != 0.0 or not (np.diff(time) > 0.0).all():
        raise plan_error("its times have to increase from 0, with two samples or more")
    for name, robot in plan.scene.robots.items():
        _check_table(f"joints of '{name}'", plan.trajectory.joints.get(name), (len(time), len(robot.q)))
        if robot.model.gripper:
            _check_table(f"gripper of '{name}'", plan.trajectory.gripper.get(name), (len(time),))
    for name, poses in plan.trajectory.objects.items():
        _check_table(f"poses of '{name}'", poses, (len(time), 7))
        if name not in plan.scene.bodies:
            raise plan_error(f"it moves '{name}', which is not in its scene")
    for index, segment in enumerate(plan.segments):
        _check_segment(plan, index, segment)


def stretches(plan: Plan) -> list[Stretch]:
    """The pieces between the instants at which something changes (mode, gripper) and all arms rest."""
    time = plan.trajectory.time
    cuts = {index_at(time, t) for segment in plan.segments for t in (segment.start, segment.end)}
    for opening in plan.trajectory.gripper.values():
        changing = np.abs(np.diff(opening)) > GRIPPER_CHANGE
        cuts |= {int(k) + 1 for k in np.flatnonzero(changing[1:] != changing[:-1])}
    ends = {0, len(time) - 1}
    kept = sorted(k for k in cuts | ends if k in ends or _resting(plan, k))
    return [_stretch(plan, a, b) for a, b in zip(kept, kept[1:], strict=False)]


def joint_trajectory(plan: Plan, robot: str, stretch: Stretch) -> JointTrajectory:
    """The motion of a robot in a stretch, for its controller; velocities by central differences, zero at the ends.

    A press has the efforts of its force.
    """
    rows = slice(stretch.first, stretch.last + 1)
    time, q = plan.trajectory.time[rows], plan.trajectory.joints[robot][rows]
    qd = np.gradient(q, time, axis=0)
    qd[0] = qd[-1] = 0.0
    efforts = None
    for segment in _active(plan, stretch.first, stretch.last):
        if segment.robot == robot and segment.force:
            since, left = time - segment.start, segment.end - time
            efforts = press_efforts(plan.scene.robots[robot], q, segment.force, since, left)
    return JointTrajectory(plan.scene.robots[robot].model.joint_names, time - time[0], q, qd, efforts)


def _stretch(plan: Plan, first: int, last: int) -> Stretch:
    time = plan.trajectory.time
    active = _active(plan, first, last)
    held = {s.robot: body for s in active if (body := _held_body(plan, s)) is not None}
    label = ", ".join(f"{s.robot}: {s.kind} {s.object or ''}".rstrip() for s in active)
    touched = tuple(s.contact_object for s in active if s.kind is not SegmentKind.TRANSIT)
    ended = last == len(time) - 1 or any(index_at(time, s.end) == last for s in active)
    tools = {tool for s in active if (tool := held_tool(plan, s)) is not None}
    apart = ended and tools.issuperset(held.values()) and tools.issuperset(touched)
    return Stretch(first, last, held, label, touched, ended and not held and not touched, apart)


def _active(plan: Plan, first: int, last: int) -> list[Segment]:
    time = plan.trajectory.time
    middle = 0.5 * (time[first] + time[last])
    return [segment for segment in plan.segments if segment.start <= middle <= segment.end]


def held_tool(plan: Plan, segment: Segment) -> str | None:
    """The tool that is attached to the robot of a segment, if any; the goal's object does not count as one."""
    body = _held_body(plan, segment)
    is_tool = body is not None and plan.scene.bodies[body].kind is BodyKind.TOOL and body != plan.scene.goal.object
    return body if is_tool else None


def _held_body(plan: Plan, segment: Segment) -> str | None:
    if segment.kind is SegmentKind.GRASP:
        return segment.object
    return segment.manipulator if segment.manipulator in plan.scene.bodies else None


def _resting(plan: Plan, k: int) -> bool:
    time = plan.trajectory.time
    for name, robot in plan.scene.robots.items():
        q = plan.trajectory.joints[name]
        for i in (k - 1, k):
            period = time[i + 1] - time[i]
            if (np.abs(q[i + 1] - q[i]) > REST_SHARE * robot.model.acceleration_limits * period**2).any():
                return False
    return True


def _check_segment(plan: Plan, index: int, segment: Segment) -> None:
    scene = plan.scene
    if segment.kind is SegmentKind.TOUCH:
        raise InputError(f"segment {index} is a kinematic touch, which carries the object; it cannot be executed")
    if segment.robot not in scene.robots:
        raise plan_error(f"segment {index} is of robot '{segment.robot}', which is not in its scene")
    if segment.kind is not SegmentKind.TRANSIT and segment.object not in scene.bodies:
        raise plan_error(f"segment {index} is a {segment.kind} of '{segment.object}', which is not in its scene")
    if not 0.0 <= segment.start <= segment.end:
        raise plan_error(f"segment {index} goes from {segment.start} s to {segment.end} s")
    if _held_body(plan, segment) is not None and scene.robots[segment.robot].model.gripper is None:
        raise plan_error(f"segment {index} is a grasp by robot '{segment.robot}', which has no gripper")


def _check_table(name: str, table: np.ndarray | None, shape: tuple[int, ...]) -> None:
    if table is None:
        raise plan_error(f"its trajectory lacks the {name}")
    if np.shape(table) != shape or not np.isfinite(table).all():
        raise plan_error(f"the {name} in its trajectory have to be {shape} finite numbers, not {np.shape(table)}")


def plan_error(what: str) -> InputError:
    """The error of a plan that cannot be executed."""
    return InputError(f"the plan cannot be executed: {what}", Code.INVALID_PLAN_FILE)
