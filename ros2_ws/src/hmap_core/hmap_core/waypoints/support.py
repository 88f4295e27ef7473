"""Stability of a body that slides on its support: its centre of mass has to stay above the contact polygon."""

from collections.abc import Sequence

import numpy as np
from numba import njit
from scipy.spatial import ConvexHull, QhullError

from hmap_core.collision.convex import ConvexSet
from hmap_core.stability.mass import centre_of_mass
from hmap_core.transforms import rotation_matrix
from hmap_core.waypoints.kernels import length, screw

# the body is stable if its centre of mass is this far inside the contact polygon, m
SUPPORT_MARGIN = 0.005
# vertices within this distance of the lowest (highest) one belong to the bottom (top) face, m
FACE_TOLERANCE = 1e-3
# step of the check along a motion, m of the farthest point's path
SUPPORT_STEP = 0.005
# polygons thinner than this carry no body, m
_THIN = 1e-6
# corners of the contact polygon that are collected before they are reduced to their hull
_CONTACT = 640
# pairs of a foot and a top from which on the check tries the outline of the feet first
_MANY_PAIRS = 8


def _polygon(points: np.ndarray) -> np.ndarray:
    """Counter-clockwise convex hull (n, 2); empty if the points span no area."""
    try:
        return points[ConvexHull(points).vertices]
    except (QhullError, ValueError):
        return np.zeros((0, 2))


def _face(hull: np.ndarray, radius: float, top: bool, height: float) -> np.ndarray:
    """The part (n, 2) of a shape's top or bottom face at a height; empty if it is not flat there."""
    z = hull[:, 2] + radius if top else hull[:, 2] - radius
    return _polygon(hull[np.abs(z - height) <= FACE_TOLERANCE, :2])


def feet(body: ConvexSet, R: np.ndarray) -> tuple[list[np.ndarray], float]:
    """The faces that a body stands on.

    Args:
        body: its shapes.
        R: (3, 3) rotation from the body frame to level axes.

    Returns:
        Polygons (n, 2) in level axes, m, and their height relative to the body's origin, m.
    """
    hulls = [(body.hull(k) @ R.T, body.radius[k]) for k in range(len(body))]
    lowest = float(min(h[:, 2].min() - r for h, r in hulls))
    faces = [_face(h, r, False, lowest) for h, r in hulls]
    return [f for f in faces if len(f) >= 3], lowest


@njit(cache=True, error_model="numpy", nogil=True)
def _clip(subject, count, window, out, spare):
    """Intersection of convex counter-clockwise polygons into ``out`` (Sutherland & Hodgman 1974); returns its size."""
    n = count
    for i in range(n):
        out[i] = subject[i]
    for k in range(window.shape[0]):
        ax, ay = window[k - 1, 0], window[k - 1, 1]
        ex, ey = window[k, 0] - ax, window[k, 1] - ay
        m = 0
        for i in range(n):
            px, py = out[i - 1, 0] if i else out[n - 1, 0], out[i - 1, 1] if i else out[n - 1, 1]
            qx, qy = out[i, 0], out[i, 1]
            dp = ex * (py - ay) - ey * (px - ax)
            dq = ex * (qy - ay) - ey * (qx - ax)
            if (dp < 0.0) != (dq < 0.0):
                t = dp / (dp - dq)
                spare[m, 0], spare[m, 1] = px + t * (qx - px), py + t * (qy - py)
                m += 1
            if dq >= 0.0:
                spare[m, 0], spare[m, 1] = qx, qy
                m += 1
        n = m
        for i in range(n):
            out[i] = spare[i]
    return n


@njit(cache=True, error_model="numpy", nogil=True)
def _surrounded(x, y, points, count, min_distance):
    """Whether (x, y) is ``min_distance`` inside the convex hull of points (count, 2); checks all supporting lines."""
    for i in range(count):
        for j in range(count):
            ex, ey = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
            length = np.sqrt(ex * ex + ey * ey)
            if length < _THIN:
                continue
            edge = True
            for k in range(count):
                if ex * (points[k, 1] - points[i, 1]) - ey * (points[k, 0] - points[i, 0]) < -_THIN * length:
                    edge = False
                    break
            if edge and ex * (y - points[i, 1]) - ey * (x - points[i, 0]) < min_distance * length:
                return False
    return count >= 3


