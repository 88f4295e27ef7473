"""Joints of a robot description, and the tree that they form: paths, mimic relations, link frames."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from hmap_core.exceptions import Code, InputError
from hmap_core.transforms import to_matrix

MOVING = ("revolute", "continuous", "prismatic")
ASSUMED_FIXED = ("planar", "floating")


@dataclass(frozen=True)
class Joint:
    """A joint.

    Attributes:
        name, kind, parent, child: as in the URDF. Joints whose kind is not in :data:`MOVING` do not move.
        T_parent_joint: (7,) joint frame in the parent link.
        axis: (3,) unit vector, joint frame.
        lower, upper, velocity: limits, rad or m, and per s; infinite if the URDF has none.
        effort: limit, N m or N; None if the URDF has none, or 0.
        mimic: driving joint, multiplier and offset; None for an independent joint.
    """

    name: str
    kind: str
    parent: str
    child: str
    T_parent_joint: np.ndarray
    axis: np.ndarray
    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf
    effort: float | None = None
    mimic: tuple[str, float, float] | None = None

    @property
    def moves(self) -> bool:
        """Whether the joint can move."""
        return self.kind in MOVING

    def motion(self, value: float) -> np.ndarray:
        """Transform (4, 4) of the child link in the joint frame at a value (rad or m)."""
        T = np.eye(4)
        if self.kind == "prismatic":
            T[:3, 3] = value * self.axis
        elif self.kind in MOVING:
            x, y, z = self.axis
            K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            T[:3, :3] += np.sin(value) * K + (1.0 - np.cos(value)) * K @ K
        return T


@dataclass(frozen=True)
class JointTree:
    """The joints of a robot, by child link and by name. They form one tree."""

    by_child: dict[str, Joint]
    by_name: dict[str, Joint] = field(init=False)

    def __post_init__(self):
        object.__setattr__(self, "by_name", {joint.name: joint for joint in self.by_child.values()})

    def path(self, link: str, known: Collection[str] = ()) -> list[Joint]:
        """The joints from the root, or from the nearest of some known links above it, to a link."""
        path = []
        while link in self.by_child and link not in known:
            path.append(self.by_child[link])
            link = path[-1].parent
        return path[::-1]

    def driver(self, name: str) -> tuple[str, float, float]:
        """Resolves the mimic relations of a joint.

        Args:
            name: of the joint.

        Returns:
            The independent joint that drives it, the multiplier and the offset; itself, 1 and 0 if it is independent.

        Raises:
            InputError: INVALID_SCENE; it mimics a joint that does not exist, or itself.
        """
        if name in self._drivers:
            return self._drivers[name]
        seen = {name}
        while (mimic := self.by_name[name].mimic) is not None and mimic[0] in self.by_name and mimic[0] not in seen:
            name = mimic[0]
            seen.add(name)
        other = mimic[0] if mimic is not None else name
        problem = "follows it in turn" if other in self.by_name else "is not in the URDF"
        raise InputError(f"joint '{name}' mimics '{other}', which {problem}", Code.INVALID_SCENE)

    @cached_property
    def _drivers(self) -> dict[str, tuple[str, float, float]]:
        return mimic_relations(self.by_name)[0]

    def mimics(self, name: str) -> dict[str, tuple[float, float]]:
        """The joints that mimic a joint, directly or through others.

        Args:
            name: of the driving joint.

        Returns:
            Joint name -> multiplier and offset.

        Raises:
            InputError: INVALID_SCENE; a joint mimics one that does not exist, or itself.
        """
        found = {}
        for other in self.by_name:
            driver, factor, offset = self.driver(other)
            if driver == name and other != name:
                found[other] = factor, offset
        return found

    def value(self, name: str, values: Mapping[str, float]) -> float:
        """Value of a joint, rad or m.

        Args:
            name: of the joint.
            values: joint name -> value; other joints follow the joint that they mimic, or are at 0.

        Raises:
            InputError: INVALID_SCENE; it mimics a joint that does not exist, or itself.
        """
        if name in values:
            return values[name]
        driver, factor, offset = self.driver(name)
        return factor * values.get(driver, 0.0) + offset

    def pose(self, link: str, values: Mapping[str, float]) -> np.ndarray:
        """Pose of a link in the root frame.

        Args:
            link: the link.
            values: see :meth:`value`.

        Returns:
            (4, 4).

        Raises:
            InputError: INVALID_SCENE; a joint mimics one that does not exist, or itself.
        """
        T = np.eye(4)
        for joint in self.path(link):
            T = T @ to_matrix(joint.T_parent_joint) @ joint.motion(self.value(joint.name, values))
        return T


def mimic_relations(joints: Mapping[str, Joint]) -> tuple[dict[str, tuple[str, float, float]], list[list[str]]]:
    """Resolves all mimic relations.

    Args:
        joints: all joints, by name.

    Returns:
        For each joint the independent joint that drives it, the multiplier and the offset; joints that none drives are
        left out. And the names of the joints in each ring, in which each mimics the next one.
    """
    drivers: dict[str, tuple[str, float, float]] = {}
    rings: list[list[str]] = []
    lost: set[str] = set()
    for name in joints:
        followed: dict[str, tuple[str, float, float]] = {}
        while name in joints and name not in drivers and name not in lost and name not in followed:
            mimic = joints[name].mimic
            if mimic is None:
                drivers[name] = name, 1.0, 0.0
            else:
                followed[name], name = mimic, mimic[0]
        if name in followed:
            names = list(followed)
            rings.append(names[names.index(name) :])
        if name not in drivers:
            lost.update(followed)
            continue
        for mimicking, (mimicked, multiplier, constant) in reversed(followed.items()):
            driver, factor, offset = drivers[mimicked]
            drivers[mimicking] = driver, multiplier * factor, multiplier * offset + constant
    return drivers, rings


def loops(joints: Iterable[Joint]) -> list[list[Joint]]:
    """The loops that joints form, if each link is the child of one joint at most."""
    above = {joint.child: joint for joint in joints}
    found: list[list[Joint]] = []
    done: set[str] = set()
    for start in above:
        path: dict[str, None] = {}
        link = start
        while link in above and link not in done and link not in path:
            path[link] = None
            link = above[link].parent
        if link in path:
            around = list(path)
            found.append([above[child] for child in reversed(around[around.index(link) :])])
        done |= set(path)
    return found
