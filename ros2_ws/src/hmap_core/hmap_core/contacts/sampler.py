"""The sampling half of Algorithm 3: contact candidates from an object's point cloud, best first."""

from collections.abc import Iterator

import numpy as np
from numba import njit

from hmap_core.collision.convex import ConvexSet, convex_set
from hmap_core.contacts import scoring
from hmap_core.contacts.camera import Cloud
from hmap_core.contacts.candidates import Candidates, Hand, Situation
from hmap_core.contacts.grasp import antipodal, grasps
from hmap_core.contacts.push import pushes
from hmap_core.contacts.solids import Solids, interval, outward_normal, solids
from hmap_core.contacts.spanning import antipodal_outside
from hmap_core.contacts.touch import touches
from hmap_core.deadline import check_time
from hmap_core.stability.mass import centre_of_mass
from hmap_core.transforms import IDENTITY, rotation_matrix
from hmap_core.types import Body, ContactPoint, TaskMode

# contacts handed out at a time
DEFAULT_BATCH = 256
# a measured point is moved onto the object's known surface from at most this far, m
SNAP = 0.008
# graspable regions are closed boxes up to rounding, m
REGION_TOLERANCE = 1e-6


@njit(cache=True, error_model="numpy", nogil=True)
def _snap(points, normals, reach, kind, R, p, size, planes, start):
    """Move points (N, 3) along their normals onto the solids, and take those' normals, in place; (N,) whether done."""
    done = np.zeros(points.shape[0], np.bool_)
    t = np.empty(2)
    for i in range(points.shape[0]):
        best, which = np.inf, -1
        origin = points[i] + reach * normals[i]
        for s in range(kind.shape[0]):
            interval(s, origin, -normals[i], kind, R, p, size, planes, start, t)
            if t[0] <= t[1] and -1e-9 <= t[0] < best:
                best, which = t[0], s
        if which >= 0 and best <= 2.0 * reach:
            points[i] = origin - best * normals[i]
            normals[i] = outward_normal(which, points[i], kind, R, p, size, planes, start)
            done[i] = True
    return done


def snapped(cloud: Cloud, own: Solids) -> Cloud:
    """The cloud on the object's known surface; points farther from it than SNAP are dropped."""
    points, normals = np.ascontiguousarray(cloud.points).copy(), np.ascontiguousarray(cloud.normals).copy()
    done = _snap(points, normals, SNAP, *own.arrays)
    return Cloud(points, normals, cloud.seen)[done]


def in_regions(points: np.ndarray, regions: tuple[np.ndarray, ...]) -> np.ndarray:
    """Whether points (N, 3) lie in one of the boxes (2, 3); no box allows every point."""
    if not regions:
        return np.ones(len(points), bool)
    tolerance = REGION_TOLERANCE
    return np.any(
        [np.all((points >= box[0] - tolerance) & (points <= box[1] + tolerance), axis=1) for box in regions], axis=0
    )


def candidates(
    body: Body,
    cloud: Cloud,
    hand: Hand,
    mode: TaskMode,
    situation: Situation,
    rng: np.random.Generator,
    spanning: bool = False,
) -> list[Candidates]:
    """Contacts of every kind that the mode allows: touches in kinematic tasks, grasps and pushes in physical ones.

    With ``spanning``, only grasps of physical tasks across a gap between two walls of the body.
    """
    if spanning and (mode == TaskMode.KINEMATIC or hand.gripper is None or len(body.shapes) < 2):
        return []
    check_time()
    own = solids([(shape, IDENTITY) for shape in body.shapes])
    shapes = convex_set(body.shapes)
    centre = centre_of_mass(shapes)
    radius = float((np.linalg.norm(shapes.center - centre, axis=1) + shapes.bound).max())
    cloud = snapped(cloud, own)
    cloud = cloud[in_regions(cloud.points, body.graspable)]
    if len(cloud) == 0:
        return []
    if mode == TaskMode.KINEMATIC:
        return [touches(cloud, centre, radius, hand, situation, rng)]
    check_time()
    sets = [] if spanning else [pushes(body, cloud, own, centre, radius, hand, situation, rng)]
    if hand.gripper is not None:

        def allowed(points: np.ndarray) -> np.ndarray:
            return in_regions(points, body.graspable)

        opposite = antipodal_outside if spanning else antipodal
        check_time()
        floor = _lowest(shapes, situation.T_world_obj)
        sets.append(grasps(cloud, own, centre, radius, hand, body.friction, allowed, situation, opposite, floor))
    return [s for s in sets if s is not None and len(s)]


def _lowest(shapes: ConvexSet, T_world_obj: np.ndarray) -> float:
    """Height of the lowest point of an object at T_world_obj (7,), m."""
    heights = shapes.vertices @ rotation_matrix(T_world_obj)[2]
    return float(T_world_obj[2] + (np.minimum.reduceat(heights, shapes.start[:-1]) - shapes.radius).min())


def sample_contacts(
    body: Body,
    cloud: Cloud,
    hand: Hand,
    mode: TaskMode,
    situation: Situation,
    rng: np.random.Generator,
    batch: int = DEFAULT_BATCH,
    spanning: bool = False,
    uniform: bool = False,
) -> Iterator[list[ContactPoint]]:
    """Contact points for one object, ranked, in batches; the geometry of the robot and the scene is not looked at.

    Args:
        body: the object; its shapes, friction and graspable regions are used.
        cloud: surface points in the object frame: :func:`hmap_core.contacts.camera.visible_points` or measured.
        hand: the closed fingers and the gripper, end-effector frame.
        mode: what a contact may do.
        situation: where the object is, where it goes next, where the robot stands.
        rng: the only source of randomness.
        batch: contacts per batch; the last may be shorter.
        spanning: only grasps across a gap between two walls of the body.
        uniform: in a random order instead of the best first.
    """
    sets = candidates(body, cloud, hand, mode, situation, rng, spanning)
    if not sets:
        return
    which, index = scoring.shuffled(sets, rng) if uniform else scoring.ordered(sets)
    for first in range(0, len(which), batch):
        part = slice(first, first + batch)
        made: dict[int, ContactPoint] = {}
        for k, candidate_set in enumerate(sets):
            places = np.flatnonzero(which[part] == k)
            made |= zip(places.tolist(), candidate_set.contacts(index[part][places]), strict=True)
        yield [made[place] for place in range(len(made))]
