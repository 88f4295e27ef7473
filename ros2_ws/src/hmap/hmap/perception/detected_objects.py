"""Things that cameras see and that nobody has told of: their shapes, followed from picture to picture."""

import re
from dataclasses import dataclass, field

import numpy as np

from hmap.perception.pictures import Picture
from hmap_core import transforms
from hmap_core.contacts.cloud import cloud_from_depth
from hmap_core.contacts.estimate import estimate_body, track_body
from hmap_core.scenes.fields import NAME_PATTERN
from hmap_core.types import Body, Scene, ShapeKind

MOVED = 0.004  # m; a thing whose estimated place or size changes less is where it was


@dataclass
class DetectedObjects:
    """The things in the instance masks that are neither bodies nor robots of a scene.

    A thing that a picture does not show, because an arm is in front of it, stays where it was seen last; one that the
    segmentation has no number for any more is gone.

    Attributes:
        bodies: name -> the estimated body.
    """

    scene: Scene
    bodies: dict[str, Body] = field(default_factory=dict)
    _points: dict[str, dict[str, tuple[float, np.ndarray]]] = field(default_factory=dict)  # name -> camera -> points

    def look(self, picture: Picture) -> bool:
        """Take in a picture; whether anything has appeared, moved or gone."""
        known = self.scene.bodies.keys() | self.scene.robots.keys()
        names = {_name(name, number): number for name, number in picture.names.items() if name not in known}
        changed = False
        for name in self.bodies.keys() - names.keys():
            del self.bodies[name]
            self._points.pop(name, None)
            changed = True
        for name, number in names.items():
            changed |= self._follow(name, picture, picture.mask == number)
        return changed

    def _follow(self, name: str, picture: Picture, mask: np.ndarray) -> bool:
        world = transforms.IDENTITY  # nothing is known of a frame of its own
        points = cloud_from_depth(picture.depth, mask, picture.intrinsics, picture.camera.pose, world).points
        seen = self._points.setdefault(name, {})
        seen[picture.camera.name] = (picture.time, points)
        together = np.concatenate([points for time, points in seen.values() if time == picture.time])
        known = self.bodies.get(name)
        body = track_body(known, together, picture.camera.pose[:3]) if known else None
        body = body or estimate_body(name, together, self._floor(together))
        if body is None or (name in self.bodies and not _differs(self.bodies[name], body)):
            return False
        self.bodies[name] = body
        return True

    def _floor(self, points: np.ndarray) -> float:
        """Height (m) of the highest box below the points on which they could stand; -inf where there is none."""
        if not len(points):
            return -np.inf
        middle, low = np.median(points, axis=0), points[:, 2].min()
        tops = [_top_under(body, middle[:2]) for body in self.scene.bodies.values()]
        return max((top for top in tops if top <= low + MOVED), default=-np.inf)


def _name(name: str, number: int) -> str:
    """The name of a thing as a body may have it; segmentation may call it anything."""
    return name if re.fullmatch(NAME_PATTERN, name) else f"thing_{number}"


def _top_under(body: Body, place: np.ndarray) -> float:
    """Height (m) of the upper side of a body's upright boxes at a place (2,); inf where it has none there."""
    tops = []
    for shape in body.shapes:
        T = transforms.multiply(body.pose, shape.pose)
        up = transforms.rotation_matrix(T)[2, 2]
        if shape.kind is not ShapeKind.BOX or up < 0.999:
            continue
        inside = transforms.apply(transforms.inverse(T), np.array([*place, T[2]]))
        if (np.abs(inside[:2]) <= 0.5 * np.array(shape.size[:2])).all():
            tops.append(T[2] + 0.5 * shape.size[2])
    return max(tops, default=np.inf)


def _differs(a: Body, b: Body) -> bool:
    if a.shapes[0].kind is not b.shapes[0].kind:
        return True
    size = np.abs(np.subtract(a.shapes[0].size, b.shapes[0].size)).max()
    return max(size, float(np.linalg.norm(a.pose[:3] - b.pose[:3]))) > MOVED
