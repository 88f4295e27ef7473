"""An arm as compiled code wants it: joints that turn about (or slide along) their local z axis, and link hulls."""

from collections import OrderedDict
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from hmap_core.collision.convex import bounding_sphere, hull_vertices
from hmap_core.collision.edges import hull_edges
from hmap_core.exceptions import Code, InputError
from hmap_core.kinematics.fingers import Linkage, LinkageStep, Slide, closed, finger_motion, steps_frame
from hmap_core.kinematics.simplify import simplify_hull
from hmap_core.kinematics.tree import forward, forward_last
from hmap_core.kinematics.urdf import Urdf, load_urdf
from hmap_core.scenes.urdf import MOVING, UrdfJoint
from hmap_core.transforms import apply, from_matrix, multiply, quaternions, to_matrix
from hmap_core.types import AttachedBody, Gripper, RobotModel

LINK_TOLERANCE = 0.0012  # m a simplified link hull may stick out of the true one
FINGER_TOLERANCE = 0.00005  # m, for the parts that touch objects
SPAN_POSTURES, SPAN_KEPT = 2048, 16  # looked at in each round for the span of an arm, and gone on from
SPAN_CHANGES = (0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.0)  # of the joints' ranges, in each round
SPAN_TOLERANCE = 0.002  # m
WIDENING = 0.05  # share by which the gap between the fingers may grow otherwise than the opening
ARMS_KEPT = 64  # arms with something in the hand that are remembered


@dataclass(frozen=True)
class LinkHull:
    """A convex piece of a link: swept hull in the frame that carries it (0 = base, i = after joint i).

    ``motion`` is how it moves in that frame with the opening of the gripper; None: not at all.
    """

    link: str
    frame: int
    vertices: np.ndarray
    radius: float
    motion: Slide | Linkage | None
    finger: bool
    sphere: tuple[np.ndarray, float]  # center (3,) and radius of a bounding sphere with the gripper closed
    edges: np.ndarray  # of the hull, see hmap_core.collision.edges

    def sphere_at(self, opening: float) -> tuple[np.ndarray, float]:
        """Bounding sphere with the gripper open by ``opening`` metres."""
        center, radius = self.sphere
        return (center if self.motion is None else self.motion.moved(center, opening)), radius

    def at(self, opening: float) -> np.ndarray:
        """Vertices (n, 3) with the gripper open by ``opening`` metres."""
        return self.vertices if self.motion is None else self.motion.moved(self.vertices, opening)

    def extent(self, gripper: Gripper | None) -> float:
        """Farthest that its points come from the origin of the frame that carries it, m."""
        if self.motion is None:
            return float(np.linalg.norm(self.vertices, axis=1).max() + self.radius)
        return self.motion.extent(self.vertices, self.radius, gripper)


