"""The robots and bodies of a plan in motion: poses of all parts at the samples and between them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import coal
import numpy as np

from hmap_core.validation import arm, rigid
from hmap_core.validation.document import BodyData, Document, ShapeData, no_limit
from hmap_core.validation.geometry import Gauge, Solid, solid_of, transform
from hmap_core.validation.motion import BodyMotion, LinkMotion, Motion, RelativeMotion, relative


class OnDemand(dict[str, Any]):
    """A dict that computes a missing value from its key."""

    def __init__(self, make: Callable[[str], Any]):
        super().__init__()
        self._make = make

    def __missing__(self, key: str) -> Any:
        self[key] = value = self._make(key)
        return value


@dataclass(frozen=True)
class State:
    """Poses of links and bodies at M instants, computed on demand.

    Attributes:
        links: robot -> frames of its links.
        bodies: body -> rotations (M, 3, 3) and positions (M, 3).
    """

    links: Mapping[str, arm.Frames]
    bodies: Mapping[str, tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class Part:
    """A convex shape of a body or of a robot's link.

    Attributes:
        owner: the name in reports: of the body, or ``robot/link``.
        holder: the body or robot.
        link: the robot's link; None for a body.
        solid: the shape.
        R, p: (3, 3) and (3,) pose of the shape in the frame of its body or link.
    """

    owner: str
    holder: str
    link: str | None
    solid: Solid
    R: np.ndarray
    p: np.ndarray

    @property
    def robot_link(self) -> str:
        """The link of a robot's part.

        Raises:
            ValueError: it is a part of a body.
        """
        if self.link is None:
            raise ValueError(f"'{self.owner}' is a body and has no link")
        return self.link

    @cached_property
    def reach(self) -> float:
        """Largest distance of a point of the shape from the frame of its body or link, m."""
        return float(np.linalg.norm(self.solid.points @ self.R.T + self.p, axis=1).max()) + self.solid.ball

    def place(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (M, 3, 3) and positions (M, 3) of the part's body or link."""
        return state.bodies[self.holder] if self.link is None else state.links[self.holder][self.link]

    def frames(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (M, 3, 3) and positions (M, 3) of the shape."""
        R, p = self.place(state)
        if _still(R) and _still(p):
            R_shape, p_shape = rigid.apply(R[:1], self.R), p[:1] + rigid.apply(R[:1], self.p)
            return np.broadcast_to(R_shape, R.shape), np.broadcast_to(p_shape, p.shape)
        return rigid.apply(R, self.R), p + rigid.apply(R, self.p)


def _still(array: np.ndarray) -> bool:
    """Whether an array (M, ...) holds one value for all instants."""
    return array.strides[0] == 0


class Track:
    """Poses of a part at M instants, with coal transforms that are built on demand.

    Attributes:
        part: the part.
        R, p: its poses (M, 3, 3) and (M, 3).
        still: whether it is known not to move.
    """

    def __init__(self, part: Part, state: State):
        self.part = part
        self.R, self.p = part.frames(state)
        self.still = _still(self.R) and _still(self.p)
        self._transforms: dict[int, coal.Transform3s] = {}

    def at(self, k: int) -> coal.Transform3s:
        """The coal transform at instant k."""
        if k not in self._transforms:
            self._transforms[k] = transform(self.R[k], self.p[k])
        return self._transforms[k]


class AxisBoxes:
    """Boxes round parts at M instants, along the axes of the world.

    Args:
        tracks: poses of P parts.
        check_time: called for each; may raise to end it.

    Attributes:
        spans: lower and upper corners (M, 3) of the boxes of each part; (1, 3) of one that does not move.
    """

    def __init__(self, tracks: Sequence[Track], check_time: Callable[[], object] = no_limit):
        self.spans = [self._span(track, check_time) for track in tracks]
        counts = np.array([len(low) for low, _ in self.spans], int)
        self._first, self._step = np.cumsum(counts) - counts, np.minimum(counts - 1, 1)
        self._low, self._high = (
            np.concatenate([np.zeros((0, 3)), *corners]) for corners in zip(*self.spans, strict=True)
        )

    @staticmethod
    def _span(track: Track, check_time: Callable[[], object]) -> tuple[np.ndarray, np.ndarray]:
        check_time()
        count = 1 if track.still else len(track.p)
        R, p = track.R[:count], track.p[:count]
        center = p + rigid.apply(R, track.part.solid.center)
        half = rigid.apply(np.abs(R), track.part.solid.half)
        return center - half, center + half

    def at(self, numbers: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corners (n, 3) of the boxes of n parts, given by number, at instant k, m."""
        rows = self._first[numbers] + self._step[numbers] * k
        return self._low[rows], self._high[rows]


class World:
    """The robots and bodies of a plan in motion.

    Args:
        document: the plan.
        check_time: called again and again; may raise to end it.

    Attributes:
        document: the plan.
        check_time: as above.
        samples: number N of samples.
        arms: the robots by name.
        values: robot -> joint -> values (N,).
        poses: body -> poses (N, 7).
        state: poses at the samples.
        parts: all convex shapes.
        tracks: their poses at the samples.
    """

    def __init__(self, document: Document, check_time: Callable[[], object] = no_limit):
        self.document = document
        self.check_time = check_time
        self.samples = len(document.time)
        self.arms = {name: arm.build(robot) for name, robot in document.robots.items()}
        self.values = {n: a.values(document.joints[n], document.gripper[n]) for n, a in self.arms.items()}
        self.poses = {name: self._poses(body) for name, body in document.bodies.items()}
        self.state = State(
            {name: robot.frames(self.values[name]) for name, robot in self.arms.items()},
            {name: (_rotations(poses), poses[:, :3]) for name, poses in self.poses.items()},
        )
        self._links = {
            name: robot.motions(robot.tree.shaped, self.values[name], self.state.links[name])
            for name, robot in self.arms.items()
        }
        self._bodies = {name: BodyMotion.of(poses) for name, poses in self.poses.items()}
        self.parts = [*self._robot_parts(), *self._body_parts()]
        self.tracks = {part: self._track(part) for part in self.parts}
        self._relative: dict[tuple, RelativeMotion] = {}
        self._reaches: dict[tuple[str, str | None], float] = {}
        self._gauges: dict[tuple[Part, Part], Gauge] = {}

    def _poses(self, body: BodyData) -> np.ndarray:
        """Poses (N, 7); a body without a trajectory keeps its start pose."""
        given = self.document.objects.get(body.name)
        return np.broadcast_to(body.pose, (self.samples, 7)) if given is None else given

    def _track(self, part: Part) -> Track:
        self.check_time()
        return Track(part, self.state)

    def _robot_parts(self) -> list[Part]:
        return [
            Part(f"{name}/{shape.link}", name, shape.link, shape.solid, shape.R, shape.p)
            for name, robot in self.arms.items()
            for shape in robot.tree.shapes
        ]

    def _body_parts(self) -> list[Part]:
        return [
            Part(name, name, None, self._solid(shape), rigid.matrices(shape.pose[3:]), shape.pose[:3])
            for name, body in self.document.bodies.items()
            for shape in body.shapes
        ]

    def _solid(self, shape: ShapeData) -> Solid:
        self.check_time()
        return solid_of(shape)

    def parts_of(self, holder: str, links: tuple[str, ...] | None = None) -> list[Part]:
        """The parts of a body, or of some links of a robot.

        Args:
            holder: the body or robot.
            links: the links of a robot; None for a body.
        """
        return [p for p in self.parts if p.holder == holder and (links is None) == (p.link is None)
                and (links is None or p.link in links)]  # fmt: skip

    def between(self, steps: np.ndarray, s: np.ndarray) -> State:
        """The state between samples: joints linear, positions linear, rotations on shortest arcs.

        Args:
            steps: (M,) step numbers.
            s: (M,) fractions of the steps.

        Returns:
            The state at these M instants.
        """

        def links(name: str) -> arm.Frames:
            values = {j: v[steps] + s * (v[steps + 1] - v[steps]) for j, v in self.values[name].items()}
            return self.arms[name].frames(values)

        def body(name: str) -> tuple[np.ndarray, np.ndarray]:
            poses = self.poses[name]
            between = rigid.interpolate(poses[steps], poses[steps + 1], s)
            return rigid.matrices(between[:, 3:]), between[:, :3]

        return State(OnDemand(links), OnDemand(body))

    def gauge(self, a: Part, b: Part) -> Gauge:
        """Measures the distance of two parts."""
        self.check_time()
        if (a, b) not in self._gauges:
            self._gauges[a, b] = Gauge(a.solid, b.solid)
        return self._gauges[a, b]

    @cached_property
    def boxes(self) -> AxisBoxes:
        """Boxes round all parts at the samples, in the order of ``parts``."""
        return AxisBoxes(list(self.tracks.values()), self.check_time)

    @cached_property
    def number(self) -> dict[Part, int]:
        """The place of each part in ``parts``."""
        return {part: i for i, part in enumerate(self.parts)}

    def link_motion(self, part: Part) -> LinkMotion:
        """The motion of the link of a robot's part."""
        return self._links[part.holder][part.robot_link]

    def motion(self, part: Part) -> Motion:
        """The motion of the link or body of a part."""
        return self._bodies[part.holder] if part.link is None else self.link_motion(part)

    def relative_motion(self, frame: Part, part: Part) -> RelativeMotion:
        """Bounds on the motion of all points of a part's link or body in the frame of the link or body of another part.

        They are tight if both move together, as a link and the body that it carries do.
        """
        key = frame.holder, frame.link, part.holder, part.link
        if key not in self._relative:
            poses = rigid.relative(*frame.place(self.state), *part.place(self.state))
            self._relative[key] = relative(self.motion(frame), self.motion(part), poses, self._reach(part))
        return self._relative[key]

    def _reach(self, part: Part) -> float:
        """Largest distance (m) of a point of a part's link or body from its frame."""
        if (part.holder, part.link) not in self._reaches:
            own = (other for other in self.parts if other.holder == part.holder and other.link == part.link)
            self._reaches[part.holder, part.link] = max(other.reach for other in own)
        return self._reaches[part.holder, part.link]


def _rotations(poses: np.ndarray) -> np.ndarray:
    """Rotation matrices (N, 3, 3) of poses (N, 7)."""
    if _still(poses):
        return np.broadcast_to(rigid.matrices(poses[:1, 3:]), (len(poses), 3, 3))
    return rigid.matrices(poses[:, 3:])
