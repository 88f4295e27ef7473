"""The motions of a hand-over: one robot brings an object to a meeting pose, another one takes it over there.

Both hands hold the object for a moment, and both robots stand then. The giver moves the object as an attached body
from its support to the meeting pose, the taker from there to the goal.
"""

import time

import numpy as np

from hmap_core.contacts.feasibility import reachable
from hmap_core.exceptions import MotionError
from hmap_core.komo.manipulation import Manipulation
from hmap_core.planner.interfaces import RobotContact, SubTrajectory
from hmap_core.planner.segments.attached import attach_body
from hmap_core.planner.segments.motion_sequence import MotionSequence, held_still
from hmap_core.planner.segments.motions import come, go, leave, pick, place
from hmap_core.planner.transit import find_transit
from hmap_core.planner.transit_search import FindTransit
from hmap_core.types import ContactPoint, Scene, SceneState


def pass_on(
    scene: Scene,
    state: SceneState,
    object: str,
    contacts: tuple[RobotContact, RobotContact],
    object_poses: np.ndarray,
    rng: np.random.Generator,
    time_limit: float,
    find: FindTransit = find_transit,
) -> SubTrajectory:
    """Plan the motion in which one robot picks an object, passes it to another one, and that one places it.

    Args:
        scene, state: the world, and where everything is.
        object: name of the object.
        contacts: of the giver, with its configurations at the present pose and at the meeting; and of the taker.
        object_poses: (3, 7) of the object: the present one, at the meeting, and at the goal.
        rng: the only source of randomness.
        time_limit: s.
        find: searches a transit where the optimiser finds none.

    Raises:
        MotionError: NO_MOTION; an arm does not reach one of the poses, or there is no motion.
    """
    deadline, motions = time.monotonic() + time_limit, MotionSequence(state)
    (given, taken), (start, _, T_goal) = contacts, object_poses
    giver, taker = given.robot, taken.robot

    def left() -> float:
        return deadline - time.monotonic()

    motions.add(pick(scene, motions.state, given, object, rng, left(), find))
    carrying = attach_body(scene, giver, object, given.contact, start)
    motions.add(go(carrying, motions.state, giver, given.keyframes[1], rng, left(), find))
    T = motions.state.poses[object]
    there = contact_at(scene, motions.state, taker, object, taken.contact, T, rng)
    coming = come(scene, motions.state, there, object, rng, left(), find)
    motions.add(held_still(scene, coming, object, given))
    released = RobotContact(giver, given.contact, 0, motions.state.q[giver][None])
    leaving = leave(scene, motions.state, released, object)
    motions.add(held_still(scene, leaving, object, taken))
    carrying = attach_body(scene, taker, object, taken.contact, T)
    motions.add(go(carrying, motions.state, giver, scene.robots[giver].model.home, rng, left(), find))
    placed = contact_at(scene, motions.state, taker, object, taken.contact, T_goal, rng)
    motions.add(place(scene, motions.state, placed, object, T_goal, rng, left(), find))
    return motions.joined()


def contact_at(
    scene: Scene,
    state: SceneState,
    robot: str,
    object: str,
    contact: ContactPoint,
    T: np.ndarray,
    rng: np.random.Generator,
) -> RobotContact:
    """A contact with the object at T (7,) and the configuration that reaches it.

    Raises:
        MotionError: NO_MOTION; the arm does not reach it.
    """
    there = state.copy()
    there.poses[object] = T
    ok, q = reachable(Manipulation(scene, there, robot, object), [contact], T, rng)
    if not ok[0]:
        where = ", ".join(f"{value:.3f}" for value in T[:3])
        raise MotionError(f"'{robot}' does not reach its grasp on '{object}' at ({where})")
    return RobotContact(robot, contact, 0, q)
