"""Sub-trajectories one after the other: joined to one, or to a plan."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from hmap_core.planner.interfaces import SubTrajectory
from hmap_core.transforms import consistent
from hmap_core.types import BodyKind, Plan, Scene, SceneState, Trajectory


def scene_at(scene: Scene, state: SceneState) -> Scene:
    """The scene as it is in a state: what a plan that begins there starts from."""
    bodies = {name: replace(body, pose=state.poses[name]) for name, body in scene.bodies.items()}
    robots = {name: replace(robot, q=state.q[name]) for name, robot in scene.robots.items()}
    return replace(scene, bodies=bodies, robots=robots)


def state_after(state: SceneState, motion: SubTrajectory) -> SceneState:
    """The state at the end of a motion that began in ``state``."""
    after = state.copy()
    after.q.update({name: q[-1].copy() for name, q in motion.trajectory.joints.items()})
    after.gripper.update({name: float(opening[-1]) for name, opening in motion.trajectory.gripper.items()})
    after.poses.update({name: poses[-1].copy() for name, poses in motion.trajectory.objects.items()})
    return after


def joined(
    state: SceneState, motions: Sequence[SubTrajectory], robots: Iterable[str], bodies: Iterable[str]
) -> SubTrajectory:
    """One sub-trajectory from several, one after the other from ``state``; neighbours share a sample.

    Args:
        robots, bodies: whose samples it has; what does not move in one of the sub-trajectories stays where it is.
    """
    joints = {name: [state.q[name][None]] for name in robots}
    gripper = {name: [np.array([state.gripper[name]])] for name in robots}
    objects = {name: [state.poses[name][None]] for name in bodies}
    time, segments = [np.zeros(1)], []
    for motion in motions:
        own = motion.trajectory
        new = len(own.time) - 1
        start = time[-1][-1]
        for columns, parts in ((own.joints, joints), (own.gripper, gripper), (own.objects, objects)):
            for name, rows in parts.items():
                rows.append(columns[name][1:] if name in columns else np.repeat(rows[-1][-1:], new, 0))
        time.append(start + own.time[1:])
        segments += [replace(s, start=start + s.start, end=start + s.end) for s in motion.segments]
    trajectory = Trajectory(
        np.concatenate(time),
        {name: np.concatenate(rows) for name, rows in joints.items()},
        {name: np.concatenate(rows) for name, rows in gripper.items()},
        {name: consistent(np.concatenate(rows)) for name, rows in objects.items()},
    )
    return SubTrajectory(trajectory, tuple(segments))


def assemble(
    scene: Scene, state: SceneState, motions: Sequence[SubTrajectory], waypoints: np.ndarray, stats: dict
) -> Plan:
    """The plan that starts in ``state`` and goes through all motions."""
    movable = [name for name, body in scene.bodies.items() if body.kind != BodyKind.FIXED]
    whole = joined(state, motions, state.q, movable)
    return Plan(scene, whole.trajectory, whole.segments, waypoints, stats)
