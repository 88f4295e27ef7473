"""The plan file as arrays: reads the dict and rejects files that cannot be judged.

``docs/validation.md`` lists the keys that are read.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from hmap_core.validation import limits
from hmap_core.validation.files import invalid_plan
from hmap_core.validation.reader import Reader

FORMAT = "hmap-plan"
VERSION = 1
MODES = ("kinematic", "physical")
BODY_KINDS = ("fixed", "movable", "tool")
CONTACT_KINDS = ("touch", "grasp", "push", "press")
SEGMENT_KINDS = ("transit", *CONTACT_KINDS)
SIZES = {"box": 3, "cylinder": 2, "sphere": 1, "capsule": 2, "mesh": 3}
SINGLE_SAMPLE_DURATION = 1.0  # s, duration over which a plan with one sample is judged
IDENTITY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True)
class ShapeData:
    """A convex shape; sizes as in the plan file.

    Attributes:
        kind: box, cylinder, sphere, capsule or mesh.
        size: as in the plan file, m; of a mesh the scale.
        pose: (7,) in the body frame.
        mesh: URI of the file of a mesh without vertices.
        vertices: (V, 3) of the hull of a mesh, before scaling.
    """

    kind: str
    size: tuple[float, ...]
    pose: np.ndarray
    mesh: str | None = None
    vertices: np.ndarray | None = None


@dataclass(frozen=True)
class BodyData:
    """A body of the scene."""

    name: str
    kind: str
    shapes: tuple[ShapeData, ...]
    pose: np.ndarray  # (7,) at the start
    friction: float
    mass: float = 0.0  # kg; 0 when the file does not say

    @property
    def fixed(self) -> bool:
        """Whether the body never moves."""
        return self.kind == "fixed"


@dataclass(frozen=True)
class GripperData:
    """A gripper. Joint i has the value ``at_zero[i] + travel * per_joint[i]``.

    Travel is the opening in metres. If ``openings`` (M,) are given, travel is i / (M - 1) at the i-th of them and
    linear in between.
    """

    joint_names: tuple[str, ...]
    per_joint: np.ndarray  # (k,)
    finger_links: tuple[str, ...]
    min_opening: float
    max_opening: float
    at_zero: np.ndarray  # (k,)
    openings: np.ndarray  # (M,), or (0,)
    force: float = np.inf  # N, of each pad; infinite when the file does not say
    speed: float = np.inf  # m/s, largest rate of the opening; infinite when the file does not say

    def travel(self, openings: np.ndarray) -> np.ndarray:
        """Travel (N,) at openings (N,) in m."""
        if len(self.openings) == 0:
            return openings
        return np.interp(openings, self.openings, np.linspace(0.0, 1.0, len(self.openings)))


@dataclass(frozen=True)
class RobotData:
    """A robot of the scene, at its base pose ``T_world_base`` (7,)."""

    name: str
    urdf: str
    base_pose: np.ndarray
    joint_names: tuple[str, ...]
    q_start: np.ndarray
    position_limits: np.ndarray  # (2, n)
    velocity_limits: np.ndarray  # (n,)
    acceleration_limits: np.ndarray  # (n,)
    end_effector_link: str
    T_link_ee: np.ndarray
    ignored_collisions: frozenset[frozenset[str]]
    gripper: GripperData | None
    finger_friction: float  # infinite when the file does not say
    payload: float = np.inf  # kg, of the arm; infinite when the file does not say


@dataclass(frozen=True)
class GoalData:
    """The goal: an object, its goal pose (7,), and tolerances in metres and radians."""

    object: str
    pose: np.ndarray
    position_tolerance: float
    rotation_tolerance: float


@dataclass(frozen=True)
class SegmentData:
    """A segment of the plan.

    Attributes:
        start, end: s.
        first, last: the samples nearest to these times.
        robot, manipulator: names.
        object: name of the object; None in transit.
        kind: ``transit`` or a contact kind.
        contact_pose: (7,) of the manipulator in the object frame; None in transit.
        force: N with which the manipulator of a press presses downwards; 0 for other kinds.
    """

    start: float
    end: float
    first: int
    last: int
    robot: str
    manipulator: str
    object: str | None
    kind: str
    contact_pose: np.ndarray | None
    force: float = 0.0

    @property
    def contact_object(self) -> str:
        """The object in contact.

        Raises:
            ValueError: the segment is a transit.
        """
        if self.object is None:
            raise ValueError(f"the {self.kind} segment of '{self.robot}' at {self.start:.3f} s has no object")
        return self.object


@dataclass(frozen=True)
class Document:
    """A plan file that can be judged."""

    mode: str
    bodies: dict[str, BodyData]
    robots: dict[str, RobotData]
    goal: GoalData
    time: np.ndarray  # (N,)
    dt: float
    joints: dict[str, np.ndarray]  # robot -> (N, n)
    gripper: dict[str, np.ndarray]  # robot -> (N,)
    objects: dict[str, np.ndarray]  # body -> (N, 7), every body whose poses the file gives
    segments: tuple[SegmentData, ...]
    contacts: tuple[SegmentData, ...] = field(default=())  # the segments with contact
    removable: frozenset[str] | None = None  # bodies that may be moved out of the way; None when the file does not say


def _not_negative(value: float) -> bool:
    return value >= 0.0


def no_limit() -> None:
    """Take all the time it needs."""


def _shape(reader: Reader, check_time: Callable[[], object]) -> ShapeData:
    check_time()
    kind = reader.get("shape").text(tuple(SIZES))
    size = reader.get("size")
    numbers = (size.value,) if isinstance(size.value, int | float) else size.value
    values = Reader(numbers, size.where).array((SIZES[kind],))
    low, high = limits.SIZES
    if kind != "mesh" and not np.all((values >= low) & (values <= high)):
        size.fail(f"sizes are from {low:g} to {high:g} m")
    if not np.all(values > 0.0):
        size.fail("positive numbers are needed")
    given = reader.find("vertices") if kind == "mesh" else None
    vertices = None if given is None else given.array((None, 3))
    mesh = reader.get("mesh").text() if kind == "mesh" and vertices is None else None
    pose = reader.find("pose")
    return ShapeData(kind, tuple(values.tolist()), IDENTITY if pose is None else pose.poses(), mesh, vertices)


def _body(reader: Reader, check_time: Callable[[], object]) -> BodyData:
    if reader.get("shape").text((*SIZES, "compound")) == "compound":
        shapes = tuple(_shape(part, check_time) for part in reader.get("parts").elements())
        if not shapes:
            reader.get("parts").fail("at least one part is needed")
    else:
        single = dict(reader.value)
        single.pop("pose", None)  # the pose of the body, not of the shape
        shapes = (_shape(Reader(single, reader.where), check_time),)
    friction, mass = reader.find("friction"), reader.find("mass")
    return BodyData(
        name=reader.get("name").text(),
        kind=reader.get("kind").text(BODY_KINDS),
        shapes=shapes,
        pose=reader.get("pose").poses(),
        friction=0.0 if friction is None else friction.number("zero or more", _not_negative),
        mass=0.0 if mass is None else mass.number("zero or more", _not_negative),
    )


def _per_joint(reader: Reader, count: int) -> np.ndarray:
    """One number for each of ``count`` joints, from a list or from a single number for all."""
    return reader.array((count,)) if isinstance(reader.value, list) else np.full(count, reader.number())


def _gripper(reader: Reader | None) -> GripperData | None:
    if reader is None:
        return None
    low, high, force = reader.find("min_opening"), reader.find("max_opening"), reader.find("force")
    speed = reader.find("speed")
    if not reader.get("finger_links").texts():
        reader.get("finger_links").fail("a gripper has at least one finger link")
    joint_names, at_zero, table = reader.get("joint_names").texts(), reader.find("at_zero"), reader.find("openings")
    openings = np.zeros(0) if table is None else table.array((None,))
    if table is not None and (len(openings) == 1 or np.any(np.diff(openings) <= 0.0)):
        table.fail("two or more increasing numbers are needed, or none")
    return GripperData(
        joint_names=joint_names,
        per_joint=_per_joint(reader.get("per_joint"), len(joint_names)),
        finger_links=reader.get("finger_links").texts(),
        min_opening=0.0 if low is None else low.number(),
        max_opening=np.inf if high is None else high.number(),
        at_zero=np.zeros(len(joint_names)) if at_zero is None else _per_joint(at_zero, len(joint_names)),
        openings=openings,
        force=np.inf if force is None else force.number("zero or more", _not_negative),
        speed=np.inf if speed is None else speed.number("zero or more", _not_negative),
    )


def _robot(name: str, reader: Reader) -> RobotData:
    joint_names = reader.get("joint_names").texts()
    n = len(joint_names)
    ignored = reader.find("ignored_collisions")
    pairs = [] if ignored is None else [pair.texts() for pair in ignored.elements()]
    simulation = reader.find("simulation")
    friction = None if simulation is None else simulation.find("finger_friction")
    payload = reader.find("payload")
    return RobotData(
        name=name,
        urdf=reader.get("urdf").text(),
        base_pose=reader.get("base_pose").poses(),
        joint_names=joint_names,
        q_start=reader.get("q_start").array((n,)),
        position_limits=reader.get("position_limits").array((2, n)),
        velocity_limits=reader.get("velocity_limits").array((n,)),
        acceleration_limits=reader.get("acceleration_limits").array((n,)),
        end_effector_link=reader.get("end_effector_link").text(),
        T_link_ee=reader.get("T_link_ee").poses(),
        ignored_collisions=frozenset(frozenset(pair) for pair in pairs),
        gripper=_gripper(reader.find("gripper")),
        finger_friction=np.inf if friction is None else friction.number("zero or more", _not_negative),
        payload=np.inf if payload is None else payload.number("zero or more", _not_negative),
    )


def _goal(reader: Reader, bodies: dict[str, BodyData]) -> GoalData:
    movable = tuple(name for name, body in bodies.items() if not body.fixed)
    return GoalData(
        object=reader.get("object").text(movable),
        pose=reader.get("pose").poses(),
        position_tolerance=reader.get("position_tolerance_m").number("zero or more", _not_negative),
        rotation_tolerance=reader.get("rotation_tolerance_rad").number("zero or more", _not_negative),
    )


def _removable(reader: Reader | None, bodies: dict[str, BodyData]) -> frozenset[str] | None:
    """Names of the removable bodies, from a table of placements or a list of names; None without the key."""
    if reader is None:
        return None
    names = reader.texts() if isinstance(reader.value, list) else [name for name, _ in reader.items()]
    for name in names:
        if name not in bodies:
            reader.fail(f"{name!r} is no body of the scene; there is {', '.join(bodies) or 'none'}")
    return frozenset(names)


def _times(reader: Reader) -> tuple[np.ndarray, float]:
    time = reader.array((None,))
    if len(time) == 0:
        raise invalid_plan(f"{reader.where}: no samples; at least one is needed")
    if len(time) == 1 and time[0] == 0.0:
        return time, SINGLE_SAMPLE_DURATION
    back = np.diff(time) <= 0.0
    if back.any():
        raise invalid_plan(f"{reader.where}: times must increase; sample {int(back.argmax()) + 1} does not")
    dt = time[-1] / max(len(time) - 1, 1)
    off = np.abs(time - dt * np.arange(len(time)))
    if off.max() > limits.TIME_UNIFORMITY * dt:
        k = int(off.argmax())
        raise invalid_plan(f"{reader.where}[{k}]: {time[k]:g} s; samples must be uniform from 0 (here {k * dt:g} s)")
    return time, float(dt)


def _check_known(readers: list[tuple[str, Reader]], allowed: dict, what: str) -> list[tuple[str, Reader]]:
    for name, reader in readers:
        if name not in allowed:
            raise invalid_plan(f"{reader.where}: no {what} of that name; there is {', '.join(allowed) or 'none'}")
    return readers


def _joints(reader: Reader, robots: dict[str, RobotData], N: int) -> dict[str, np.ndarray]:
    _check_known(reader.items(), robots, "robot")
    return {name: reader.get(name).array((N, len(robot.joint_names))) for name, robot in robots.items()}


def _openings(reader: Reader | None, robots: dict[str, RobotData], N: int) -> dict[str, np.ndarray]:
    given = {} if reader is None else dict(_check_known(reader.items(), robots, "robot"))
    openings = {}
    for name, robot in robots.items():
        if robot.gripper is not None and name not in given:
            raise invalid_plan(f"trajectory.gripper: no key {name!r}, and that robot has a gripper")
        openings[name] = given[name].array((N,)) if robot.gripper is not None else np.zeros(N)
    return openings


def _manipulators(robot: RobotData, bodies: dict[str, BodyData]) -> tuple[str, ...]:
    return (robot.end_effector_link, *(name for name, body in bodies.items() if body.kind == "tool"))


def _segment(reader: Reader, robots: dict, bodies: dict, dt: float, N: int) -> SegmentData:
    kind = reader.get("kind").text(SEGMENT_KINDS)
    start, end = reader.get("start").number(), reader.get("end").number()
    first, last = round(start / dt), round(end / dt)
    if not 0 <= first <= last <= N - 1:
        raise invalid_plan(
            f"{reader.where}: from {start:g} to {end:g} s; start before end, within 0 to {(N - 1) * dt:g} s"
        )
    contact = kind in CONTACT_KINDS
    robot = reader.get("robot").text(tuple(robots))
    movable = tuple(name for name, body in bodies.items() if not body.fixed)
    target = reader.get("object") if contact else reader.find("object")
    allowed = movable if contact else tuple(bodies)
    manipulator = reader.get("manipulator").text(_manipulators(robots[robot], bodies))
    name = None if target is None else target.text(allowed)
    if contact and name == manipulator:
        raise invalid_plan(f"{reader.where}: {name!r} is both the manipulator and the object")
    pose = reader.get("contact_pose").poses() if contact else None
    force = reader.get("force").number("more than 0 N", lambda value: value > 0.0) if kind == "press" else 0.0
    return SegmentData(start, end, first, last, robot, manipulator, name, kind, pose, force)


def _segments(reader: Reader, robots: dict, bodies: dict, dt: float, N: int) -> tuple[SegmentData, ...]:
    given = [_segment(element, robots, bodies, dt, N) for element in reader.elements()]
    segments = sorted((s for s in given if s.first < s.last), key=lambda s: s.first)  # without empty segments
    covered = 0
    busy: dict[str, int] = {}
    for segment in segments:
        if segment.first > covered:
            break
        if segment.first < busy.get(segment.robot, 0):
            raise invalid_plan(f"{reader.where}: robot {segment.robot!r} is in two segments at {segment.start:g} s")
        busy[segment.robot] = segment.last
        covered = max(covered, segment.last)
    if covered != N - 1:
        raise invalid_plan(f"{reader.where}: nothing covers the time after {covered * dt:g} s; no gaps are allowed")
    return tuple(segments)


def read(plan: dict, check_time: Callable[[], object] = no_limit) -> Document:
    """Reads a plan.

    Args:
        plan: the content of a plan file.
        check_time: called again and again; may raise to end it.

    Returns:
        The plan as arrays. A plan with one sample becomes one with two equal samples.

    Raises:
        InputError: INVALID_PLAN_FILE; a key is missing, a name is unknown, or a value has a wrong type, shape or range.
    """
    top = Reader(plan, "plan")
    top.get("format").text((FORMAT,))
    if top.get("version").number() != VERSION:
        top.get("version").fail(f"this judge reads version {VERSION}")
    mode = top.get("mode").text(MODES)
    listed = top.get("scene").get("bodies").elements()
    bodies = {body.name: body for body in (_body(reader, check_time) for reader in listed)}
    if len(bodies) != len(listed):
        raise invalid_plan("plan.scene.bodies: two bodies have the same name")
    robots = {name: _robot(name, reader) for name, reader in top.get("robots").items()}
    trajectory = top.get("trajectory")
    time, dt = _times(trajectory.get("time"))
    N = len(time)
    objects = _check_known(trajectory.get("objects").items(), bodies, "body")
    segments = _segments(top.get("segments"), robots, bodies, dt, N)
    document = Document(
        mode=mode,
        bodies=bodies,
        robots=robots,
        goal=_goal(top.get("goal"), bodies),
        time=time,
        dt=dt,
        joints=_joints(trajectory.get("joints"), robots, N),
        gripper=_openings(trajectory.find("gripper"), robots, N),
        objects={name: reader.poses((N,)) for name, reader in objects},
        segments=segments,
        contacts=tuple(s for s in segments if s.kind in CONTACT_KINDS),
        removable=_removable(top.get("scene").find("removable"), bodies),
    )
    return document if N > 1 else _two_samples(document)


def _two_samples(document: Document) -> Document:
    """Turns a plan with one sample into one with two equal samples."""

    def twice(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {name: np.repeat(array, 2, axis=0) for name, array in arrays.items()}

    return replace(
        document,
        time=np.array([0.0, document.dt]),
        joints=twice(document.joints),
        gripper=twice(document.gripper),
        objects=twice(document.objects),
    )
