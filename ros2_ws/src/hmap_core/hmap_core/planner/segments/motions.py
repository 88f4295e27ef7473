"""The motions that the planner asks for; each is a sub-trajectory from the present state."""

import time

import numpy as np

from hmap_core.exceptions import MotionError
from hmap_core.komo.segment import free_opening
from hmap_core.planner.interfaces import RobotContact, SubTrajectory
from hmap_core.planner.segments.attached import attach_body, with_attached
from hmap_core.planner.segments.contact_segment import ContactSegment, CutCorner
from hmap_core.planner.segments.lift_off import lift_path, vertical
from hmap_core.planner.segments.parts import joined_parts, last_configuration
from hmap_core.planner.segments.timing import SAME_OPENING
from hmap_core.planner.segments.transits import standing_collision, transit
from hmap_core.planner.transit import find_transit
from hmap_core.planner.transit_search import FindTransit
from hmap_core.types import Scene, SceneState

FINENESS = (1.0, 0.3, 0.1)  # shares of the step along the object's path that are tried


def solve_segment(
    scene: Scene,
    state: SceneState,
    object: str,
    contact: RobotContact,
    object_poses: np.ndarray,
    rng: np.random.Generator,
    time_limit: float,
    find: FindTransit = find_transit,
) -> SubTrajectory:
    """Plans the motion in which ``contact`` carries the object along object_poses (K, 7), from the present state.

    A robot with an attached body touches the object with that, and keeps it still at the end.

    Raises:
        MotionError: NO_MOTION, with the constraint that stays violated and where.
    """
    deadline = time.monotonic() + time_limit
    parts, cleared = _prepared(scene, state, contact, object, rng, deadline, find)
    parts += _carried(scene, cleared, object, contact, object_poses, rng, deadline, find)
    return joined_parts(scene, state, parts)


def pick(
    scene: Scene,
    state: SceneState,
    contact: RobotContact,
    body: str,
    rng: np.random.Generator,
    time_limit: float,
    find: FindTransit = find_transit,
) -> SubTrajectory:
    """The motion in which a robot grasps a body where it stands, and lifts it where there is room.

    Raises:
        MotionError: NO_MOTION.
    """
    deadline, robot = time.monotonic() + time_limit, contact.robot
    parts, cleared = _prepared(scene, state, contact, body, rng, deadline, find)
    segment = ContactSegment(scene, cleared, body, contact, state.poses[body][None], find=find)
    parts.append(segment.come(rng, deadline))
    cleared.q[robot] = last_configuration(parts, robot)
    cleared.gripper[robot] = parts[-1].trajectory.gripper[robot][-1]
    grasped = attach_body(scene, robot, body, contact.contact, state.poses[body])
    path = lift_path(grasped, cleared, robot, cleared.q[robot])
    parts.append(with_attached(grasped, vertical(grasped, cleared, robot, path)))
    return joined_parts(scene, state, parts)


def come(
    scene: Scene,
    state: SceneState,
    contact: RobotContact,
    object: str,
    rng: np.random.Generator,
    time_limit: float,
    find: FindTransit = find_transit,
) -> SubTrajectory:
    """The motion in which a robot comes to a contact in exactly the configuration keyframes[0], and closes its gripper.

    Raises:
        MotionError: NO_MOTION.
    """
    deadline = time.monotonic() + time_limit
    parts, cleared = _prepared(scene, state, contact, object, rng, deadline, find)
    segment = ContactSegment(scene, cleared, object, contact, state.poses[object][None], find=find)
    parts.append(segment.come(rng, deadline, exact=True))
    return joined_parts(scene, state, parts)


def leave(scene: Scene, state: SceneState, contact: RobotContact, object: str) -> SubTrajectory:
    """The motion in which a robot opens its gripper and draws back from an object that stays where it is.

    Raises:
        MotionError: NO_MOTION.
    """
    segment = ContactSegment(scene, state, object, contact, state.poses[object][None])
    return joined_parts(scene, state, [segment.leave()])


