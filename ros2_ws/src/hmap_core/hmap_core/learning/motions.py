"""The expensive labels: whether a feasible contact gives a motion, a valid plan, and a success in simulation."""

from dataclasses import dataclass, replace

import numpy as np

from hmap_core.exceptions import HmapError
from hmap_core.learning.labels import Stage
from hmap_core.plan_file import to_dict
from hmap_core.planner.assembly import assemble
from hmap_core.planner.interfaces import RobotContact
from hmap_core.planner.komo_segments import KomoSegmentPlanner
from hmap_core.planner.protocols import SegmentQuery
from hmap_core.planner.surroundings import away_from_home
from hmap_core.simulation.execute import execute
from hmap_core.types import ContactPoint, Goal, TaskMode
from hmap_core.validation import check

TIME_LIMIT = 120.0  # s; the number of checks ends a search before


@dataclass(frozen=True)
class MotionLabel:
    """What became of one feasible contact.

    Attributes:
        stage: the last stage reached.
        reason: why no further one was.
        position_error: m, of the object after execution; NaN where it was not executed.
        rotation_error: rad.
    """

    stage: Stage
    reason: str = ""
    position_error: float = float("nan")
    rotation_error: float = float("nan")


def label_motion(query, contact: ContactPoint, keyframes: np.ndarray, seed: int, executed: bool) -> MotionLabel:
    """Plan the motion of one contact by a bare hand, judge it, and execute it.

    Args:
        query: the :class:`~hmap_core.planner.protocols.ContactQuery` of the contact; the robots are at home.
        contact: feasible.
        keyframes: (reach + 1, n) configurations in contact.
        seed: of the planner.
        executed: whether a valid plan of a physical task is executed.
    """
    scene, state, object = query.scene, query.state, query.object
    reach = len(keyframes) - 1
    poses = query.object_poses[: reach + 1]
    found = RobotContact(query.robot, contact, reach, keyframes, away_from_home(scene, state, query.robot))
    try:
        motion = KomoSegmentPlanner().plan_segment(SegmentQuery(scene, state, object, found, poses, seed, TIME_LIMIT))
    except HmapError as error:
        return MotionLabel(Stage.NO_SEGMENT, error.reason)
    bodies = {name: replace(body, pose=state.poses[name]) for name, body in scene.bodies.items()}
    end = motion.trajectory.objects[object][-1]
    goal = Goal(object, end, scene.goal.position_tolerance, scene.goal.rotation_tolerance)
    plan = assemble(replace(scene, bodies=bodies, goal=goal), state, [motion], poses[-1:], {})
    report = check(to_dict(plan))
    if not report.valid:
        return MotionLabel(Stage.NOT_VALID, ", ".join(sorted({str(v.kind) for v in report.violations})))
    if not executed or scene.mode == TaskMode.KINEMATIC:
        return MotionLabel(Stage.VALID)
    try:
        done = execute(plan)
    except HmapError as error:
        return MotionLabel(Stage.EXECUTION_FAILED, error.reason)
    stage = Stage.EXECUTED if done.solved else Stage.EXECUTION_FAILED
    off = done.goal_error
    return MotionLabel(stage, done.reason, off.position_m, float(np.deg2rad(off.rotation_deg)))
