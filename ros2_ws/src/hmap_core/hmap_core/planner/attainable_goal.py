"""The pose nearest to a goal at which its object can stand: goals are measured or computed, and not exact either.

A goal that is a little inside of its support, above it, or tilted cannot be reached as it is. Where the goal's
tolerance allows a pose that can be reached, that one is planned for, and a note says so.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from hmap_core.collision.convex import ConvexSet, set_distance
from hmap_core.komo.shapes import body_set
from hmap_core.planner.obstruction import LIFT
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.transforms import apply, distance, pose, quaternion_multiply, rotation_matrix
from hmap_core.types import Body, Goal, Scene, SceneState, TaskMode
from hmap_core.waypoints import stable_poses
from hmap_core.waypoints.checker import PENETRATION_ALLOWED

TOUCHING = 0.001  # m between a body and its support, which the judge of plans allows
KEPT = 0.0005, float(np.deg2rad(0.1))  # m and rad of the tolerance that motions may need
DIRECTIONS = 16  # in which a pose beside the goal is looked for
SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)  # of the position tolerance, by how much beside it
# m; the planner asks for more room to the edge of a support than the judge of plans
ASIDE = 0.005 * np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
LEVEL = 1e-9  # rad of tilt that is none


def attainable_goal(scene: Scene, state: SceneState, goal: Goal) -> tuple[Goal, tuple[str, ...]]:
    """The goal, at the nearest pose within its tolerance at which the object is free, and stands in a physical task.

    Args:
        scene: with the object.
        state: where everything is.
        goal: what is asked for.

    Returns:
        The goal, with the tolerance that is left, and a note where its pose was changed. It stays as it is where the
        object can be there, and where its tolerance allows no better pose.
    """
    around = [body for body in placed_bodies(scene, state, goal.object) if body.name not in scene.removable]
    places = _Places(scene.bodies[goal.object], around)
    free, physical = places.free(goal.pose), scene.mode == TaskMode.PHYSICAL
    if free and (not physical or places.stands(goal.pose)):
        return goal, ()
    found = places.level(goal) if free and places.touches(goal.pose) else places.nearest(goal, physical)
    if found is None:
        return goal, ()
    moved, turned = distance(goal.pose, found)
    left = goal.position_tolerance - moved, goal.rotation_tolerance - turned
    x, y, z = 1e3 * (found[:3] - goal.pose[:3])
    note = (
        f"goal of '{goal.object}': it cannot be just there; planned for a pose within its tolerance, "
        f"({x:.1f}, {y:.1f}, {z:.1f}) mm and {np.degrees(turned):.1f} deg away"
    )
    return replace(goal, pose=found, position_tolerance=left[0], rotation_tolerance=left[1]), (note,)


def stands_there(scene: Scene, state: SceneState, object: str, T: np.ndarray) -> bool:
    """Whether an object stays by itself at a pose T (7,), or ASIDE beside it, with what is removable or without."""
    around = placed_bodies(scene, state, object)
    for others in (around, [body for body in around if body.name not in scene.removable]):
        places = _Places(scene.bodies[object], others)
        beside = (np.concatenate([T[:3] + offset, T[3:]]) for offset in ASIDE)
        if any(places.stands(other) for other in (T, *beside)):
            return True
    return False


class _Places:
    """Where a body can be among others."""

    def __init__(self, body: Body, around: Sequence[Body]):
        self._body, self._around = body, around
        self._own = body_set(body)
        self._others = [(body_set(other), other.pose) for other in around]
        self._tops = np.unique(np.concatenate([_tops(*other) for other in self._others])) if around else np.zeros(0)

    def free(self, T: np.ndarray) -> bool:
        """Whether the body at T (7,) is in nothing."""
        return self._distance(T, -PENETRATION_ALLOWED) >= -PENETRATION_ALLOWED

    def touches(self, T: np.ndarray) -> bool:
        """Whether the body at T (7,) is at something that may carry it."""
        return self._distance(T, TOUCHING) <= TOUCHING

    def stands(self, T: np.ndarray) -> bool:
        """Whether the body at T (7,) stands by itself."""
        return bool(stable_poses(self._body, np.array([T + LIFT, T]), self._around)[1])

    def nearest(self, goal: Goal, standing: bool) -> np.ndarray | None:
        """The nearest pose (7,) within the tolerance of a goal at which the body is free, and stands if asked for.

        Where it stands nowhere as far as that is understood, as a ball does not, one at which it touches something.
        """
        ways = np.linspace(0.0, 2.0 * np.pi, DIRECTIONS, endpoint=False)
        aside = [share * np.array([np.cos(way), np.sin(way)]) for share in SHARES for way in (ways if share else [0.0])]
        turned = [goal.pose[3:], *self._level(goal)]
        free = [T for quaternion in turned for T in self._on_supports(goal, quaternion, aside) if self.free(T)]
        free.sort(key=lambda T: distance(goal.pose, T))
        if not standing:
            return free[0] if free else None
        first = next((T for T in free if self.stands(T)), None)
        return next((T for T in free if self.touches(T)), None) if first is None else first

    def level(self, goal: Goal) -> np.ndarray | None:
        """The pose (7,) at the place of a goal in which a face of the body is level and it stands; None: there is none
        within the tolerance."""
        found = (T for quaternion in self._level(goal) for T in self._on_supports(goal, quaternion, [np.zeros(2)]))
        return next((T for T in found if self.free(T) and self.stands(T)), None)

    def _on_supports(self, goal: Goal, quaternion: np.ndarray, aside: Sequence[np.ndarray]) -> Iterator[np.ndarray]:
        """Poses within the tolerance of a goal, at its height and on each support round it.

        Args:
            quaternion: (4,) the orientation.
            aside: (2,) horizontal distances from the goal, as shares of the tolerance.
        """
        most = goal.position_tolerance - KEPT[0]
        points = apply(pose(goal.pose[:3], quaternion), self._own.vertices)[:, 2]
        lowest = (points - np.repeat(self._own.radius, np.diff(self._own.start))).min()
        for rise in [0.0, *(self._tops - lowest)]:
            for x, y in most * np.array(aside):
                if np.linalg.norm([x, y, rise]) <= most:
                    yield pose(goal.pose[:3] + [x, y, rise], quaternion)

    def _level(self, goal: Goal) -> Iterator[np.ndarray]:
        """The orientation (4,) nearest to a goal's in which a face of the body is level, where the tolerance allows
        it and the goal's own is not level."""
        down = -rotation_matrix(goal.pose)[2]  # in the body's frame
        faces = _faces(self._own)
        if not len(faces):
            return
        face = faces[int((faces @ down).argmax())]
        axis = np.cross(face, down)
        angle = float(np.arctan2(np.linalg.norm(axis), face @ down))
        if LEVEL < angle <= goal.rotation_tolerance - KEPT[1]:
            turn = np.append(np.sin(0.5 * angle) * axis / np.linalg.norm(axis), np.cos(0.5 * angle))
            yield quaternion_multiply(goal.pose[3:], turn)

    def _distance(self, T: np.ndarray, cutoff: float) -> float:
        """Distance (m) from the nearest body; above ``cutoff`` only a lower bound."""
        return min((set_distance(self._own, T, *other, cutoff) for other in self._others), default=np.inf)


def _tops(shapes: ConvexSet, T: np.ndarray) -> np.ndarray:
    """Heights (S,) in metres at which shapes at T (7,) end above."""
    heights = apply(T, shapes.vertices)[:, 2] + np.repeat(shapes.radius, np.diff(shapes.start))
    return np.maximum.reduceat(heights, shapes.start[:-1])


def _faces(shapes: ConvexSet) -> np.ndarray:
    """Outward normals (F, 3) of the faces of the hull round shapes; none where they have no volume."""
    try:
        return ConvexHull(shapes.vertices).equations[:, :3]
    except (QhullError, ValueError):
        return np.zeros((0, 3))