def go(
    scene: Scene,
    state: SceneState,
    robot: str,
    q: np.ndarray,
    rng: np.random.Generator,
    time_limit: float,
    find: FindTransit = find_transit,
) -> SubTrajectory:
    """The motion of a robot to the configuration q (n,), with its hand as it is.

    Raises:
        MotionError: NO_MOTION.
    """
    moved = transit(scene, state, robot, q, rng, time.monotonic() + time_limit, find)
    return joined_parts(scene, state, [with_attached(scene, moved)])


def place(
    scene: Scene,
    state: SceneState,
    contact: RobotContact,
    body: str,
    T_place: np.ndarray,
    rng: np.random.Generator,
    time_limit: float,
    find: FindTransit = find_transit,
) -> SubTrajectory:
    """The motion in which a robot places the body in its grasp at T_place (7,), where its configuration is
    keyframes[0].

    Raises:
        MotionError: NO_MOTION.
    """
    deadline, robot = time.monotonic() + time_limit, contact.robot
    grasped = attach_body(scene, robot, body, contact.contact, T_place)
    there = state.copy()
    there.q[robot], there.poses[body] = contact.keyframes[0], T_place
    path = lift_path(grasped, there, robot, there.q[robot])
    above = transit(grasped, state, robot, path[-1], rng, deadline, find)
    lowering = vertical(grasped, there, robot, path, down=True)
    retreat = ContactSegment(scene, there, body, contact, T_place[None]).leave()
    return joined_parts(scene, state, [with_attached(grasped, above), with_attached(grasped, lowering), retreat])


def _prepared(
    scene: Scene,
    state: SceneState,
    contact: RobotContact,
    object: str,
    rng: np.random.Generator,
    deadline: float,
    find: FindTransit = find_transit,
) -> tuple[list[SubTrajectory], SceneState]:
    """What comes before a robot goes to a contact, and the state after it.

    The other robots of the contact go home, and the robot rises where there is no room to open its gripper.
    """
    parts: list[SubTrajectory] = []
    cleared = state.copy()
    for other in contact.clear:
        home = scene.robots[other].model.home
        parts.append(with_attached(scene, transit(scene, cleared, other, home, rng, deadline, find)))
        cleared.q[other] = last_configuration(parts, other)
    return [*parts, *_rise_to_open(scene, cleared, contact, object)], cleared


def _rise_to_open(scene: Scene, state: SceneState, contact: RobotContact, object: str) -> list[SubTrajectory]:
    """The part in which a robot rises to where its gripper may open, if it has to; ``state`` is where it then is."""
    robot = contact.robot
    free = free_opening(scene.robots[robot], contact.contact)
    if abs(free - state.gripper[robot]) < SAME_OPENING:
        return []
    opened = state.copy()
    opened.gripper[robot] = free
    hit = standing_collision(scene, opened, robot, object)
    if hit is None:
        return []
    path = lift_path(scene, state, robot, state.q[robot])
    if len(path) == 1:
        raise MotionError(f"robot '{robot}' has no room to open its gripper: {' and '.join(hit[0])}")
    risen = vertical(scene, state, robot, path)
    state.q[robot] = last_configuration([risen], robot)
    return [risen]


def _carried(
    scene: Scene,
    state: SceneState,
    object: str,
    contact: RobotContact,
    object_poses: np.ndarray,
    rng: np.random.Generator,
    deadline: float,
    find: FindTransit,
) -> list[SubTrajectory]:
    """The parts of the segment itself, with finer steps along the object's path where coarse ones cut a corner."""
    failure = MotionError("no fineness was tried")
    for fineness in FINENESS:
        try:
            segment = ContactSegment(scene, state, object, contact, object_poses, fineness, find)
            return segment.solve(rng, deadline)
        except CutCorner as error:
            failure = error
    raise failure
