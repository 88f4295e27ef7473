"""Who keeps which distance from whom in which phase of a skeleton.

This is the only place that says so; planner, contact checks and benchmark all build their collision models here.

Links keep away from everything, at all times. What a skeleton says changes that for a few:

- A hand comes nearer to the object in the phases around a contact. A contact of known kind and opening (a
  ``ContactPoint``) gives the minimum distance by its kind: fingers that touch may be TOUCH_ALLOWANCE inside, everything
  else keeps OBJECT_CLEARANCE. Such distances are alike for all contacts that open alike, which share collision models.
  A contact given as a bare pose lowers the minimum distances to what the hand has there.
- What hangs on a hand moves rigidly with it. A second hand that grasps it for whole phases does, too.
- A carried object may be as near to what stands around as it is where it is picked and placed. Where its pose is
  prescribed at every step, this counts in verification only (VERIFIED_ONLY): that path was planned free.
- An object above its support touches it.
"""

import math
from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from hmap_core.collision.boxes import near_path
from hmap_core.collision.convex import ConvexSet, set_distance
from hmap_core.collision.grown import GrownModel
from hmap_core.collision.scene_model import CollisionModel
from hmap_core.deadline import check_time
from hmap_core.komo.min_distances import HELD_CLEARANCE, OBJECT_CLEARANCE, TOUCH_ALLOWANCE
from hmap_core.komo.segment import free_opening
from hmap_core.komo.skeleton import MAX_PHASES, SkeletonEntry, Symbol
from hmap_core.komo.surroundings import Part
from hmap_core.komo.timeline import Place, Timeline
from hmap_core.transforms import IDENTITY, inverse, multiply
from hmap_core.types import ContactKind, ContactPoint

MANY_PAIRS = 5_000  # of shapes, above which only those are made that come near each other on a known path
BESIDE_PATH = 0.03  # m; motions leave the path of their object by less, and clearances are less
VERIFIED_ONLY = 1 << MAX_PHASES  # bit of the pairs that count where paths are verified, beside those of the phases


def mask(phases: Iterable[int]) -> int:
    """Bit mask of phases."""
    return sum(1 << k for k in phases)


def lowered(clearance: float, distance: float) -> float:
    """The minimum distance (m) of a pair that is asked to keep a clearance but has to come as near as ``distance``."""
    return clearance if distance >= clearance + TOUCH_ALLOWANCE else max(distance, 0.0) - TOUCH_ALLOWANCE


@dataclass(frozen=True)
class _Stay:
    """A handled body in one of its places.

    Attributes:
        phases: bit mask of the phases in which it is there.
        known: world poses (7,) that it takes there for certain.
        prescribed: whether its pose is given at every step, while something carries it.
        shapes: its numbers in the model, once it was added.
    """

    name: str
    place: Place
    phases: int
    known: list[np.ndarray]
    prescribed: bool
    shapes: tuple[int, ...] = ()


