"""Which bodies are in the way of a hand, or stand on another one."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace

import numpy as np

from hmap_core.collision.convex import set_distance
from hmap_core.komo.shapes import body_set
from hmap_core.planner.interfaces import SubTrajectory
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.planner.sweep import Sweep, motion_sweeps, nearest, placed
from hmap_core.types import BodyKind, Scene, SceneState
from hmap_core.waypoints import stable_poses

PENETRATION = 1e-3  # m that a body may be inside another, as the judge of plans allows
HAND_MIN_DISTANCE = 0.005  # m that links and what they carry keep from other bodies, and a little more
CONTACT_ROOM = 0.12  # m round a contact within which the hand's way is given: it comes and leaves straight
LIFT = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0])  # m, to where a body stands on nothing


def without(scene: Scene, names: Collection[str]) -> Scene:
    """The scene without some bodies."""
    bodies = {name: body for name, body in scene.bodies.items() if name not in names}
    removable = {name: T for name, T in scene.removable.items() if name not in names}
    return replace(scene, bodies=bodies, removable=removable)


def met(scene: Scene, state: SceneState, object: str, poses: np.ndarray, names: Iterable[str]) -> tuple[str, ...]:
    """Some bodies in the order in which the path (M, 7) of an object runs into them; the others last."""
    bodies = placed(scene, state, names)
    shapes = body_set(scene.bodies[object])

    def first(name: str) -> int:
        hits = (k for k, T in enumerate(poses) if nearest([Sweep(shapes, T[None])], {name: bodies[name]}, 0.0))
        return next(hits, len(poses))

    return tuple(sorted(bodies, key=first))


def in_motions(
    scene: Scene, state: SceneState, motions: Sequence[SubTrajectory], names: Iterable[str]
) -> tuple[str, ...]:
    """Those bodies that motions would hit: round its contacts, or on the rest of its way where there are none."""
    bodies = placed(scene, state, names)
    for room in (CONTACT_ROOM, np.inf):
        sweeps = [sweep for motion in motions for sweep in motion_sweeps(scene, state, motion, room)]
        hit = nearest(sweeps, bodies, HAND_MIN_DISTANCE)
        if hit:
            return tuple(hit)
    return ()


def carried_by(scene: Scene, state: SceneState, name: str) -> tuple[str, ...]:
    """The bodies that would fall if a body were taken away."""
    found = []
    for other, body in scene.bodies.items():
        T = state.poses[other]
        if other == name or body.kind == BodyKind.FIXED:
            continue
        apart = set_distance(body_set(body), T, body_set(scene.bodies[name]), state.poses[name], 2 * PENETRATION)
        if apart > PENETRATION:
            continue
        around = placed_bodies(scene, state, other)
        poses = np.array([T + LIFT, T])
        left = tuple(b for b in around if b.name != name)
        if stable_poses(body, poses, around)[1] and not stable_poses(body, poses, left)[1]:
            found.append(other)
    return tuple(found)


def stacked_on(scene: Scene, state: SceneState, name: str) -> tuple[str, ...]:
    """The bodies that would fall if a body were taken away, and those that stand on these: from below to the top."""
    found: list[str] = []
    below = [name]
    while below:
        loads = [load for other in below for load in carried_by(scene, state, other)]
        below = [load for load in dict.fromkeys(loads) if load not in (name, *found)]
        found += below
    return tuple(found)