@dataclass(frozen=True)
class Arm:
    """A serial arm in its base frame.

    Attributes:
        R_joint, p_joint: (n, 3, 3), (n, 3) fixed transform from the frame before to the frame of joint i at zero.
        prismatic: (n,) 1 where the joint slides along z, 0 where it turns about z.
        T_tip_ee: (4, 4) end-effector frame in the last frame.
        hulls: convex pieces of all links.
        self_pairs: (P, 2) indices of hulls that may collide with each other.
        parent: (n,) frame each joint hangs on.
    """

    model: RobotModel
    R_joint: np.ndarray
    p_joint: np.ndarray
    prismatic: np.ndarray
    T_tip_ee: np.ndarray
    hulls: tuple[LinkHull, ...]
    self_pairs: np.ndarray
    parent: np.ndarray

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.prismatic)

    def frames(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rotations (n + 1, 3, 3) and origins (n + 1, 3) of all frames in the base frame; 0 is the base."""
        R = np.empty((self.n + 1, 3, 3))
        p = np.empty((self.n + 1, 3))
        forward(np.ascontiguousarray(q, float), self.parent, self.R_joint, self.p_joint, self.prismatic, R, p)
        return R, p

    def end_effector(self, q: np.ndarray) -> np.ndarray:
        """T_base_ee (7,) at configuration q (n,)."""
        R, p = self.frames(q)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R[-1], p[-1]
        return from_matrix(T @ self.T_tip_ee)

    def end_effectors(self, Q: np.ndarray) -> np.ndarray:
        """T_base_ee (M, 7) at configurations Q (M, n)."""
        Q = np.ascontiguousarray(Q, float)
        R, p = forward_last(Q, self.parent, self.R_joint, self.p_joint, self.prismatic)
        R_ee, p_ee = self.T_tip_ee[:3, :3], self.T_tip_ee[:3, 3]
        return np.concatenate([p + R @ p_ee, quaternions(R @ R_ee)], axis=1)

    def reach(self) -> np.ndarray:
        """Bound (n,) on the distance of any link point from each joint's axis; 1 for sliding joints."""
        return self._reach.copy()

    @property
    def length(self) -> float:
        """Bound on how far any of its points comes from the origin of its first joint, m."""
        return float(self._link_bound[0] + self.stroke[0])

    @property
    def stroke(self) -> np.ndarray:
        """How far (n,) each joint slides at most, m."""
        return np.where(self.prismatic == 1, np.abs(self.model.position_limits).max(axis=0), 0.0)

    @cached_property
    def _reach(self) -> np.ndarray:
        return np.where(self.prismatic == 1, 1.0, self._link_bound)

    @cached_property
    def _link_bound(self) -> np.ndarray:
        extent = np.zeros(self.n + 1)  # of the links on each frame
        for hull in self.hulls:
            extent[hull.frame] = max(extent[hull.frame], hull.extent(self.model.gripper))
        return self._bound(extent)

    def speed(self, extent_at_tip: float) -> float:
        """How much farther than :meth:`reach` says something may move that sticks out of the tip frame so far (m)."""
        extent = np.zeros(self.n + 1)
        extent[-1] = extent_at_tip
        turning = self.prismatic == 0
        return float(max(1.0, (self._bound(extent)[turning] / self.reach()[turning]).max(initial=1.0)))

    def _bound(self, extent: np.ndarray) -> np.ndarray:
        """Distance (n,) from each joint's axis of what sticks out of the frames by extent (n + 1,)."""
        bound, stroke = np.zeros(self.n), self.stroke
        for k in range(self.n - 1, -1, -1):
            further = bound[k + 1] + np.linalg.norm(self.p_joint[k + 1]) + stroke[k + 1] if k + 1 < self.n else 0.0
            bound[k] = max(extent[k + 1], further)
        return bound

    @cached_property
    def span(self) -> float:
        """Farthest that the last joint's origin comes from the first one's within the joint limits, m."""
        key = tuple(a.tobytes() for a in (self.R_joint, self.p_joint, self.prismatic, *self.model.position_limits))
        if key not in _SPANS:  # what an arm holds does not change it
            _SPANS[key] = _span(self)
        return _SPANS[key]

    def finger_vertices(self, opening: float) -> np.ndarray:
        """All vertices (m, 3) of the finger links in the end-effector frame; empty without a gripper."""
        return self._in_end_effector([hull.at(opening) for hull in self.hulls if hull.finger])

    def finger_gap(self, opening: float) -> float | None:
        """Distance (m) of the fingers along the closing direction; None where not on both sides is one."""
        inner: dict[bool, list[float]] = {False: [], True: []}
        for hull in self.hulls:
            if hull.finger:
                y = self._in_end_effector([hull.at(opening)])[:, 1]
                side = y.min() + y.max() > 0.0
                inner[side].append(y.min() - hull.radius if side else y.max() + hull.radius)
        return min(inner[True]) - max(inner[False]) if all(inner.values()) else None

    def tip_vertices(self) -> np.ndarray:
        """All vertices (m, 3) of what hangs on the last joint, in the end-effector frame."""
        return self._in_end_effector([hull.vertices for hull in self.hulls if hull.frame == self.n])

    def hand(self, opening: float) -> list[tuple[np.ndarray, float]]:
        """Hulls (vertices (m, 3) in the end-effector frame, radius) on the last joint, the gripper open by so much."""
        own = [hull for hull in self.hulls if hull.frame == self.n]
        return [(self._in_end_effector([hull.at(opening)]), hull.radius) for hull in own]

    def _in_end_effector(self, points: list[np.ndarray]) -> np.ndarray:
        if not points:
            return np.zeros((0, 3))
        inverse = np.linalg.inv(self.T_tip_ee)
        return np.concatenate(points) @ inverse[:3, :3].T + inverse[:3, 3]


def _span(arm: Arm) -> float:
    """:attr:`Arm.span`: the best of many configurations, and of ever smaller changes of the best of these."""
    rng = np.random.default_rng(0)
    lower, upper = arm.model.position_limits
    Q = rng.uniform(lower, upper, (SPAN_POSTURES, arm.n))
    for size in SPAN_CHANGES:
        _, p = forward_last(Q, arm.parent, arm.R_joint, arm.p_joint, arm.prismatic)
        far = np.linalg.norm(p - arm.p_joint[0], axis=1)
        best = Q[np.argsort(-far)[:SPAN_KEPT]]
        changes = size * (upper - lower) * rng.uniform(-1.0, 1.0, (SPAN_POSTURES // SPAN_KEPT, SPAN_KEPT, arm.n))
        Q = np.concatenate([best, np.clip(best + changes, lower, upper).reshape(-1, arm.n)])
    return float(far.max()) + SPAN_TOLERANCE


def _align_z(axis: np.ndarray) -> np.ndarray:
    """A rotation (4, 4) that takes z to the unit axis (3,)."""
    matrix = np.eye(4)
    if axis[2] < 1.0 - 1e-12:
        matrix[:3, :3] = Rotation.align_vectors([axis], [[0, 0, 1]])[0].as_matrix()
    return matrix


@dataclass(frozen=True)
class _Hanging:
    """Where a link hangs: the frame that carries it, the link's frame in there (4, 4), closed; and how it moves."""

    frame: int
    T: np.ndarray
    motion: Slide | Linkage | None


def _link_frames(urdf: Urdf, model: RobotModel) -> tuple[dict[str, _Hanging], list[np.ndarray]]:
    """Where each link hangs, and the joints' fixed parts."""
    for name in model.joint_names:
        if name not in urdf.tree.by_name:
            known = ", ".join(j.name for j in urdf.tree.by_name.values() if j.kind in MOVING)
            raise InputError(
                f"robot '{model.name}': joint '{name}' is not in the URDF; it has {known}", Code.INVALID_SCENE
            )
    if model.end_effector_link not in urdf.hulls:
        raise InputError(
            f"robot '{model.name}': end_effector_link '{model.end_effector_link}' is not in the URDF",
            Code.INVALID_SCENE,
        )
    fixed: dict[str, np.ndarray] = {}
    placed = {}
    for link in urdf.hulls:
        frame, T, own = 0, np.eye(4), []
        for joint in urdf.tree.path(link):
            T = T @ to_matrix(joint.T_parent_joint)
            if joint.name in model.joint_names:
                align = _align_z(joint.axis)
                index = model.joint_names.index(joint.name)
                if index != frame:
                    raise InputError(
                        f"robot '{model.name}': joint '{joint.name}' is number {frame + 1} on the chain to '{link}' "
                        f"but number {index + 1} in joint_names",
                        Code.INVALID_SCENE,
                    )
                fixed[joint.name] = T @ align
                frame, T, own = index + 1, np.linalg.inv(align), []
            elif (step := _step(urdf, model.gripper, joint, T)) is not None:
                own.append(step)
                T = np.eye(4)
        placed[link] = _hanging(model.gripper, frame, own, T)
    missing = [name for name in model.joint_names if name not in fixed]
    if missing:
        raise InputError(f"robot '{model.name}': joints {missing} carry no link", Code.INVALID_SCENE)
    return placed, [fixed[name] for name in model.joint_names]


def _step(urdf: Urdf, gripper: Gripper | None, joint: UrdfJoint, T: np.ndarray) -> LinkageStep | None:
    """A joint that moves with the gripper, behind a fixed transform (4, 4); None for any other."""
    if gripper is None:
        return None
    if joint.name in gripper.joint_names:
        return LinkageStep(T, joint, gripper.joint_names.index(joint.name), 1.0, 0.0)
    name, factor, offset = urdf.tree.driver(joint.name)
    if name not in gripper.joint_names:
        return None
    return LinkageStep(T, joint, gripper.joint_names.index(name), factor, offset)


def _hanging(gripper: Gripper | None, frame: int, steps: list[LinkageStep], T: np.ndarray) -> _Hanging:
    """A link behind some joints of the gripper, and a fixed transform (4, 4) behind these."""
    if not steps:
        return _Hanging(frame, T, None)
    return _Hanging(frame, steps_frame(gripper, steps, closed(gripper)) @ T, finger_motion(gripper, steps))


def _self_pairs(hulls: list[LinkHull], ignored) -> np.ndarray:
    ignored = {frozenset(pair) for pair in ignored}
    pairs = [
        (i, j)
        for (i, a), (j, b) in combinations(enumerate(hulls), 2)
        if a.frame != b.frame and frozenset((a.link, b.link)) not in ignored
    ]
    return np.array(pairs, np.int64).reshape(-1, 2)


def build_arm(model: RobotModel) -> Arm:
    """Reads the model's URDF into an :class:`Arm`.

    Raises:
        InputError: the URDF does not have the joints or links that the model names.
    """
    urdf = load_urdf(model.urdf)
    placed, fixed = _link_frames(urdf, model)
    kinds = {name: joint.kind for name, joint in urdf.tree.by_name.items()}
    hulls = []
    for link, pieces in urdf.hulls.items():
        frame, T, motion = placed[link].frame, placed[link].T, placed[link].motion
        finger = model.gripper is not None and link in model.gripper.finger_links
        for points, radius in pieces:
            touches = finger or (model.gripper is None and frame == len(fixed))
            tolerance = FINGER_TOLERANCE if touches else LINK_TOLERANCE
            vertices, extra = simplify_hull(points, tolerance) if len(points) > 2 else (points, 0.0)
            vertices = np.ascontiguousarray(vertices @ T[:3, :3].T + T[:3, 3])
            center, bound = bounding_sphere(vertices)
            sphere = (center, bound + radius + extra)
            hulls.append(LinkHull(link, frame, vertices, radius + extra, motion, finger, sphere, hull_edges(vertices)))
    tip = placed[model.end_effector_link]
    if tip.frame != len(fixed):
        raise InputError(
            f"robot '{model.name}': end_effector_link '{model.end_effector_link}' does not follow the last joint",
            Code.INVALID_SCENE,
        )
    arm = Arm(
        model,
        np.ascontiguousarray([T[:3, :3] for T in fixed]),
        np.ascontiguousarray([T[:3, 3] for T in fixed]),
        np.array([kinds[name] == "prismatic" for name in model.joint_names], np.int64),
        tip.T @ to_matrix(model.T_link_ee),
        tuple(hulls),
        _self_pairs(hulls, model.ignored_collisions),
        np.arange(len(fixed), dtype=np.int64),
    )
    _check_widening(arm)
    return arm


def _check_widening(arm: Arm) -> None:
    """The gap between the fingers grows as the opening does; not looked at where no finger is on one of the sides.

    Raises:
        InputError: INVALID_SCENE; it does not.
    """
    gripper = arm.model.gripper
    if gripper is None:
        return
    ends = np.array([gripper.min_opening, gripper.open_opening])
    gaps = [arm.finger_gap(opening) for opening in ends]
    if None not in gaps and abs(np.ptp(gaps) / np.ptp(ends) - 1.0) > WIDENING:
        raise InputError(
            f"robot '{arm.model.name}': from gripper.min_opening to open_opening, {np.ptp(ends):.4f} m, the gap of "
            f"finger_links grows by {gaps[1] - gaps[0]:.4f} m in the URDF; it has to be the same, see per_joint",
            Code.INVALID_SCENE,
        )


def holding(arm: Arm, held: AttachedBody) -> Arm:
    """The arm with its fingers closed on a body, which touches in their place.

    The body's shapes are its finger hulls; the fingers are links of the hand like any other.
    """
    n, opening = arm.n, held.opening
    hulls = [
        replace(h, vertices=h.at(opening), motion=None, sphere=h.sphere_at(opening), finger=False) for h in arm.hulls
    ]
    T = multiply(from_matrix(arm.T_tip_ee), held.T_ee_body)
    own = []
    for shape in held.shapes:
        points, radius = hull_vertices(shape)
        vertices = np.ascontiguousarray(apply(T, points))
        center = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
        sphere = (center, np.linalg.norm(vertices - center, axis=1).max() + radius)
        own.append(LinkHull(held.name, n, vertices, radius, None, True, sphere, hull_edges(vertices)))
    links = [i for i, hull in enumerate(hulls) if hull.frame < n]
    pairs = [(i, len(hulls) + k) for i in links for k in range(len(own))]
    self_pairs = np.concatenate([arm.self_pairs, np.array(pairs, np.int64).reshape(-1, 2)])
    return replace(arm, hulls=(*hulls, *own), self_pairs=self_pairs)


_ARMS: dict[tuple, Arm] = {}
_SPANS: dict[tuple, float] = {}
_HOLDING: OrderedDict[tuple, Arm] = OrderedDict()  # the last ARMS_KEPT of the arms that hold something


def load_arm(model: RobotModel) -> Arm:
    """The arm of a model, built once per (name, URDF file, joints, ignored pairs), with what it holds."""
    gripper, held = model.gripper, model.attached
    key = (model.name, model.urdf, model.joint_names, model.ignored_collisions, model.end_effector_link)
    key += (model.T_link_ee.tobytes(), gripper)
    if key not in _ARMS:
        _ARMS[key] = build_arm(model)
    if held is None:
        return _ARMS[key]
    bare = _ARMS[key]
    key += (held.name, held.T_ee_body.tobytes(), held.opening)
    key += tuple((s.kind, s.size, s.pose.tobytes(), s.mesh) for s in held.shapes)
    if key not in _HOLDING:
        _HOLDING[key] = holding(bare, held)
        if len(_HOLDING) > ARMS_KEPT:
            _HOLDING.popitem(last=False)
    return _HOLDING[key]
