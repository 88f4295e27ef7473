"""Where everything is in each phase of a skeleton: on what it hangs, or where it stands."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from hmap_core.exceptions import Code, InputError
from hmap_core.komo.skeleton import Skeleton, SkeletonEntry, Symbol
from hmap_core.komo.workspace import Workspace
from hmap_core.transforms import IDENTITY, inverse, multiply
from hmap_core.types import BodyKind, ContactPoint


@dataclass(frozen=True, eq=False)
class Place:
    """Where a frame is during some phases.

    Attributes:
        frame: number of the frame it hangs on, 0 for the world.
        T: (7,) its pose in that frame.
        robot: whose end-effector carries it; None for what stands.
        T_ee: (7,) its pose in that end-effector's frame; in the world for what stands.
    """

    frame: int
    T: np.ndarray
    robot: str | None
    T_ee: np.ndarray


class Timeline:
    """The places of a skeleton's frames in a workspace.

    Args:
        skeleton, workspace: whose.
        start: world poses (7,) of bodies that do not start where they are in the workspace's state.

    Attributes:
        start: world poses (7,) of all bodies at the start.
        handled: names of the bodies that are touched or carried.

    Raises:
        InputError: the skeleton names what the scene has not, or leaves open where something is.
    """

    def __init__(
        self, skeleton: Skeleton, workspace: Workspace, start: Mapping[str, np.ndarray] = MappingProxyType({})
    ):
        self.skeleton, self.workspace = skeleton, workspace
        self.start = {**workspace.state.poses, **start} if start else workspace.state.poses
        self._places: dict[tuple[str, int], Place] = {}
        self._contacts: dict[int, np.ndarray] = {}
        self._hung: dict[tuple, Place] = {}
        for entry in skeleton.entries:
            self._check(entry)
        held = [e.frames[1] for e in skeleton.of(Symbol.STABLE, Symbol.TOUCH)]
        self.handled = tuple(dict.fromkeys(held))

    def place(self, name: str, phase: int) -> Place:
        """Where a robot's end-effector or a body is in a phase (0: the first)."""
        robot = name in self.workspace.scene.robots
        key = name, 0 if robot else phase
        if key not in self._places:
            self._places[key] = self._robot(name) if robot else self._body(name, phase)
        return self._places[key]

    def runs(self, name: str) -> list[tuple[Place, range]]:
        """The places of a body, one after the other, each with its phases."""
        found: list[tuple[Place, range]] = []
        for phase in range(self.skeleton.phases):
            place = self.place(name, phase)
            if found and found[-1][0] is place:
                found[-1] = place, range(found[-1][1].start, phase + 1)
            else:
                found.append((place, range(phase, phase + 1)))
        return found

    def T_obj_manipulator(self, entry: SkeletonEntry) -> np.ndarray:
        """The pose (7,) of the manipulator in the object's frame that a touch or stable entry asks for."""
        key = id(entry)
        if key not in self._contacts:
            self._contacts[key] = self._contact(entry)
        return self._contacts[key]

    def _contact(self, entry: SkeletonEntry) -> np.ndarray:
        contact = self.skeleton.contact(entry)
        if contact is not None:
            return contact.T_obj_ee if isinstance(contact, ContactPoint) else np.asarray(contact, float)
        manipulator, name = entry.frames  # held from the start, as checked
        is_robot = manipulator in self.workspace.scene.robots
        T = self.workspace.T_world_ee(manipulator) if is_robot else self.start[manipulator]
        return multiply(inverse(self.start[name]), T)

    def _check(self, entry: SkeletonEntry) -> None:
        """That the frames are there and of the kind that the symbol needs."""
        robots, bodies = self.workspace.scene.robots, self.workspace.scene.bodies
        for name in entry.frames:
            if name not in robots and name not in bodies:
                known = ", ".join([*robots, *bodies])
                raise InputError(f"skeleton entry {entry}: no frame '{name}'; there are {known}", Code.UNKNOWN_OBJECT)
        first, last = entry.frames[0], entry.frames[-1]
        if entry.symbol in (Symbol.TOUCH, Symbol.STABLE):
            if last not in bodies or bodies[last].kind == BodyKind.FIXED:
                entry.reject(f"'{last}' is no body that can be moved")
            if first in bodies and bodies[first].kind == BodyKind.FIXED:
                entry.reject(f"'{first}' is fixed and no manipulator")
            contact = self.skeleton.contact(entry)
            if contact is None and (entry.symbol == Symbol.TOUCH or entry.phase0 > 0):
                entry.reject("no contact is given, and no touch begins it")
        if entry.symbol == Symbol.ABOVE and (first not in bodies or last not in bodies):
            entry.reject("needs two bodies")
        if entry.symbol == Symbol.HOME:
            for name in entry.frames:
                if name not in self.workspace.robots:
                    entry.reject(f"'{name}' is no robot that moves; there are {', '.join(self.workspace.robots)}")

    def _robot(self, name: str) -> Place:
        frame, T = self.workspace.end_effector(name)
        moves = name in self.workspace.robots
        return Place(frame, T, name if moves else None, IDENTITY if moves else T)

    def _body(self, name: str, phase: int, below: Iterable[str] = ()) -> Place:
        entry = self.skeleton.stable_on(name, phase)
        if entry is not None:
            return self._on(entry, phase, tuple(below))
        if phase == 0:
            T = self.start[name]
            return Place(0, T, None, T)
        released = self.skeleton.stable_on(name, phase - 1)
        if released is None:
            return self.place(name, phase - 1)
        placed = self._released_at(name, phase)
        if placed is None:
            released.reject(f"it ends before the skeleton does, and no pose_eq says where '{name}' is at phase {phase}")
        return Place(0, placed, None, placed)

    def _on(self, entry: SkeletonEntry, phase: int, below: tuple[str, ...]) -> Place:
        """The place of an object on its manipulator, which may be a tool that is held itself."""
        manipulator, name = entry.frames
        if manipulator in below:
            entry.reject("it hangs on itself")
        if manipulator in self.workspace.scene.robots:
            carrier = self.place(manipulator, phase)
        elif self.skeleton.stable_on(manipulator, phase) is None:
            entry.reject(f"nothing holds '{manipulator}' in phase {phase + 1}")
        else:
            carrier = self._body(manipulator, phase, (*below, name))
        key = id(entry), id(carrier)
        if key not in self._hung:
            T = inverse(self.T_obj_manipulator(entry))
            self._hung[key] = Place(carrier.frame, multiply(carrier.T, T), carrier.robot, multiply(carrier.T_ee, T))
        return self._hung[key]

    def _released_at(self, name: str, phase: int) -> np.ndarray | None:
        """World pose (7,) in which a pose_eq leaves an object at the end of the phases up to ``phase``."""
        for entry in self.skeleton.of(Symbol.POSE_EQ):
            if entry.frames[0] == name and entry.phase1 == phase:
                target = entry.target if entry.target.ndim == 1 else entry.target[-1]
                if len(entry.frames) == 1:
                    return target
                reference = self.place(entry.frames[1], phase - 1)
                if reference.frame == 0:
                    return multiply(reference.T, target)
        return None
