"""hmap's own search for the path of an object (Algorithm 2), round the bases of the robots."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hmap_core.collision.convex import convex_set, set_distance
from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.shapes import body_set, box_round
from hmap_core.planner.loads import has_to_be_lifted
from hmap_core.planner.protocols import ObjectPathQuery
from hmap_core.planner.surroundings import PHYSICAL_MIN_DISTANCE, placed_bodies
from hmap_core.planner.tilt import SAME_TILT, keeps_tilt, tilt_and_yaw
from hmap_core.transforms import IDENTITY
from hmap_core.types import Body, BodyKind, Scene, TaskMode
from hmap_core.waypoints import DEFAULT_MIN_DISTANCE, NoObjectPath, ObjectPath, ObjectPathProblem, plan_waypoints
from hmap_core.waypoints.checker import Geometry, ObjectChecker, check_ends
from hmap_core.waypoints.search_budget import SearchBudget

# problem, generator, time limit (s), largest number of checked motions -> path
Search = Callable[[ObjectPathProblem, np.random.Generator, float, float], ObjectPath]


class BidirectionalSearch:
    """Implements :class:`hmap_core.planner.protocols.ObjectPathPlanner`.

    Args:
        search: finds the path of one problem; by default hmap's bidirectional RRT with a roadmap
            (:mod:`hmap_core.waypoints`).
    """

    def __init__(self, search: Search = plan_waypoints):
        self._search = search

    def plan_path(self, query: ObjectPathQuery) -> ObjectPath:
        """Plan a path; plan again round the bases of the robots if the first path passes through one.

        Raises:
            NoObjectPath: there is no path.
            InputError: start or goal is invalid.
        """
        budget = SearchBudget(query.time_limit)
        problem = object_path_problem(query)
        _check_planar(query, problem)
        rng = np.random.default_rng(query.seed)
        path = self._search(problem, rng, query.time_limit, query.max_checks)
        around = bases(query.scene, query.goal.object, (problem.start, problem.goal))
        if not around or _is_free(problem, around, path.poses):
            return path
        problem = replace(problem, obstacles=(*problem.obstacles, *around))
        try:
            return self._search(problem, rng, max(budget.seconds, 0.0), query.max_checks)
        except NoObjectPath:  # the boxes are larger than the links inside them
            return path


def _check_planar(query: ObjectPathQuery, problem: ObjectPathProblem) -> None:
    """Check that planar motion leads to the goal.

    Raises:
        InputError: it does not, and start or goal is in collision.
        NoObjectPath: the goal is at another height or tilt, beyond its tolerances.
    """
    start, goal = query.state.poses[query.goal.object], query.goal
    if query.scene.motion != "planar" or not has_to_be_lifted(start, goal):
        return
    check_ends(problem)
    rise, tilt = 1e3 * (goal.pose[2] - start[2]), np.degrees(tilt_and_yaw(start, goal.pose)[0])
    raise NoObjectPath(
        f"no planar path of '{goal.object}' to its goal: planar motion keeps height and tilt, and the goal is "
        f"{rise:+.1f} mm higher and tilted by {tilt:.1f} deg; with `motion: auto` the object may be lifted",
        (),
        None,
        proven=True,
    )


def object_path_problem(query: ObjectPathQuery) -> ObjectPathProblem:
    """The path problem of an object among all bodies of the scene; level if no robot can tilt it."""
    scene, name = query.scene, query.goal.object
    T_start, T_goal = query.state.poses[name], query.goal.pose
    return ObjectPathProblem(
        scene.bodies[name],
        T_start,
        T_goal,
        placed_bodies(scene, query.state, name),
        scene.motion,
        DEFAULT_MIN_DISTANCE if scene.mode == TaskMode.KINEMATIC else PHYSICAL_MIN_DISTANCE,
        removable=frozenset(scene.removable),
        level=keeps_tilt(scene) and tilt_and_yaw(T_start, T_goal)[0] <= SAME_TILT,
    )


def bases(scene: Scene, object: str, ends: Sequence[np.ndarray]) -> tuple[Body, ...]:
    """The bases of the robots as obstacles of an object.

    Args:
        scene: the scene.
        object: name of the object.
        ends: poses (7,) of the object, world frame. Links that overlap the object there are left out.

    Returns:
        One body for each robot: a box round each link that does not move.
    """
    own, found = body_set(scene.bodies[object]), []
    for name, robot in scene.robots.items():
        T, hulls = robot.base_pose, [hull for hull in load_arm(robot.model).hulls if hull.frame == 0]
        boxes = [box_round(hull.vertices, hull.radius, IDENTITY) for hull in hulls]
        apart = tuple(b for b in boxes if all(set_distance(own, end, convex_set((b,)), T, 0.0) >= 0.0 for end in ends))
        if apart:
            found.append(Body(name, BodyKind.FIXED, apart, T))
    return tuple(found)


def _is_free(problem: ObjectPathProblem, bodies: tuple[Body, ...], poses: np.ndarray) -> bool:
    """Whether the object of a problem passes some bodies along poses (M, 7)."""
    alone = replace(problem, obstacles=bodies, removable=frozenset())
    checker = ObjectChecker(alone, Geometry(alone), False, 0.0)
    return all(checker.motion_free(a, b) for a, b in zip(poses[:-1], poses[1:], strict=True))
