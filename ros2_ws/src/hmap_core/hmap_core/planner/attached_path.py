"""Paths of an object that a hand can follow: sought for the object and the hand that holds it, as one rigid body.

H-MaP plans the path of the object alone, and then finds hands that follow it. Where the way is narrow for the hand, and
not for the object, none may be found however often that is repeated. Then one begins at the other end:
with a contact that can be made at the start and left at the goal, whose hand goes with the object through the same
search (Algorithm 2).
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.shapes import box_round
from hmap_core.planner.interfaces import AttachedPath, Backend
from hmap_core.types import Body, ContactPoint, Goal, Robot, Scene, SceneState
from hmap_core.waypoints import NoObjectPath

CHECKS = 2000  # motions for one of them, unless told; those that are found take some hundred


def with_hand(body: Body, robot: Robot, contact: ContactPoint) -> Body:
    """A body and what hangs on the last joint of the robot in contact with it, as one: every link a box round it."""
    hulls = load_arm(robot.model).hand(contact.opening)
    shapes = [box_round(points, radius, contact.T_obj_ee) for points, radius in hulls]
    return replace(body, shapes=(*body.shapes, *shapes))


def attached_paths(
    backend: Backend,
    scene: Scene,
    state: SceneState,
    goal: Goal,
    hands: Iterable[tuple[str, ContactPoint]],
    rng: np.random.Generator,
    time_limit: float,
    checks: int = CHECKS,
) -> Iterator[AttachedPath]:
    """Paths of the goal's object to it with each of some hands (robot, contact) in turn, where there is one.

    The search for each ends after ``checks`` motions.
    """
    motion = "spatial" if scene.motion == "auto" else scene.motion  # what is held can be lifted
    object, body = goal.object, scene.bodies[goal.object]
    for robot, contact in hands:
        joined = with_hand(body, scene.robots[robot], contact)
        around = replace(scene, motion=motion, bodies=scene.bodies | {object: joined})
        seed = int(rng.integers(2**31 - 1))
        try:
            poses = backend.plan_waypoints(around, state, object, goal, seed, time_limit, checks).poses
            yield AttachedPath(object, poses, robot, contact)
        except NoObjectPath as error:
            if error.free_without and error.path_without is not None:
                yield AttachedPath(object, error.path_without.poses, robot, contact, error.free_without)
        except InputError:
            continue  # a box round a link is larger than the link
