"""Key frames: the few samples of a plan that tell what happens in it.

They are chosen by farthest-first traversal (Gonzalez, "Clustering to minimize the maximum intercluster distance",
1985): each differs most from those that were chosen before.
"""

import numpy as np

from hmap_core import transforms
from hmap_core.trajectory.samples import index_at
from hmap_core.types import BodyKind, Plan, Segment, SegmentKind

MOST, LEAST = 6, 4  # frames
SAME = 0.03  # m; a frame in which everything is this near to another frame tells nothing new
LEVER = 0.1  # m, by which an object's rotation counts as a motion
SWITCH = 0.15  # m, as which another robot, manipulator or object counts
ASIDE = 0.4  # share of its motion that counts for a body that is not the goal's object
PARTS = 4  # of a contact, at whose ends it may be shown; a tool is shown where it is picked and placed


def contacts(plan: Plan) -> list[Segment]:
    """The segments in which a manipulator touches an object."""
    return [segment for segment in plan.segments if segment.kind is not SegmentKind.TRANSIT]


def contact_at(plan: Plan, sample: int) -> Segment | None:
    """The contact at a sample; where one follows another, the later one."""
    time = plan.trajectory.time[sample] + 1e-9
    now = [s for s in contacts(plan) if s.start <= time and s.end + 2e-9 >= time]
    return max(now, key=lambda segment: segment.start, default=None)


def key_samples(plan: Plan, most: int = MOST) -> list[int]:
    """The samples of the key frames, in the order of time.

    Args:
        plan: the plan.
        most: number of frames at most; fewer if the plan has no more to tell.

    Returns:
        Indices of samples. The first contact's begin and the last one's end are among them.
    """
    samples = _candidates(plan)
    features = np.array([_feature(plan, k) for k in samples])
    modes = np.array([_mode(plan, k) for k in samples])
    chosen = [0, len(samples) - 1][: len(samples)]
    while len(chosen) < min(most, len(samples)):
        apart = np.array(
            [_apart(features[i] - features[chosen], modes[i] != modes[chosen]) for i in range(len(samples))]
        )
        best = int(apart.argmax())
        if apart[best] < SAME and len(chosen) >= LEAST or apart[best] == 0.0:
            break
        chosen.append(best)
    return sorted(samples[i] for i in chosen)


def _candidates(plan: Plan) -> list[int]:
    """Samples at which contacts begin, end and go on."""
    time = plan.trajectory.time
    goal, times = plan.scene.goal.object, []
    for segment in contacts(plan):
        tool = segment.object != goal and plan.scene.bodies[segment.contact_object].kind is BodyKind.TOOL
        times += np.linspace(segment.start, segment.end, 2 if tool else PARTS + 1).tolist()
    return sorted({index_at(time, t) for t in times}) or sorted({0, len(time) - 1})


def _feature(plan: Plan, sample: int) -> np.ndarray:
    """Positions and rotation matrices times LEVER of all bodies, (B, 12), m; those of the goal's object count more."""
    names = plan.trajectory.objects
    weights = np.array([1.0 if name == plan.scene.goal.object else ASIDE for name in names])
    poses = np.array([poses[sample] for poses in plan.trajectory.objects.values()]).reshape(-1, 7)
    turned = transforms.rotation_matrices(poses).reshape(-1, 9)
    return weights[:, None] * np.hstack([poses[:, :3], LEVER / np.sqrt(2.0) * turned])


def _mode(plan: Plan, sample: int) -> int:
    """A number that differs where another robot, manipulator or object takes part."""
    parts = [(s.robot, s.manipulator, s.object) for s in plan.segments]
    contact = contact_at(plan, sample)
    return -1 if contact is None else parts.index((contact.robot, contact.manipulator, contact.object))


def _apart(moved: np.ndarray, switched: np.ndarray) -> float:
    """How much a sample differs from the nearest of M others, by the motions (M, B, 12) of the bodies, m."""
    distance = np.linalg.norm(moved, axis=-1).max(axis=1, initial=0.0)
    return float((distance + SWITCH * switched).min())