class Clearances:
    """Builds the collision model of a timeline.

    Args:
        timeline: what is where in which phase.
        paths: dense poses (K, 7) along which bodies are carried, where they are known and prescribed. Of bodies of many
            parts only the pairs are made that come near each other there.

    Attributes:
        openings: of each moving robot's gripper, in which phases.
        around: the moving robots among what stands around, without the handled bodies.
    """

    def __init__(self, timeline: Timeline, paths: Mapping[str, np.ndarray] = MappingProxyType({})):
        self._paths = paths
        self._timeline, self._workspace, self._skeleton = timeline, timeline.workspace, timeline.skeleton
        self._above = {e.frames for e in self._skeleton.of(Symbol.ABOVE)}
        # contacts of a manipulator with an object, and the phases around them
        self._near: dict[tuple[str, ...], list[tuple[SkeletonEntry, int]]] = defaultdict(list)
        for entry in self._skeleton.of(Symbol.TOUCH, Symbol.STABLE):
            self._near[entry.frames].append((entry, mask(_around(entry, self._skeleton.phases))))
        # phases in which a hand grasps an object that hangs on another one
        self._grasped: dict[tuple[str, ...], int] = defaultdict(int)
        for entry in self._skeleton.of(Symbol.TOUCH):
            contact = self._skeleton.contact(entry)
            if isinstance(contact, ContactPoint) and contact.kind == ContactKind.GRASP:
                self._grasped[entry.frames] |= mask(range(math.ceil(entry.phase0), math.floor(entry.phase1)))
        self.openings = tuple((name, self._openings(name)) for name in self._workspace.robots)
        self.around = self._workspace.surroundings(frozenset(timeline.handled), self.openings)

    def model(self, phases: Collection[int] | None = None, verified: bool = True) -> CollisionModel:
        """The shapes and pairs.

        Args:
            phases: only those that the handled bodies have in these phases; None: in all.
            verified: whether the pairs are wanted that count in verification only.
        """
        if not self._timeline.handled:
            return self.around.model
        model = GrownModel(self.around.model)
        wanted = mask(range(self._skeleton.phases) if phases is None else phases)
        found = [stay for body in self._timeline.handled for stay in self._stays(body) if stay.phases & wanted]
        stays: list[_Stay] = []
        for place in sorted(found, key=lambda stay: stay.place.frame > 0):  # what stands comes first
            stay = self._added(model, place)
            self._keep_robots_away(model, stay)
            if stay.place.frame > 0:
                self._keep_from_surroundings(model, stay, verified)
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

    def _stays(self, name: str) -> list[_Stay]:
        """The places of a body, one after the other."""
        runs = self._timeline.runs(name)
        found = []
        for k, (place, phases) in enumerate(runs):
            known = [run[0].T for run in runs[max(0, k - 1) : k + 2] if run[0].frame == 0]
            if k == 0 and place.frame > 0:  # it hangs on a hand from the start
                known.append(self._timeline.start[name])
            known = list({T.tobytes(): T for T in (*known, *self._targets(name, phases))}.values())
            prescribed = place.frame > 0 and self._skeleton.prescribes(name, phases)
            found.append(_Stay(name, place, mask(phases), known, prescribed))
        return found

    def _targets(self, name: str, phases: range) -> list[np.ndarray]:
        """World poses that a body is asked to take at the ends of some phases."""
        return [
            e.target if e.target.ndim == 1 else e.target[-1]
            for e in self._skeleton.of(Symbol.POSE_EQ)
            if e.frames == (name,) and phases.start < e.phase1 <= phases.stop
        ]

    def _added(self, model: CollisionModel, stay: _Stay) -> _Stay:
        """The same with its shapes added to the model."""
        check_time()
        shapes, place = self._workspace.posed(stay.name, stay.place.T), stay.place
        speed = 1.0 if place.robot is None else self._workspace.speed(place.robot, shapes)
        return replace(stay, shapes=tuple(model.add_set(stay.name, shapes, place.frame, speed)))

    def _keep_robots_away(self, model: CollisionModel, stay: _Stay) -> None:
        for name, arm in self.around.arms.items():
            links = arm.base + arm.upper if stay.place.frame > 0 else arm.upper
            model.keep_apart(links, stay.shapes, OBJECT_CLEARANCE, stay.phases)
            if stay.place.frame == self._workspace.model.tip(name):
                continue
            fingers, linkages = self.around.fingers[name], self.around.linkages[name]
            # an arm without fingers touches with its last link
            self._keep_hand_away(model, name, stay, Part(arm.hand, arm.hand_set, stay.phases), not fingers)
            for part in linkages:
                self._keep_hand_away(model, name, stay, part, False)
                self._keep_closed_linkage_away(model, name, stay, part)
            for part in fingers:
                self._keep_hand_away(model, name, stay, part, True)

    def _keep_hand_away(self, model: CollisionModel, robot: str, stay: _Stay, part: Part, touches: bool) -> None:
        """Keeps a part of a hand away from a body; around its contacts as the contact says.

        Args:
            touches: whether it is this part that touches in a contact.
        """
        left = part.phases & stay.phases & ~self._grasped.get((robot, stay.name), 0)
        found: dict[float, int] = defaultdict(int)
        for entry, around in self._near.get((robot, stay.name), ()):
            phases = left & around
            left &= ~around
            if phases:
                found[self._at_contact(part, robot, entry, touches)] |= phases
        if left:
            found[OBJECT_CLEARANCE] |= left
        for min_distance, phases in found.items():
            model.keep_apart(part.shapes, stay.shapes, min_distance, phases)

    def _keep_closed_linkage_away(self, model: CollisionModel, robot: str, stay: _Stay, part: Part) -> None:
        """Keeps what moves with a gripper away from the object while the gripper closes and opens round it."""
        for entry, around in self._near.get((robot, stay.name), ()):
            contact = self._skeleton.contact(entry)
            if isinstance(contact, ContactPoint) and contact.kind == ContactKind.GRASP:
                closed = mask(range(int(entry.phase0), int(entry.phase1)))
                phases = stay.phases & around & ~part.phases
                if closed & part.phases and phases:
                    model.keep_apart(part.shapes, stay.shapes, OBJECT_CLEARANCE, phases)

    def _at_contact(self, part: Part, robot: str, entry: SkeletonEntry, touches: bool) -> float:
        """The minimum distance (m) of a part of the hand from the object around a contact."""
        contact = self._skeleton.contact(entry)
        if isinstance(contact, ContactPoint):
            return -TOUCH_ALLOWANCE if touches and contact.kind != ContactKind.GRASP else OBJECT_CLEARANCE
        T_tip_ee = self._workspace.end_effector(robot)[1]
        T = multiply(T_tip_ee, inverse(self._timeline.T_obj_manipulator(entry)))
        return lowered(OBJECT_CLEARANCE, self._nearness(part.set, IDENTITY, entry.frames[1], T, OBJECT_CLEARANCE))

    def _nearness(self, shapes: ConvexSet, T_shapes, name: str, T: np.ndarray, clearance: float) -> float:
        """Distance (m) of some shapes at a pose from a body at one, exact where below the clearance."""
        own = self._workspace.shapes[name]
        return set_distance(shapes, T_shapes, own, T, clearance + TOUCH_ALLOWANCE)

    def _keep_from_surroundings(self, model: CollisionModel, stay: _Stay, verified: bool) -> None:
        own, standing = self._workspace.shapes[stay.name], self.around.standing
        if stay.prescribed:
            if verified:
                nearest = self.around.nearest(own, stay.known, HELD_CLEARANCE)
                near = self._near_path(stay)
                for name, shapes in standing.items():
                    min_distance = nearest.get(name, HELD_CLEARANCE) - TOUCH_ALLOWANCE
                    if near is None:
                        model.keep_apart(stay.shapes, shapes, min_distance, VERIFIED_ONLY)
                    else:
                        model.pairs.extend((a, b, min_distance, VERIFIED_ONLY) for a, b in near[name])
            return
        nearest = self.around.nearest(own, stay.known, HELD_CLEARANCE + TOUCH_ALLOWANCE)
        far: list[int] = []
        for name, shapes in standing.items():
            if (stay.name, name) in self._above:
                model.keep_apart(stay.shapes, shapes, -TOUCH_ALLOWANCE, stay.phases)
            elif name in nearest:
                model.keep_apart(stay.shapes, shapes, lowered(HELD_CLEARANCE, nearest[name]), stay.phases)
            else:
                far += shapes
        model.keep_apart(stay.shapes, far, HELD_CLEARANCE, stay.phases)

    def _near_path(self, stay: _Stay) -> dict[str, list[tuple[int, int]]] | None:
        """Pairs of a carried body's shapes with those of each standing body that come near each other on its path.

        None where there are few pairs, or where the path is not known.
        """
        own, path = self._workspace.shapes[stay.name], self._paths.get(stay.name)
        if path is None or len(own) * len(self.around.owner) <= MANY_PAIRS:
            return None
        numbers = np.array([s for shapes in self.around.standing.values() for s in shapes])
        found: dict[str, list[tuple[int, int]]] = {name: [] for name in self.around.standing}
        names = list(found)
        a, b = near_path(own, path, self.around.shapes, BESIDE_PATH).T
        pairs = np.column_stack([np.array(stay.shapes)[a], numbers[b]])
        for k in np.unique(self.around.owner[b]).tolist():
            found[names[k]] = [(one, other) for one, other in pairs[self.around.owner[b] == k].tolist()]
        return found

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
