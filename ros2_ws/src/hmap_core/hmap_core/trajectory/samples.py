"""What a plan has at one of its samples: which sample an instant is, and where everything is at it."""

import numpy as np

from hmap_core.types import BodyKind, Plan, Scene, SceneState


def index_at(time: np.ndarray, t: float) -> int:
    """Index of the sample closest to an instant.

    Args:
        time: (N,) s, increasing.
        t: the instant, s.
    """
    after = int(np.searchsorted(time, t))
    if after == 0 or after == len(time):
        return min(after, len(time) - 1)
    return after if time[after] - t < t - time[after - 1] else after - 1


def state_at(plan: Plan, sample: int) -> SceneState:
    """Where a plan has everything at one of its samples; what it does not move is where its scene has it."""
    trajectory = plan.trajectory
    state = plan.scene.start_state()
    state.q.update({name: q[sample].copy() for name, q in trajectory.joints.items()})
    state.gripper.update({name: float(opening[sample]) for name, opening in trajectory.gripper.items()})
    state.poses.update({name: poses[sample].copy() for name, poses in trajectory.objects.items()})
    return state


def poses_at(plan: Plan, sample: int) -> dict[str, np.ndarray]:
    """The poses (7,) of the bodies that can move, at one of the samples of a plan."""
    poses = plan.trajectory.objects
    return {
        name: (poses[name][sample] if name in poses else plan.scene.bodies[name].pose).copy()
        for name in movable_bodies(plan.scene)
    }


def movable_bodies(scene: Scene) -> list[str]:
    """Names of the bodies that can move."""
    return [name for name, body in scene.bodies.items() if body.kind is not BodyKind.FIXED]