@njit(cache=True, error_model="numpy", nogil=True)
def _inside(x, y, polygon, min_distance):
    """Whether (x, y) is inside a convex counter-clockwise polygon, at least ``min_distance`` from its edges."""
    for k in range(polygon.shape[0]):
        ex, ey = polygon[k, 0] - polygon[k - 1, 0], polygon[k, 1] - polygon[k - 1, 1]
        if ex * (y - polygon[k - 1, 1]) - ey * (x - polygon[k - 1, 0]) < min_distance * np.sqrt(ex * ex + ey * ey):
            return False
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def _hull(points, count):
    """Move the corners of the convex hull of points[:count] (count, 2) to the front (Andrew 1979); returns how many."""
    if count < 3:
        return count
    order = np.argsort(points[:count, 1], kind="mergesort")
    order = order[np.argsort(points[:count, 0][order], kind="mergesort")]
    found = np.empty((2 * count, 2))
    n = 0
    for side in range(2):
        first = n
        for k in range(count):
            x, y = points[order[k if side == 0 else count - 1 - k]]
            while n - first >= 2 and (found[n - 1, 0] - found[n - 2, 0]) * (y - found[n - 2, 1]) <= (
                found[n - 1, 1] - found[n - 2, 1]
            ) * (x - found[n - 2, 0]):
                n -= 1
            found[n, 0], found[n, 1] = x, y
            n += 1
        n -= 1  # where one side ends the other one begins
    for k in range(n):
        points[k] = found[k]
    return n


@njit(cache=True, error_model="numpy", nogil=True)
def _carried(c, s, px, py, outline, tops, tops_start, boxes, contact):
    """Put the corners of the outline (n, 2) of all feet that stand on a top into ``contact``; returns how many.

    The hull of these corners is a part of the contact polygon.
    """
    count = 0
    for i in range(min(outline.shape[0], contact.shape[0])):
        x = c * outline[i, 0] - s * outline[i, 1] + px
        y = s * outline[i, 0] + c * outline[i, 1] + py
        for t in range(tops_start.shape[0] - 1):
            if boxes[t, 0] <= x <= boxes[t, 1] and boxes[t, 2] <= y <= boxes[t, 3]:
                if _inside(x, y, tops[tops_start[t] : tops_start[t + 1]], 0.0):
                    contact[count, 0], contact[count, 1] = x, y
                    count += 1
                    break
    return count


@njit(cache=True, error_model="numpy", nogil=True)
def _stable(yaw, px, py, com, feet, feet_start, tops, tops_start, outline, boxes, min_distance):
    """Whether the body, rotated by ``yaw`` and at (px, py), has its centre of mass above the contact polygon."""
    c, s = np.cos(yaw), np.sin(yaw)
    # a disc with the radius min_distance that is inside one foot and one top is inside the contact polygon
    standing = False
    for f in range(feet_start.shape[0] - 1):
        standing = standing or _inside(com[0], com[1], feet[feet_start[f] : feet_start[f + 1]], min_distance)
    x, y = c * com[0] - s * com[1] + px, s * com[0] + c * com[1] + py
    if standing:
        for t in range(tops_start.shape[0] - 1):
            if _inside(x, y, tops[tops_start[t] : tops_start[t + 1]], min_distance):
                return True
    most = np.diff(feet_start).max() if feet_start.shape[0] > 1 else 0
    foot = np.empty((most, 2))
    most += np.diff(tops_start).max() if tops_start.shape[0] > 1 else 0
    out, spare = np.empty((2 * most, 2)), np.empty((2 * most, 2))
    many = (feet_start.shape[0] - 1) * (tops_start.shape[0] - 1) > _MANY_PAIRS
    contact = np.empty((max(_CONTACT, 4 * most), 2))
    if many:
        count = _carried(c, s, px, py, outline, tops, tops_start, boxes, contact)
        if _surrounded(x, y, contact, count, min_distance):
            return True
    count = 0
    for f in range(feet_start.shape[0] - 1):
        n = feet_start[f + 1] - feet_start[f]
        left, right, low, high = np.inf, -np.inf, np.inf, -np.inf
        for i in range(n):
            u, v = feet[feet_start[f] + i, 0], feet[feet_start[f] + i, 1]
            foot[i, 0], foot[i, 1] = c * u - s * v + px, s * u + c * v + py
            left, right = min(left, foot[i, 0]), max(right, foot[i, 0])
            low, high = min(low, foot[i, 1]), max(high, foot[i, 1])
        for t in range(tops_start.shape[0] - 1):
            if many and (boxes[t, 0] > right or boxes[t, 1] < left or boxes[t, 2] > high or boxes[t, 3] < low):
                continue
            m = _clip(foot, n, tops[tops_start[t] : tops_start[t + 1]], out, spare)
            if count + m > contact.shape[0]:
                count = _hull(contact, count)
            if count + m > contact.shape[0]:
                break
            for i in range(m):
                contact[count] = out[i]
                count += 1
    if many:
        count = _hull(contact, count)
    return _surrounded(x, y, contact, count, min_distance)


