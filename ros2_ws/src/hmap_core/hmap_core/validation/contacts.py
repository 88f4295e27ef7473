"""Contacts of a plan: contact segments, slip, and steps in which an object is touched."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from hmap_core.validation import limits, rigid
from hmap_core.validation.document import SegmentData
from hmap_core.validation.near import nearest_first
from hmap_core.validation.report import Findings, Kind
from hmap_core.validation.world import Part, State, World


@dataclass(frozen=True, eq=False)
class Contact:
    """An interval in which a manipulator touches an object.

    Attributes:
        world: the plan.
        segment: the segment of the plan that makes the contact; gives its times and samples.
        kind: contact kind: ``touch``, ``grasp`` or ``push``.
        object: the object.
        expected: (7,) pose of the manipulator in the object frame as the file gives it; None if it does not.
        tool_grasp: True for the grasp of a tool that implies the contact between tool and object.
        began: the sample since which the two have been in contact without a break, possibly through several segments.
    """

    world: World
    segment: SegmentData
    kind: str
    object: str
    expected: np.ndarray | None
    tool_grasp: bool = False
    began: int = 0

    @property
    def robot(self) -> str:
        """Name of the robot."""
        return self.segment.robot

    @property
    def by_tool(self) -> bool:
        """Whether a tool, and not the end effector, touches the object."""
        return not self.tool_grasp and self.segment.manipulator in self.world.document.bodies

    @property
    def window(self) -> slice:
        """The samples of the contact, including both ends."""
        return slice(self.segment.first, self.segment.last + 1)

    @property
    def manipulator(self) -> str:
        """Name of the manipulator in reports."""
        return self.segment.manipulator if self.by_tool else f"{self.robot}/{self.end_effector}"

    @property
    def end_effector(self) -> str:
        """Name of the robot's end-effector link."""
        return self.world.arms[self.robot].data.end_effector_link

    @property
    def bodies(self) -> tuple[str, str]:
        """Names of the manipulator and the object in reports."""
        return self.manipulator, self.object

    @cached_property
    def touching(self) -> dict[str, list[Part]]:
        """The parts that may touch the object, by owner: one entry for each finger, or one for the tool."""
        if self.by_tool:
            return {self.segment.manipulator: self.world.parts_of(self.segment.manipulator)}
        fingers = self.world.arms[self.robot].fingers()
        return {f"{self.robot}/{link}": self.world.parts_of(self.robot, (link,)) for link in fingers}

    def relative(self, state: State, window: slice) -> tuple[np.ndarray, np.ndarray]:
        """Pose of the manipulator frame in the object frame.

        Args:
            state: the world at some instants.
            window: the instants to evaluate.

        Returns:
            Rotations (n, 3, 3) and positions (n, 3).
        """
        if self.by_tool:
            R, p = state.bodies[self.segment.manipulator]
        else:
            R, p = self.world.arms[self.robot].end_effector(state.links[self.robot])
        Ro, po = state.bodies[self.object]
        return rigid.relative(Ro[window], po[window], R[window], p[window])

    @cached_property
    def gap(self) -> np.ndarray:
        """Contact gap (n,) at the samples of the contact, in metres.

        The gap is the distance of the farther finger of a grasp, and of the nearest part of a touch or push. It is
        measured at the first sample. Where that distance plus the motion since then is at most ``limits.CONTACT_GAP``,
        this upper bound replaces the measurement.
        """
        combine = np.max if self.kind == "grasp" and not self.by_tool else np.min
        first = self.segment.first
        owners = list(self.touching.values())
        gap = combine([self._nearest(parts, first)[0] + self._moved(parts) for parts in owners], axis=0)
        for i in np.flatnonzero(~(gap <= limits.CONTACT_GAP)):
            gap[i] = combine([self._nearest(parts, first + int(i))[0] for parts in owners])
        return gap

    def _moved(self, parts: list[Part]) -> np.ndarray:
        """Bound (n,) on the motion of the object's points since the first sample, relative to the touching parts, m."""
        self.world.check_time()
        state, samples, objects = self.world.state, self.window, self.world.parts_of(self.object)
        if not parts or not objects:
            return np.zeros(samples.stop - samples.start)
        (Ra, pa), (Rb, pb) = parts[0].place(state), state.bodies[self.object]
        R, p = rigid.relative(Ra[samples], pa[samples], Rb[samples], pb[samples])
        moved, turned = rigid.deviation(R, p, R[0], p[0])
        reach = 0.0
        for part in objects:
            self.world.check_time()
            reach = max(reach, part.reach)
        return moved + turned * reach

    def _nearest(self, parts: list[Part], k: int) -> tuple[float, tuple[Part, Part] | None]:
        """Distance (m) of some parts from the object at sample k, and the nearest two; distances of boxes say which
        pairs need no measurement.
        """
        tracks, objects = self.world.tracks, self.world.parts_of(self.object)
        best: tuple[float, tuple[Part, Part] | None] = (np.inf, None)
        if not parts or not objects:
            return best
        self.world.check_time()
        one, other = (np.array([self.world.number[part] for part in some], int) for some in (parts, objects))
        for bound, (i, j) in nearest_first(self.world, one, other, k):
            if bound > max(best[0], 0.0):  # boxes that overlap tell nothing
                break
            a, b = self.world.parts[i], self.world.parts[j]
            distance = self.world.gauge(a, b).distance(tracks[a].at(k), tracks[b].at(k))
            if distance < best[0]:
                best = distance, (a, b)
        return best

    def normals(self, k: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """The contact position and normal of each owner at sample k.

        Returns:
            For each owner, the point (3,) on the object and the unit normal (3,) into it, world frame.

        Raises:
            ValueError: the object, or what touches it, has no shape.
        """
        found = []
        for parts in self.touching.values():
            _, nearest = self._nearest(parts, k)
            if nearest is None:
                raise ValueError(f"'{self.object}' or what touches it has no shape")
            found.append(_witness(self.world, *nearest, k)[1:])
        return found


def _witness(world: World, a: Part, b: Part, k: int) -> tuple[float, np.ndarray, np.ndarray]:
    distance, _, point, normal = world.gauge(a, b).witness(world.tracks[a].at(k), world.tracks[b].at(k))
    return distance, point, normal


def collect(world: World) -> list[Contact]:
    """All contacts of a plan, by time. Each contact of a tool is followed by the robot's grasp of that tool."""
    contacts: list[Contact] = []
    for segment in world.document.contacts:
        contact = Contact(world, segment, segment.kind, segment.contact_object, segment.contact_pose)
        contacts.append(contact)
        if contact.by_tool:
            contacts.append(_tool_grasp(world, segment))
    return _linked(contacts)


def _linked(contacts: list[Contact]) -> list[Contact]:
    """The same contacts, each with the first sample of the unbroken sequence of contacts that it belongs to."""
    linked: list[Contact] = []
    for contact in contacts:
        key = contact.bodies, contact.segment.first
        before = next((c for c in linked if (c.bodies, c.segment.last) == key), None)
        linked.append(replace(contact, began=before.began if before else contact.segment.first))
    return linked


def _tool_grasp(world: World, segment: SegmentData) -> Contact:
    """The grasp of a tool during a segment: as in the robot's last segment whose object was the tool."""
    tool = segment.manipulator
    grasps = [s for s in world.document.contacts if (s.robot, s.object) == (segment.robot, tool)]
    earlier = [s for s in grasps if s.last <= segment.first]
    last = max(earlier, key=lambda s: s.last, default=None)
    kind = last.kind if last is not None else "touch"
    return Contact(world, segment, kind, tool, last.contact_pose if last else None, tool_grasp=True)


def worst(distances: np.ndarray, angles: np.ndarray) -> tuple[int, float, float]:
    """The largest deviation relative to its limit.

    Returns:
        The sample, the deviation and its limit: metres, or degrees if the rotation deviates more.
    """
    by_position = distances / limits.SLIP_POSITION
    by_rotation = angles / limits.SLIP_ROTATION
    k = int(np.maximum(by_position, by_rotation).argmax())
    if by_position[k] >= by_rotation[k]:
        return k, float(distances[k]), limits.SLIP_POSITION
    return k, float(np.degrees(angles[k])), float(np.degrees(limits.SLIP_ROTATION))


def _check_pose(contact: Contact, findings: Findings) -> None:
    """Checks the relative pose at the start of the contact, and its constancy at the samples and half-way between.

    The reference is the pose at the beginning of the unbroken contact, so slip cannot accumulate over short segments.
    """
    world, segment = contact.world, contact.segment
    R, p = contact.relative(world.state, contact.window)
    if contact.expected is not None:
        off = rigid.deviation(R[:1], p[:1], rigid.matrices(contact.expected[3:]), contact.expected[:3])
        _, amount, limit = worst(*off)
        findings.check(Kind.WRONG_CONTACT_POSE, contact.bodies, segment.start, amount, limit)
    steps = np.arange(segment.first, segment.last)
    R_half, p_half = contact.relative(world.between(steps, np.full(len(steps), 0.5)), slice(None))
    times = np.concatenate([world.document.time[contact.window], world.document.time[steps] + world.document.dt / 2])
    (R0,), (p0,) = contact.relative(world.state, slice(contact.began, contact.began + 1))
    off = rigid.deviation(np.concatenate([R, R_half]), np.concatenate([p, p_half]), R0, p0)
    k, amount, limit = worst(*off)
    findings.check(Kind.SLIP, contact.bodies, times[k], amount, limit)


def _check_gap(contact: Contact, findings: Findings) -> None:
    k = int(contact.gap.argmax())
    time = contact.world.document.time[contact.segment.first + k]
    findings.check(Kind.CONTACT_MISSING, contact.bodies, time, contact.gap[k], limits.CONTACT_GAP)


def _check_opposed(contact: Contact, findings: Findings) -> None:
    """Checks that the contact normals of the two fingers of a grasp are opposite."""
    if contact.kind != "grasp" or contact.by_tool or len(contact.touching) != 2 or contact.gap[0] > limits.CONTACT_GAP:
        return
    (_, normal_a), (_, normal_b) = contact.normals(contact.segment.first)
    angle = np.degrees(np.arccos(np.clip(-normal_a @ normal_b, -1.0, 1.0)))
    limit = np.degrees(limits.OPPOSITE_NORMALS)
    findings.check(Kind.GRASP_NOT_OPPOSED, contact.bodies, contact.segment.start, angle, limit)


def touched_steps(world: World, contacts: list[Contact], name: str) -> np.ndarray:
    """The steps in which a manipulator touches an object.

    Args:
        world: the plan.
        contacts: all contacts of the plan.
        name: the object.

    Returns:
        Mask (N-1,); true where the contact gap is within its limit at both ends of the step.
    """
    touched = np.zeros(world.samples - 1, bool)
    for contact in contacts:
        if contact.object == name:
            near = contact.gap <= limits.CONTACT_GAP
            touched[contact.segment.first : contact.segment.last] |= near[:-1] & near[1:]
    return touched


def runs(mask: np.ndarray) -> list[tuple[int, int]]:
    """Runs of true steps in a mask (N-1,), as (first sample, last sample)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def check(world: World, contacts: list[Contact], findings: Findings) -> None:
    """Reports missing contacts, slip, and contact poses that differ from the file."""
    for contact in contacts:
        _check_gap(contact, findings)
        _check_pose(contact, findings)
        _check_opposed(contact, findings)
