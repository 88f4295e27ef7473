"""The room that something takes up on its way, and who stands in it."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from hmap_core.collision.convex import ConvexSet, from_hulls, sets_nearest, transformed
from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.shapes import body_set
from hmap_core.planner.interfaces import SubTrajectory
from hmap_core.planner.resampling import by_change
from hmap_core.transforms import multiply_all, quaternions
from hmap_core.types import Robot, Scene, SceneState, SegmentKind

JOINT_STEP = 0.03  # rad a joint turns between two places that are looked at
OPENING_STEP = 0.005  # m, the same of a gripper's opening
OBJECT_STEP = 0.01, 0.05  # m, rad, the same of an object


@dataclass(frozen=True)
class Sweep:
    """Rigid shapes and the places (M, 7) in the world through which their frame goes."""

    shapes: ConvexSet
    places: np.ndarray


def joined(sets: Sequence[ConvexSet]) -> ConvexSet:
    """All shapes of several sets that share a frame."""
    if len(sets) < 2:
        return sets[0] if sets else from_hulls(())
    sizes = np.concatenate([np.diff(s.start) for s in sets])
    return ConvexSet(
        np.concatenate([s.vertices for s in sets]),
        np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        np.concatenate([s.radius for s in sets]),
        np.concatenate([s.center for s in sets]),
        np.concatenate([s.bound for s in sets]),
        tuple(edges for s in sets for edges in s.edges),
    )


def nearest(sweeps: Iterable[Sweep], bodies: Mapping[str, ConvexSet], cutoff: float) -> dict[str, float]:
    """How near (m) the sweeps come to bodies given in the world frame; only what is nearer than ``cutoff``."""
    if not bodies:
        return {}
    B = joined(list(bodies.values()))
    owner = np.repeat(range(len(bodies)), [len(shapes) for shapes in bodies.values()])
    best = np.full(len(bodies), cutoff)
    for sweep in sweeps:
        A = sweep.shapes
        sets_nearest(
            A.vertices, A.start, A.radius, A.center, A.bound, np.array(sweep.places),
            B.vertices, B.start, B.radius, B.center, B.bound, owner, best,
        )  # fmt: skip
    return {name: d for name, d in zip(bodies, best.tolist(), strict=True) if d < cutoff}


def placed(scene: Scene, state: SceneState, names: Iterable[str]) -> dict[str, ConvexSet]:
    """The shapes of bodies in the world frame."""
    return {name: transformed(body_set(scene.bodies[name]), state.poses[name]) for name in names}


def robot_sweeps(robot: Robot, q: np.ndarray, openings: np.ndarray, base: bool = False) -> list[Sweep]:
    """The links of a robot in its configurations (M, n), its gripper open by ``openings`` (M,); ``base``: the fixed
    ones too.

    Configurations that differ from the last by less than JOINT_STEP and OPENING_STEP are left out.
    """
    arm = load_arm(robot.model)
    moved = np.column_stack([q / JOINT_STEP, openings / OPENING_STEP])
    keep = by_change(moved)
    q, openings = q[keep], openings[keep]
    frames = [arm.frames(configuration) for configuration in q]
    R, p = (np.array(part) for part in zip(*frames, strict=True))
    sweeps = []
    for frame in range(0 if base else 1, arm.n + 1):
        hulls = [h for h in arm.hulls if h.frame == frame]
        in_base = np.concatenate([p[:, frame], quaternions(R[:, frame])], axis=1)
        places = multiply_all(robot.base_pose, in_base)
        fixed = [h for h in hulls if h.motion is None]
        if fixed:
            sweeps.append(Sweep(_link_set(fixed, 0.0), places))
        moving = [h for h in hulls if h.motion is not None]
        for opening in np.unique(openings) if moving else ():
            sweeps.append(Sweep(_link_set(moving, opening), places[openings == opening]))
    return sweeps


def _link_set(hulls, opening: float) -> ConvexSet:
    spheres = [h.sphere_at(opening) for h in hulls]
    vertices = [h.at(opening) for h in hulls]
    return ConvexSet(
        np.ascontiguousarray(np.concatenate(vertices)),
        np.concatenate([[0], np.cumsum([len(v) for v in vertices])]).astype(np.int64),
        np.array([h.radius for h in hulls]),
        np.array([center for center, _ in spheres]),
        np.array([bound for _, bound in spheres]),
        tuple(h.edges for h in hulls),
    )


def motion_sweeps(scene: Scene, state: SceneState, motion: SubTrajectory, near: float = np.inf) -> list[Sweep]:
    """The robots and objects of a motion that begins in ``state``.

    Args:
        near: m; only while the end-effector is no farther from where it touches or lets go, or in contact.
    """
    trajectory = motion.trajectory
    sweeps = []
    for name, q in trajectory.joints.items():
        robot = scene.robots[name]
        chosen = _near(robot, q, motion, name, near)
        if chosen.any():
            sweeps += robot_sweeps(robot, q[chosen], trajectory.gripper.get(name, np.zeros(len(q)))[chosen])
    for name, poses in trajectory.objects.items():
        sweeps.append(object_sweep(scene, name, poses))
    return sweeps


def object_sweep(scene: Scene, name: str, poses: np.ndarray) -> Sweep:
    """A body along poses (M, 7) that it takes one after the other."""
    turn = 2.0 * poses[:, 3:] / OBJECT_STEP[1]
    return Sweep(body_set(scene.bodies[name]), poses[by_change(np.column_stack([poses[:, :3] / OBJECT_STEP[0], turn]))])


def _near(robot: Robot, q: np.ndarray, motion: SubTrajectory, name: str, near: float) -> np.ndarray:
    """Which samples (N,) of a robot count: see :func:`motion_sweeps`."""
    if np.isinf(near):
        return np.ones(len(q), bool)
    time, chosen = motion.trajectory.time, np.zeros(len(q), bool)
    tips = load_arm(robot.model).end_effectors(q)[:, :3]
    for segment in motion.segments:
        if segment.robot == name and segment.kind != SegmentKind.TRANSIT:
            held = (time >= segment.start) & (time <= segment.end)
            ends = tips[held][[0, -1]]
            chosen |= held | (np.linalg.norm(tips[:, None] - ends, axis=2).min(axis=1) <= near)
    return chosen
