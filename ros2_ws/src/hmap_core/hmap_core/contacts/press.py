"""Presses: fingertips on the top of an object drag it over its support by friction.

The hand presses with a force N on the object of weight W. The support resists with mu_s (N + W), the fingertips drag
with at most mu_f N; so a press needs mu_f > mu_s. Both patches have an ellipsoidal limit surface (Howe & Cutkosky, IJRR
1996): the support's about the centre of pressure of N and W together, with the mean distance of the footprint's corners
as characteristic length; the fingertips' about their middle, with the mean distance of their ends. The friction of a
pair is the product of both coefficients.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from hmap_core.contacts import scoring
from hmap_core.contacts.access import on_face
from hmap_core.contacts.camera import Cloud
from hmap_core.contacts.candidates import CONTACT_GAP, Situation, frames, on_surface, tangents
from hmap_core.contacts.grasp_torque import GRAVITY
from hmap_core.contacts.grip_width import narrowest
from hmap_core.contacts.push import SlidingBody
from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.shapes import body_set
from hmap_core.transforms import apply, quaternions, rotation_matrices, rotation_matrix
from hmap_core.types import Body, ContactKind, ContactPoint, RobotModel

TOP = float(np.cos(np.deg2rad(5.0)))  # least upward part of the normal of a face that is pressed
FRICTION_SHARE = 0.8  # of the fingertips' friction that a press relies on
FORCES = (3.0, 4.5, 6.0, 8.0, 10.0, 13.0, 17.0, 22.0, 28.0)  # N, with which a hand presses; the least that serves
RESERVE = 1.25  # of the force over the least one
OPENINGS = (0.0, 0.5, 1.0)  # of the fingers, as shares of the gripper's range
TURNS = 8  # orientations of the hand about the vertical
POINTS = 60  # of the top that are tried
BEHIND = np.linspace(0.2, 1.0, 17)  # points behind the middle, as shares of the way to the edge, that are tried as well
PATCH = 3e-4  # m; vertices of the fingers this near to the foremost one press
EDGE = 0.002  # m that the patch stays inside the face, and above the support
TILT_EDGE = 0.005  # m that the centre of pressure stays inside the footprint
# An object must not tip where it jams: with this coefficient, whatever its own is. What a gripper could hold, and set
# upright again, is asked with a multiple of its own coefficient with the support only.
TIPPING_FRICTION = 1.0
TIPPING_RESERVE = 1.25
SAME_HEIGHT = 1e-3  # m between the object's lowest point and what carries it
PRESS_SCORE = 1.0  # score of a press at the centre of mass; it decreases with the force that is needed


@dataclass(frozen=True)
class SlidingSupport:
    """What an object slides on.

    Attributes:
        tops: polygons (n, 2) of level faces at the object's height, world frame, counter-clockwise.
        friction: the highest coefficient of their bodies; 0 if there are none.
    """

    tops: tuple[np.ndarray, ...]
    friction: float

    @staticmethod
    def of(body: Body, poses: np.ndarray, around: Sequence[Body]) -> "SlidingSupport":
        """The level faces below an object along poses (M, 7), of the bodies ``around`` at their own poses."""
        shapes = body_set(body)
        up = rotation_matrix(poses[0])[2]
        height = poses[0, 2] + float((shapes.vertices @ up - np.repeat(shapes.radius, np.diff(shapes.start))).min())
        reach = float(np.linalg.norm(shapes.center, axis=1).max() + shapes.bound.max())
        low, high = poses[:, :2].min(axis=0) - reach, poses[:, :2].max(axis=0) + reach
        tops, friction = [], 0.0
        for other in around:
            own = body_set(other)
            center, bound = apply(other.pose, own.center), own.bound + SAME_HEIGHT
            beside = np.maximum(low - center[:, :2], center[:, :2] - high).max(axis=1)
            for s in np.flatnonzero((np.abs(center[:, 2] - height) <= bound) & (beside <= bound)).tolist():
                points = apply(other.pose, own.hull(s))
                top = points[:, 2] + own.radius[s]
                face = _polygon(points[np.abs(top - height) <= SAME_HEIGHT, :2])
                if abs(top.max() - height) > SAME_HEIGHT or not len(face):
                    continue
                if (face.max(axis=0) < low).any() or (face.min(axis=0) > high).any():
                    continue
                tops.append(face)
                friction = max(friction, other.friction)
        return SlidingSupport(tuple(tops), friction)

    def below(self, points: np.ndarray) -> np.ndarray:
        """Whether one of the faces is below points (..., 2), EDGE inside it."""
        found = np.zeros(points.shape[:-1], bool)
        for face in self.tops:
            found |= _depth_inside(face, points) >= EDGE
        return found


class Press:
    """Fingertips on top of an object.

    Args:
        body: the object.
        model: of the robot that presses.
        support: what the object slides on.
        T_world_obj: (7,) its pose at the start.
    """

    def __init__(self, body: Body, model: RobotModel, support: SlidingSupport, T_world_obj: np.ndarray):
        self._body, self._model, self._support = body, model, support
        self._slide = SlidingBody(body, T_world_obj)
        self._finger = FRICTION_SHARE * body.friction * finger_friction(model)
        self._ground = body.friction * support.friction
        feet = self._slide.footprint
        self._outline = _polygon(np.concatenate(feet) - self._slide.middle) if feet else np.zeros((0, 2))
        width, gripper = narrowest(body), model.gripper
        holds = gripper is not None and width is not None and width <= gripper.max_opening
        tipping = min(TIPPING_FRICTION, TIPPING_RESERVE * self._ground) if holds else TIPPING_FRICTION
        self._height = tipping * (self._slide.top - self._slide.lowest)  # the lever of friction at the top

    @property
    def possible(self) -> bool:
        """Whether fingertips can drag the object at all, wherever they press: by its height and friction."""
        widest = 2.0 * np.linalg.norm(self._outline, axis=1).max(initial=0.0)  # pressed behind, it tips over the front
        low = widest >= self._height + 2.0 * TILT_EDGE
        return bool(low and self._support.tops and self._finger > self._ground)

    def sampled(self, cloud: Cloud, situation: Situation, rng: np.random.Generator) -> list[ContactPoint]:
        """Presses on the top of the object, without a force.

        Args:
            cloud: surface points, object frame.
            situation: the object's pose.
            rng: the only source of randomness.
        """
        gripper, slide = self._model.gripper, self._slide
        if gripper is None or self._model.attached is not None:
            return []
        top = np.flatnonzero(cloud.normals @ slide.up >= TOP)
        if not len(top):
            return []
        off = np.linalg.norm(cloud.points[top] @ slide.level.T[:, :2] - slide.middle, axis=1)
        near = top[np.argsort(off, kind="stable")]
        top = np.concatenate([near[: POINTS // 3], rng.permutation(near[POINTS // 3 :])[: POINTS - POINTS // 3]])
        middle, ahead = self._middle(cloud, near[0]), self._ahead(situation)
        edge = np.max(-(cloud.points[near] - middle) @ ahead)
        special = np.concatenate([middle[None], middle - np.outer(BEHIND * edge, ahead)])
        points = np.concatenate([special, cloud.points[top]])
        normals = np.concatenate([np.repeat(cloud.normals[near[:1]], len(special), axis=0), cloud.normals[top]])
        found = []
        for share in OPENINGS:
            opening = gripper.min_opening + share * (gripper.max_opening - gripper.min_opening)
            found += self._at(points, normals, opening, situation, ahead)
        return found

    def with_forces(self, contacts: Sequence[ContactPoint], poses: np.ndarray) -> list[tuple[ContactPoint, int]]:
        """Presses with the force that takes them farthest along poses (M, 7), and the last pose that they reach."""
        if not contacts or not self.possible:
            return []
        made = []
        limit = force_limit(self._model)
        forces = np.array([force for force in FORCES if force <= limit])
        serves = self._serves(contacts, poses, forces / RESERVE)  # (K, M - 1, F)
        lasting = np.cumprod(serves, axis=1).sum(axis=1)  # (K, F)
        for contact, reach in zip(contacts, lasting, strict=True):
            best = int(reach.argmax())  # the first one, so the least force
            if reach[best] > 0 or len(poses) == 1:
                made.append((_pressed(contact, float(forces[best])), int(reach[best])))
        return made

    def reach(self, contacts: Sequence[ContactPoint], poses: np.ndarray) -> np.ndarray:
        """Index (K,) of the last of poses (M, 7) to which each press drags the object with its own force."""
        if not self.possible:
            return np.zeros(len(contacts), int)
        forces = np.array([contact.force for contact in contacts])
        values, which = np.unique(forces, return_inverse=True)
        serves = self._serves(contacts, poses, values)[np.arange(len(contacts)), :, which]
        within = forces <= force_limit(self._model) + 1e-9
        return np.where(within, np.cumprod(serves, axis=1).sum(axis=1), 0)

    def _middle(self, cloud: Cloud, nearest: int) -> np.ndarray:
        """The point (3,) of the top above the centre of mass, in the plane of the top's point nearest to it."""
        slide, point = self._slide, cloud.points[nearest]
        return slide.centre + slide.up * ((point - slide.centre) @ slide.up)

    def _ahead(self, situation: Situation) -> np.ndarray:
        """Level direction (3,) of the first motion, object frame; the world's x axis where that is not known."""
        if situation.T_world_next is None:
            return self._slide.level[0]
        way = self._slide.level.T @ (situation.T_world_next[:3] - situation.T_world_obj[:3])
        way -= self._slide.up * (way @ self._slide.up)
        size = float(np.linalg.norm(way))
        return way / size if size > 0.0 else self._slide.level[0]

    def _at(
        self, points: np.ndarray, normals: np.ndarray, opening: float, situation: Situation, ahead: np.ndarray
    ) -> list[ContactPoint]:
        slide, tip = self._slide, load_arm(self._model).finger_vertices(opening)
        turns = 2.0 * np.pi * np.arange(TURNS) / TURNS
        index, turn = np.repeat(np.arange(len(points)), TURNS), np.tile(turns, len(points))
        points, normals = points[index], normals[index]
        first, second = tangents(normals, ahead)
        x = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
        R = frames(-normals, x)
        origin, _ = on_surface(R, points, normals, tip)
        patch = tip[tip[:, 2] >= tip[:, 2].max() - PATCH]
        on_top = np.ones(len(points), bool)
        for vertex in patch:
            place = origin + R @ vertex
            side = place - points - normals * np.einsum("ni,ni->n", place - points, normals)[:, None]
            side *= 1.0 + EDGE / np.maximum(np.linalg.norm(side, axis=1), EDGE)[:, None]
            on_top &= on_face(points, normals, side, np.ones(1), *slide.own.arrays) > 0.0
        kept = np.flatnonzero(on_top)
        radius = float(np.linalg.norm(np.concatenate(slide.footprint) - slide.middle, axis=1).max())
        score = PRESS_SCORE * scoring.central(points, slide.centre, radius) + scoring.W_NEAR * scoring.near(
            points, situation, radius
        )
        T = np.concatenate([origin, quaternions(R)], axis=1)
        return [
            ContactPoint(ContactKind.PRESS, T[k], points[k], normals[k], opening, DOWN, float(score[k])) for k in kept
        ]

    def _serves(self, contacts: Sequence[ContactPoint], poses: np.ndarray, forces: np.ndarray) -> np.ndarray:
        """Whether (K, M - 1, F) presses with some forces (F,) take the object along each step of poses (M, 7)."""
        slide, mu, W = self._slide, self._ground, self._body.mass * GRAVITY
        tips = [_patch(self._model, contact) for contact in contacts]
        at = np.array([tip.mean(axis=0) for tip in tips])
        lever = np.array([np.linalg.norm(tip - tip.mean(axis=0), axis=1).mean() for tip in tips])
        press = at @ slide.level.T[:, :2] - slide.middle  # (K, 2)
        share = forces / (forces + W)  # (F,)
        pressure = press[:, None] * share[:, None]  # (K, F, 2) centre of pressure
        corners = np.concatenate(slide.footprint) - slide.middle
        c2 = np.linalg.norm(corners[:, None, None] - pressure, axis=3).mean(axis=0) ** 2  # (K, F)
        steps = np.zeros((len(contacts), len(poses) - 1, len(forces)), bool)
        carried = self._carried(at, poses)
        for k, twists in enumerate(slide.twists(poses)):
            if twists is None:
                continue
            good = np.broadcast_to((carried[:, k] & carried[:, k + 1])[:, None], steps[:, k].shape)
            for vx, vy, w in twists:
                v = np.stack([vx - w * pressure[..., 1], vy + w * pressure[..., 0]], axis=-1)
                size = np.sqrt((v * v).sum(axis=-1) + c2 * w * w)
                size = np.where(size > 0.0, size, 1.0)
                total = mu * (forces + W)
                f, m = total[:, None] * v / size[..., None], total * c2 * w / size
                arm = pressure - press[:, None]
                torque = m + arm[..., 0] * f[..., 1] - arm[..., 1] * f[..., 0]
                needed = np.hypot(np.linalg.norm(f, axis=-1), torque / lever[:, None])
                lead = pressure + self._height * f / np.maximum(np.linalg.norm(f, axis=-1), _LEAST_FORCE)[..., None]
                good = good & (needed <= self._finger * forces)
                good = good & (_depth_inside(self._outline, lead) >= TILT_EDGE)
            steps[:, k] = good
        return steps

    def _carried(self, points: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Whether (K, M) the support is below points (K, 3) of the object at its poses (M, 7)."""
        R = rotation_matrices(poses)
        places = np.einsum("mij,kj->kmi", R[:, :2], points) + poses[None, :, :2]
        return self._support.below(places)


_LEAST_FORCE = 1e-9  # N
DOWN = np.array([0.0, 0.0, 1.0])  # approach, end-effector frame


def finger_friction(model: RobotModel) -> float:
    """Lateral Coulomb coefficient of a robot's fingers; 1 if it is not known."""
    return float(model.simulation.get("finger_friction", 1.0))


def force_limit(model: RobotModel) -> float:
    """Force (N) with which an arm presses at most: the weight of its payload, or the largest of FORCES."""
    return FORCES[-1] if model.payload is None else min(FORCES[-1], model.payload * GRAVITY)


def press_reach(
    body: Body, model: RobotModel, contacts: Sequence[ContactPoint], poses: np.ndarray, around: Sequence[Body]
) -> np.ndarray:
    """How far presses drag an object along a path without slipping.

    Args:
        body: the object.
        model: of the robot.
        contacts: K contacts on the object, with their forces.
        poses: (M, 7) T_world_obj.
        around: the other bodies, at their poses.

    Returns:
        (K,) index of the last pose that each press reaches; M - 1 for contacts that are no presses.
    """
    last = np.full(len(contacts), len(poses) - 1)
    own = [k for k, contact in enumerate(contacts) if contact.kind == ContactKind.PRESS]
    if own:
        press = Press(body, model, SlidingSupport.of(body, poses, around), poses[0])
        last[own] = press.reach([contacts[k] for k in own], poses)
    return last


def _pressed(contact: ContactPoint, force: float) -> ContactPoint:
    return replace(contact, force=force, score=contact.score - PRESS_SCORE * force / FORCES[-1])


def _patch(model: RobotModel, contact: ContactPoint) -> np.ndarray:
    """Vertices (n, 3) of the fingers that press in a contact, object frame."""
    tip = load_arm(model).finger_vertices(contact.opening)
    corners = apply(contact.T_obj_ee, tip)
    low = corners @ contact.normal
    return corners[low <= low.min() + PATCH + CONTACT_GAP]


def _polygon(points: np.ndarray) -> np.ndarray:
    """Counter-clockwise convex hull (n, 2) of points; empty if they span no area."""
    try:
        return points[ConvexHull(points).vertices]
    except (QhullError, ValueError):
        return np.zeros((0, 2))


def _depth_inside(polygon: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Distance (...) of points (..., 2) from the edges of a counter-clockwise polygon (n, 2), m; negative outside."""
    return edge_depths(polygon, points).min(axis=-1)


def edge_depths(polygon: np.ndarray, points: np.ndarray) -> np.ndarray:
    """How far (..., n) points (..., 2) are inside of each edge of a counter-clockwise polygon (n, 2), m."""
    before = np.roll(polygon, 1, axis=0)
    edge = polygon - before
    edge /= np.linalg.norm(edge, axis=1)[:, None]
    away = points[..., None, :] - before
    return edge[:, 0] * away[..., 1] - edge[:, 1] * away[..., 0]
