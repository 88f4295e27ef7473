"""Who keeps which distance from whom in which phase of a skeleton.

Links keep away from everything, at all times. What a skeleton says changes that for a few: a hand and the object it
touches may be as near in the phases around the contact as the contact has them; what hangs on a hand moves rigidly with
it; a carried object may be as near to what stands around as it is where it is taken and put down; an object above its
support touches it.
"""

import math
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from hmap_core.collision.convex import ConvexSet, set_distance
from hmap_core.collision.grown import GrownModel
from hmap_core.collision.scene_model import CollisionModel
from hmap_core.komo.manipulation import free_opening
from hmap_core.komo.min_distances import HELD_CLEARANCE, OBJECT_CLEARANCE, TOUCH_ALLOWANCE
from hmap_core.komo.skeleton import SkeletonEntry, Symbol
from hmap_core.komo.surroundings import Part
from hmap_core.komo.timeline import Place, Timeline
from hmap_core.transforms import IDENTITY, inverse, multiply
from hmap_core.types import ContactPoint


def mask(phases: Iterable[int]) -> int:
    """Bit mask of phases."""
    return sum(1 << k for k in phases)


def lowered(clearance: float, distance: float) -> float:
    """The minimum distance (m) of a pair that is asked to keep a clearance but has to come as near as ``distance``."""
    return clearance if distance >= clearance + TOUCH_ALLOWANCE else max(distance, 0.0) - TOUCH_ALLOWANCE


@dataclass(frozen=True)
class _Stay:
    """A handled body in one of its places."""

    name: str
    place: Place
    shapes: list[int]
    phases: int
    known: list[np.ndarray]  # world poses (7,) that it takes there for certain


