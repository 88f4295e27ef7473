"""Paths of an object that a hand can follow: planned for the object and the hand that holds it as one rigid body.

H-MaP plans the path of the object alone, and then finds hands that follow it. If the way is narrow for the hand but not
for the object, none may be found, however often that is repeated. Then the order is reversed: a contact that can be
made at the start and released at the goal comes first, and its hand goes with the object through the same search
(Algorithm 2).
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from hmap_core.collision.convex import set_distance
from hmap_core.exceptions import InputError
from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.shapes import body_set, box_round
from hmap_core.planner.interfaces import AttachedPath
from hmap_core.planner.obstruction import without
from hmap_core.planner.protocols import ObjectPathPlanner, ObjectPathQuery
from hmap_core.types import Body, ContactPoint, Goal, Robot, Scene, SceneState
from hmap_core.waypoints import NoObjectPath
from hmap_core.waypoints.checker import PENETRATION_ALLOWED

CHECKS = 2000  # motions for one of them, unless told; those that are found take some hundred


def with_hand(body: Body, robot: Robot, contact: ContactPoint) -> Body:
    """The body with the links after the last joint of the robot in contact with it, each as a box around the link."""
    hulls = load_arm(robot.model).hand(contact.opening)
    shapes = [box_round(points, radius, contact.T_obj_ee) for points, radius in hulls]
    return replace(body, shapes=(*body.shapes, *shapes))


def attached_paths(
    planner: ObjectPathPlanner,
    scene: Scene,
    state: SceneState,
    goal: Goal,
    hands: Iterable[tuple[str, ContactPoint]],
    rng: np.random.Generator,
    time_limit: float,
    checks: int = CHECKS,
) -> Iterator[AttachedPath]:
    """Yield paths of an object to its goal, one for each hand with which there is one.

    Removable bodies that the hand would be in at the start count as blockers of the path.

    Args:
        planner: plans the path of the object with the hand attached.
        scene, state: the world, and where everything is.
        goal: the object and its goal pose.
        hands: names of robots with their contacts on the object.
        rng: the only source of randomness.
        time_limit: seconds for each path.
        checks: largest number of motions whose validity is checked for each path.
    """
    for robot, contact in hands:
        found = path_with_hands(planner, scene, state, goal, [(robot, contact)], rng, time_limit, checks)
        if found is not None:
            yield AttachedPath(goal.object, found[0], robot, contact, found[1])


def path_with_hands(
    planner: ObjectPathPlanner,
    scene: Scene,
    state: SceneState,
    goal: Goal,
    hands: Sequence[tuple[str, ContactPoint]],
    rng: np.random.Generator,
    time_limit: float,
    checks: int = CHECKS,
) -> tuple[np.ndarray, tuple[str, ...]] | None:
    """Plan the path of an object to its goal with several hands attached at once.

    Arguments as of :func:`attached_paths`.

    Returns:
        The path (M, 7), and the removable bodies that block it; None where there is no path.
    """
    motion = "spatial" if scene.motion == "auto" else scene.motion  # what is held can be lifted
    object, joined = goal.object, scene.bodies[goal.object]
    for robot, contact in hands:
        joined = with_hand(joined, scene.robots[robot], contact)
    beside = _removable_in(scene, state, joined, state.poses[object])
    around = replace(without(scene, beside), motion=motion)
    around = replace(around, bodies=around.bodies | {object: joined})
    seed = int(rng.integers(2**31 - 1))
    try:
        query = ObjectPathQuery(around, state, goal, seed, time_limit, checks)
        return planner.plan_path(query).poses, beside
    except NoObjectPath as error:
        if error.free_without and error.path_without is not None:
            return error.path_without.poses, (*beside, *error.free_without)
    except InputError:
        pass  # a box round a link is larger than the link
    return None


def _removable_in(scene: Scene, state: SceneState, joined: Body, T: np.ndarray) -> tuple[str, ...]:
    """Removable bodies that an object with a hand attached penetrates at a pose T (7,)."""
    own = body_set(joined)
    return tuple(
        name
        for name in scene.removable
        if name != joined.name
        and set_distance(own, T, body_set(scene.bodies[name]), state.poses[name]) < -PENETRATION_ALLOWED
    )
