"""Objects that cameras see and that are not in the scene: their estimated shapes, tracked over pictures."""

import re
from dataclasses import dataclass, field

import numpy as np

from hmap.perception.pictures import Picture
from hmap_core import transforms
from hmap_core.contacts.cloud import cloud_from_depth
from hmap_core.contacts.estimate import estimate_body, track_body
from hmap_core.scenes.fields import NAME_PATTERN
from hmap_core.types import Body, Scene, ShapeKind

MOVED = 0.004  # m; smaller changes of an estimated position or size count as none


@dataclass
class DetectedObjects:
    """The objects in instance masks that are neither bodies nor robots of a scene.

    An object that a picture does not show, because an arm is in front of it, keeps its last pose. An object that is no
    longer in the segmentation's list of names is removed.

    Attributes:
        scene: the known bodies and robots.
        bodies: name -> the estimated body.
    """

    scene: Scene
    bodies: dict[str, Body] = field(default_factory=dict)
    _times: dict[str, float] = field(default_factory=dict)  # name -> time of the newest picture that showed it, s
    _points: dict[str, dict[str, tuple[float, np.ndarray]]] = field(default_factory=dict)  # name -> camera -> points

    def update(self, picture: Picture) -> bool:
        """Process a picture; whether an object has appeared, moved or disappeared.

        A picture is ignored for objects that a newer picture of another camera has shown.
        """
        known = self.scene.bodies.keys() | self.scene.robots.keys()
        names = {_name(name, number): number for name, number in picture.names.items() if name not in known}
        changed = False
        for name in self.bodies.keys() - names.keys():
            if picture.time >= self._times.get(name, -np.inf):
                del self.bodies[name]
                self._points.pop(name, None)
                self._times.pop(name, None)
                changed = True
        for name, number in names.items():
            changed |= self._track(name, picture, picture.mask == number)
        return changed

    def _track(self, name: str, picture: Picture, mask: np.ndarray) -> bool:
        if picture.time < self._times.get(name, -np.inf):
            return False
        world = transforms.IDENTITY  # the object has no frame of its own
        points = cloud_from_depth(picture.depth, mask, picture.intrinsics, picture.camera.pose, world).points
        seen = self._points.setdefault(name, {})
        seen[picture.camera.name] = (picture.time, points)
        all_points = np.concatenate([points for time, points in seen.values() if time == picture.time])
        known = self.bodies.get(name)
        body = track_body(known, all_points, picture.camera.pose[:3]) if known else None
        body = body or estimate_body(name, all_points, self._floor(all_points))
        if body is None:
            return False
        self._times[name] = picture.time
        if name in self.bodies and not _differs(self.bodies[name], body):
            return False
        self.bodies[name] = body
        return True

    def _floor(self, points: np.ndarray) -> float:
        """Height (m) of the highest box below the points that they could stand on; -inf without one."""
        if not len(points):
            return -np.inf
        middle, low = np.median(points, axis=0), points[:, 2].min()
        tops = [_top_under(body, middle[:2]) for body in self.scene.bodies.values()]
        return max((top for top in tops if top <= low + MOVED), default=-np.inf)


def _name(name: str, number: int) -> str:
    """The name of an object as a valid body name; segmentation can use any text."""
    return name if re.fullmatch(NAME_PATTERN, name) else f"thing_{number}"


def _top_under(body: Body, place: np.ndarray) -> float:
    """Height (m) of the top of a body's upright boxes at a point (2,); inf without one there."""
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