@njit(cache=True, error_model="numpy", nogil=True)
def stable_along(T0, T1, reference, arm, com, feet, feet_start, tops, tops_start, outline, boxes):
    """Whether the body is stable at every SUPPORT_STEP of the motion from pose T0 to T1 (7,).

    Both poses are planar motions of ``reference``. ``arm`` is the distance in m of the body's farthest point from the
    axis of rotation.
    """
    axis = np.empty(3)
    steps = int(np.ceil(length(T0, T1, arm) / SUPPORT_STEP))
    yaw0 = screw(reference, T0, axis) * axis[2]
    turn = screw(T0, T1, axis) * axis[2]
    for k in range(steps + 1):
        t = k / max(steps, 1)
        px, py = T0[0] + t * (T1[0] - T0[0]), T0[1] + t * (T1[1] - T0[1])
        if not _stable(
            yaw0 + t * turn, px, py, com, feet, feet_start, tops, tops_start, outline, boxes, SUPPORT_MARGIN
        ):
            return False
    return True


class Support:
    """The flat tops that carry a body in planar motion.

    Args:
        body: in its own frame.
        carriers: vertices (n, 3), world frame, and radius of each shape that reaches up to the body's lowest point.
        reference: T_world_obj (7,); all poses to test are planar motions of it.

    Attributes:
        arrays: the arguments of ``stable_along``.
    """

    def __init__(self, body: ConvexSet, carriers: Sequence[tuple[np.ndarray, float]], reference: np.ndarray):
        tops = [_face(h, r, True, h[:, 2].max() + r) for h, r in carriers]
        R = rotation_matrix(reference)
        arm = float(np.linalg.norm((body.vertices @ R.T)[:, :2], axis=1).max())
        com = (R @ centre_of_mass(body))[:2].copy()
        standing, carrying = _packed(feet(body, R)[0]), _packed(tops)
        outline, boxes = _polygon(standing[0]), _extents(*carrying)
        self.arrays = (np.array(reference, float), arm, com, *standing, *carrying, outline, boxes)

    def is_stable(self, T: np.ndarray) -> bool:
        """Whether the body is stable at pose T (7,): its centre of mass is SUPPORT_MARGIN inside the contact
        polygon.
        """
        return self.is_stable_along(T, T)

    def is_stable_along(self, T0: np.ndarray, T1: np.ndarray) -> bool:
        """Whether the body is stable at every SUPPORT_STEP of the motion between two poses (7,), including both."""
        return bool(stable_along(T0, T1, *self.arrays))


def _packed(polygons: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    kept = [p for p in polygons if len(p) >= 3]
    start = np.concatenate([[0], np.cumsum([len(p) for p in kept])]).astype(np.int64)
    return (np.ascontiguousarray(np.concatenate(kept)) if kept else np.zeros((0, 2))), start


def _extents(points: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Lowest and highest x and y (n, 4) of polygons."""
    if len(points) == 0:
        return np.zeros((0, 4))
    low, high = (f.reduceat(points, start[:-1]) for f in (np.minimum, np.maximum))
    return np.ascontiguousarray(np.c_[low[:, 0], high[:, 0], low[:, 1], high[:, 1]])