class Clearances:
    """Builds the collision model of a timeline.

    Attributes:
        openings: of each moving robot's gripper, in which phases.
    """

    def __init__(self, timeline: Timeline):
        self._timeline, self._workspace, self._skeleton = timeline, timeline.workspace, timeline.skeleton
        self._above = {e.frames for e in self._skeleton.of(Symbol.ABOVE)}
        # contacts of a manipulator with an object, and the phases around them
        self._near: dict[tuple[str, ...], list[tuple[SkeletonEntry, int]]] = defaultdict(list)
        for entry in self._skeleton.of(Symbol.TOUCH, Symbol.STABLE):
            self._near[entry.frames].append((entry, mask(_around(entry, self._skeleton.phases))))
        self.openings = tuple((name, self._openings(name)) for name in self._workspace.robots)
        self._around = self._workspace.surroundings(frozenset(timeline.handled), self.openings)

    def model(self) -> CollisionModel:
        """The shapes and pairs of all phases."""
        if not self._timeline.handled:
            return self._around.model
        model = GrownModel(self._around.model)
        stays: list[_Stay] = []
        for body in self._timeline.handled:
            for stay in self._stays(model, body):
                self._keep_robots_away(model, stay)
                if stay.place.frame > 0:
                    self._keep_from_surroundings(model, stay)
                for other in stays:
                    self._keep_bodies_apart(model, stay, other)
                stays.append(stay)
        return model

    def _openings(self, name: str) -> tuple[tuple[float, int], ...]:
        """The openings of a gripper (m), each with the bit mask of the phases in which it has it."""
        robot = self._workspace.scene.robots[name]
        contacts = []  # first phase, last, while in contact, before and after
        for entry in self._skeleton.of(Symbol.TOUCH, Symbol.STABLE):
            contact = self._skeleton.contact(entry)
            if entry.frames[0] == name and isinstance(contact, ContactPoint):
                contacts.append((entry.phase0, entry.phase1, contact.opening, free_opening(robot, contact)))
        found: dict[float, int] = defaultdict(int)
        for k in range(self._skeleton.phases):
            closed = [c[2] for c in contacts if c[0] <= k and k + 1 <= c[1]]
            coming = sorted((c[0], c[3]) for c in contacts if c[0] > k)
            gone = sorted((c[1], c[3]) for c in contacts if c[1] <= k)
            free = coming[0][1] if coming else gone[-1][1] if gone else self._workspace.state.gripper[name]
            found[float(closed[0] if closed else free)] |= 1 << k
        return tuple(found.items())

    def _stays(self, model: CollisionModel, name: str) -> list[_Stay]:
        runs = self._timeline.runs(name)
        stays = []
        for k, (place, phases) in enumerate(runs):
            shapes = self._workspace.posed(name, place.T)
            speed = 1.0
            if place.robot is not None:
                speed = self._workspace.speed(place.robot, shapes)
            number = model.add_set(name, shapes, place.frame, speed)
            neighbours = [run[0].T for run in runs[max(0, k - 1) : k + 2] if run[0].frame == 0]
            stays.append(_Stay(name, place, number, mask(phases), neighbours + self._targets(name, phases)))
        return stays

    def _targets(self, name: str, phases: range) -> list[np.ndarray]:
        """World poses that a body is asked to take in some phases."""
        return [
            target
            for e in self._skeleton.of(Symbol.POSE_EQ)
            if e.frames == (name,) and phases.start < e.phase1 <= phases.stop
            for target in ([e.target] if e.target.ndim == 1 else e.target[[0, -1]])
        ]

    def _keep_robots_away(self, model: CollisionModel, stay: _Stay) -> None:
        for name, arm in self._around.arms.items():
            upper = arm.upper + (arm.base if stay.place.frame > 0 else ())
            model.keep_apart(upper, stay.shapes, OBJECT_CLEARANCE, stay.phases)
            if stay.place.frame == self._workspace.model.tip(name):
                continue
            self._keep_hand_away(model, name, stay, Part(arm.hand, arm.hand_set, stay.phases))
            for part in self._around.fingers[name] + self._around.linkages[name]:
                self._keep_hand_away(model, name, stay, part)

    def _keep_hand_away(self, model: CollisionModel, robot: str, stay: _Stay, part: Part) -> None:
        """Keeps a part of a hand away from a body, around its contacts as near as these have it."""
        left = part.phases & stay.phases
        for entry, around in self._near.get((robot, stay.name), ()):
            phases = left & around
            left &= ~around
            if phases:
                distance = self._at_contact(part, robot, entry)
                model.keep_apart(part.shapes, stay.shapes, lowered(OBJECT_CLEARANCE, distance), phases)
        if left:
            model.keep_apart(part.shapes, stay.shapes, OBJECT_CLEARANCE, left)

    def _at_contact(self, part: Part, robot: str, entry: SkeletonEntry) -> float:
        """How near the object is to a part of the hand at a contact (m), where that is near at all."""
        T_tip_ee = self._workspace.end_effector(robot)[1]
        T = multiply(T_tip_ee, inverse(self._timeline.T_obj_manipulator(entry)))
        return self._nearness(part.set, IDENTITY, entry.frames[1], T, OBJECT_CLEARANCE)

    def _nearness(self, shapes: ConvexSet, T_shapes, name: str, T: np.ndarray, clearance: float) -> float:
        """Distance (m) of some shapes at a pose from a body at one, exact where below the clearance."""
        own = self._workspace.shapes[name]
        return set_distance(shapes, T_shapes, own, T, clearance + TOUCH_ALLOWANCE)

    def _keep_from_surroundings(self, model: CollisionModel, stay: _Stay) -> None:
        own, cutoff = self._workspace.shapes[stay.name], HELD_CLEARANCE + TOUCH_ALLOWANCE
        nearest = self._around.nearest(own, stay.known, cutoff)
        far: list[int] = []
        for name, shapes in self._around.standing.items():
            if (stay.name, name) in self._above:
                model.keep_apart(stay.shapes, shapes, -TOUCH_ALLOWANCE, stay.phases)
            elif name in nearest:
                model.keep_apart(stay.shapes, shapes, lowered(HELD_CLEARANCE, nearest[name]), stay.phases)
            else:
                far += shapes
        model.keep_apart(stay.shapes, far, HELD_CLEARANCE, stay.phases)

    def _keep_bodies_apart(self, model: CollisionModel, a: _Stay, b: _Stay) -> None:
        """Two handled bodies, of which one at least moves."""
        left = a.phases & b.phases
        if a.name == b.name or not left or a.place.frame == b.place.frame:
            return
        if (a.name, b.name) in self._above or (b.name, a.name) in self._above:
            model.keep_apart(a.shapes, b.shapes, -TOUCH_ALLOWANCE, left)
            return
        for one, other in ((a, b), (b, a)):
            for entry, around in self._near.get((one.name, other.name), ()):
                if left & around:
                    d = self._apart(other.name, IDENTITY, one.name, self._timeline.T_obj_manipulator(entry))
                    model.keep_apart(a.shapes, b.shapes, lowered(HELD_CLEARANCE, d), left & around)
                    left &= ~around
        if left:
            still = [(one, other) for one, other in ((a, b), (b, a)) if other.place.frame == 0]
            distances = [self._apart(o.name, T, s.name, s.place.T) for o, s in still for T in o.known]
            model.keep_apart(a.shapes, b.shapes, lowered(HELD_CLEARANCE, min(distances, default=np.inf)), left)

    def _apart(self, a: str, T_a: np.ndarray, b: str, T_b: np.ndarray) -> float:
        return self._nearness(self._workspace.shapes[a], T_a, b, T_b, HELD_CLEARANCE)


def _around(entry: SkeletonEntry, phases: int) -> range:
    """The phases that share an instant with an entry."""
    return range(max(0, math.ceil(entry.phase0) - 1), min(phases, math.floor(entry.phase1) + 1))
