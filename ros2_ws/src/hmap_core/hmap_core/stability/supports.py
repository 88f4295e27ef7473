"""Measured poses, projected onto what the bodies stand on: noise neither sinks a body nor lets it hover or tilt.

A body that is measured within a few standard deviations of a level support stands on it: its resting face is made
horizontal, its height is that of the support, and what it penetrates sideways by no more than noise it is moved out of.
Place and turn about the vertical stay as measured, but for that. Bodies that are farther from everything are carried by
something, and stay as measured.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hmap_core.collision.convex import ConvexSet, convex_set, set_distance, transformed
from hmap_core.stability.mass import centre_of_mass
from hmap_core.stability.resting_faces import level_rotation, quaternion_of, resting_faces
from hmap_core.transforms import pose, quaternion_multiply, rotation_matrix
from hmap_core.types import BodyKind, Scene, SceneState

DEVIATIONS = 4.0  # standard deviations within which a difference is noise
MARKER_SPAN = 0.1  # m between a body's markers, by which noise of their positions becomes noise of the rotation
LEVEL = 0.9  # share of a step down by which the distance of a support shrinks
STEPS = 4  # of the iterations; each removes most of what is left
EXACT = 1e-6  # m
PROBE = 1e-4  # m, step of a difference quotient

Around = Sequence[tuple[ConvexSet, np.ndarray]]  # sets and their poses


def on_supports(scene: Scene, state: SceneState, noise: float) -> SceneState:
    """The state with every body that stands on something exactly there.

    Args:
        scene: with the bodies.
        state: as measured.
        noise: m, standard deviation of a measured position; 0: nothing is changed.
    """
    if noise <= 0.0:
        return state
    sets = {name: convex_set(body.shapes) for name, body in scene.bodies.items()}
    poses = dict(state.poses)
    movable = [name for name, body in scene.bodies.items() if body.kind is not BodyKind.FIXED and name in poses]
    done = [name for name, body in scene.bodies.items() if body.kind is BodyKind.FIXED and name in poses]
    for name in sorted(movable, key=lambda name: transformed(sets[name], poses[name]).vertices[:, 2].min()):
        around = [(sets[other], poses[other]) for other in done]
        poses[name] = _placed(sets[name], poses[name], around, DEVIATIONS * noise)
        done.append(name)
    return replace(state, poses=poses)


def _placed(own: ConvexSet, T: np.ndarray, around: Around, limit: float) -> np.ndarray:
    """A pose (7,) on the supports within ``limit`` (m); as measured where there are none."""
    near = [(other, place) for other, place in around if set_distance(own, T, other, place, limit) <= limit]
    standing = _lowered(own, _levelled(own, T, limit / MARKER_SPAN), near, limit)
    if standing is None:
        standing = _lowered(own, T, near, limit)  # leaning, or on something that is not level
    return T.copy() if standing is None else _moved_out(own, standing, near, limit)


def _levelled(own: ConvexSet, T: np.ndarray, limit: float) -> np.ndarray:
    """The pose with the resting face that is nearest to the ground horizontal; as it is where none is within a tilt."""
    R = rotation_matrix(T)
    faces = resting_faces(own, tuple(centre_of_mass(own).tolist()))
    normals = [R @ face.R.T @ np.array([0.0, 0.0, -1.0]) for face in faces]  # outwards, in the world
    downward = [normal for normal in normals if np.arccos(np.clip(-normal[2], -1.0, 1.0)) <= limit]
    if not downward:
        return T
    turn = quaternion_of(level_rotation(min(downward, key=lambda normal: float(normal[2]))))
    return pose(T[:3], quaternion_multiply(turn, T[3:]))


def _lowered(own: ConvexSet, T: np.ndarray, near: Around, limit: float) -> np.ndarray | None:
    """The pose at the height at which it touches a support below; None where none is within ``limit`` (m)."""
    standing = T.copy()
    for _ in range(STEPS):
        below = _heights(own, standing, near, limit)
        if not below:
            return None
        standing[2] -= min(below)
        if abs(standing[2] - T[2]) > limit:
            return None
        if abs(min(below)) <= EXACT:
            break
    return standing


def _heights(own: ConvexSet, T: np.ndarray, near: Around, limit: float) -> list[float]:
    """How far (m) a body is above what it may stand on: distances that shrink as it goes down."""
    lower, found = T - limit * np.eye(7)[2], []
    for other, place in near:
        here = set_distance(own, T, other, place)
        if here <= limit and here - set_distance(own, lower, other, place) >= LEVEL * limit:
            found.append(here)
    return found


def _moved_out(own: ConvexSet, T: np.ndarray, near: Around, limit: float) -> np.ndarray:
    """The pose without penetrations sideways that are no deeper than ``limit`` (m)."""
    T = T.copy()
    for _ in range(STEPS):
        inside = [
            (depth, other, place) for other, place in near if (depth := set_distance(own, T, other, place)) < -EXACT
        ]
        if not inside:
            break
        depth, other, place = min(inside, key=lambda entry: entry[0])
        away = np.array([set_distance(own, T + PROBE * axis, other, place) - depth for axis in np.eye(7)[:2]]) / PROBE
        if depth < -limit or np.linalg.norm(away) < 1.0 - LEVEL:
            break
        T[:2] -= depth * away / np.linalg.norm(away)
    return T
