"""Serial arms in the form that compiled code needs: joints about or along their local z axis, and link hulls."""

from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from hmap_core.collision.convex import bounding_sphere, hull_vertices
from hmap_core.collision.edges import hull_edges
from hmap_core.exceptions import Code, InputError
from hmap_core.kinematics.fingers import Linkage, LinkageStep, SlidingFinger, closed_opening, finger_motion, steps_frame
from hmap_core.kinematics.simplify import simplify_hull
from hmap_core.kinematics.tree import forward, forward_last
from hmap_core.kinematics.urdf import Urdf, load_urdf
from hmap_core.robot_description import MOVING, Joint, load_robot_description
from hmap_core.transforms import apply, from_matrix, multiply, quaternions, to_matrix
from hmap_core.types import AttachedBody, Gripper, RobotModel

LINK_TOLERANCE = 0.0012  # m, largest excess of a simplified link hull over the true one
FINGER_TOLERANCE = 0.00005  # m, the same for links that touch objects
SPAN_SAMPLES, SPAN_KEPT = 2048, 16  # configurations evaluated and kept in each round of the search for an arm's span
SPAN_STEPS = (0.2, 0.1, 0.05, 0.02, 0.01, 0.005, 0.0)  # step size of each round, relative to the joint ranges
SPAN_TOLERANCE = 0.002  # m, added for the error of the search
ALL_DIRECTIONS = 6  # mobility of a body that moves freely: three translations and three rotations
MOBILITY_SAMPLES = 4  # random configurations; the rank of a Jacobian is smaller only where the arm is singular
RANK_TOLERANCE = 1e-6  # relative to the largest singular value
WIDENING_TOLERANCE = 0.05  # relative difference between the changes of finger gap and opening
MAX_CACHED = 64  # number of arms with attached bodies in the cache


@dataclass(frozen=True)
class LinkHull:
    """A convex part of a link.

    Attributes:
        link: name of the link.
        frame: index of the frame that carries it: 0 for the base, i for the frame after joint i.
        vertices: (n, 3) in that frame, m.
        radius: of the sphere that sweeps the hull of the vertices, m.
        motion: its motion in that frame with the opening of the gripper; None if it has none.
        finger: whether it belongs to a finger, or to an attached body.
        sphere: centre (3,) and radius of a bounding sphere with the gripper closed, m.
        edges: of the hull, see :mod:`hmap_core.collision.edges`.
    """

    link: str
    frame: int
    vertices: np.ndarray
    radius: float
    motion: SlidingFinger | Linkage | None
    finger: bool
    sphere: tuple[np.ndarray, float]
    edges: np.ndarray

    def sphere_at(self, opening: float) -> tuple[np.ndarray, float]:
        """Bounding sphere, centre (3,) and radius, at an opening (m)."""
        center, radius = self.sphere
        return (center if self.motion is None else self.motion.moved(center, opening)), radius

    def at(self, opening: float) -> np.ndarray:
        """Vertices (n, 3) at an opening (m)."""
        return self.vertices if self.motion is None else self.motion.moved(self.vertices, opening)

    def extent(self, gripper: Gripper | None) -> float:
        """Bound on the distance of its points from the origin of its frame over all openings, m.

        Raises:
            ValueError: it moves with the opening, and there is no gripper.
        """
        if self.motion is None:
            return float(np.linalg.norm(self.vertices, axis=1).max() + self.radius)
        if gripper is None:
            raise ValueError(f"link '{self.link}' moves with a gripper, and none is given")
        return self.motion.extent(self.vertices, self.radius, gripper)


@dataclass(frozen=True)
class Arm:
    """A serial arm with n joints, in its base frame.

    Attributes:
        model: the robot model.
        R_joint, p_joint: (n, 3, 3) and (n, 3) fixed transform from the previous frame to the frame of joint i at value
            zero.
        prismatic: (n,) 1 for a joint that slides along z, 0 for one that rotates about z.
        T_tip_ee: (4, 4) end-effector frame in the last frame.
        hulls: convex parts of all links and of the attached body.
        self_pairs: (P, 2) indices of hulls that may collide with each other.
        parent: (n,) index of the parent frame of each joint.
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
        """Forward kinematics of all frames.

        Args:
            q: (n,) configuration, rad or m.

        Returns:
            Rotations (n + 1, 3, 3) and origins (n + 1, 3) in the base frame; index 0 is the base.
        """
        R = np.empty((self.n + 1, 3, 3))
        p = np.empty((self.n + 1, 3))
        forward(np.ascontiguousarray(q, float), self.parent, self.R_joint, self.p_joint, self.prismatic, R, p)
        return R, p

    def end_effector(self, q: np.ndarray) -> np.ndarray:
        """Forward kinematics T_base_ee (7,) at a configuration q (n,)."""
        R, p = self.frames(q)
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = R[-1], p[-1]
        return from_matrix(T @ self.T_tip_ee)

    def end_effectors(self, Q: np.ndarray) -> np.ndarray:
        """Forward kinematics T_base_ee (M, 7) at configurations Q (M, n)."""
        Q = np.ascontiguousarray(Q, float)
        R, p = forward_last(Q, self.parent, self.R_joint, self.p_joint, self.prismatic)
        R_ee, p_ee = self.T_tip_ee[:3, :3], self.T_tip_ee[:3, 3]
        return np.concatenate([p + R @ p_ee, quaternions(R @ R_ee)], axis=1)

    def positions_of(self, point: np.ndarray, Q: np.ndarray) -> np.ndarray:
        """Positions (M, 3) in the base frame of a point (3,) of the end-effector frame at configurations Q (M, n)."""
        R, p = forward_last(np.ascontiguousarray(Q, float), self.parent, self.R_joint, self.p_joint, self.prismatic)
        return p + R @ (self.T_tip_ee[:3, :3] @ point + self.T_tip_ee[:3, 3])

    def reach(self) -> np.ndarray:
        """Bound (n,) on the distance of all link points from each joint's axis, m; 1 for prismatic joints."""
        return np.where(self.prismatic == 1, 1.0, self._link_bound)

    @property
    def length(self) -> float:
        """Bound on the distance of all link points from the origin of the first joint, m."""
        return float(self._link_bound[0] + self.stroke[0])

    @property
    def stroke(self) -> np.ndarray:
        """Largest displacement (n,) of each prismatic joint, m; 0 for revolute joints."""
        return np.where(self.prismatic == 1, np.abs(self.model.position_limits).max(axis=0), 0.0)

    @cached_property
    def _link_bound(self) -> np.ndarray:
        extent = np.zeros(self.n + 1)  # of the links on each frame
        for hull in self.hulls:
            extent[hull.frame] = max(extent[hull.frame], hull.extent(self.model.gripper))
        return self._bound(extent)

    def speed(self, extent_at_tip: float) -> float:
        """Bound on the motion of a body at the tip, relative to the bound of :meth:`reach`; at least 1.

        Args:
            extent_at_tip: bound on the distance of the body's points from the origin of the tip frame, m.
        """
        extent = np.zeros(self.n + 1)
        extent[-1] = extent_at_tip
        turning = self.prismatic == 0
        return float(max(1.0, (self._bound(extent)[turning] / self.reach()[turning]).max(initial=1.0)))

    def _bound(self, extent: np.ndarray) -> np.ndarray:
        """Distance (n,) from each joint's axis of bodies that extend from the frames by extent (n + 1,), m."""
        bound, stroke = np.zeros(self.n), self.stroke
        for k in range(self.n - 1, -1, -1):
            further = bound[k + 1] + np.linalg.norm(self.p_joint[k + 1]) + stroke[k + 1] if k + 1 < self.n else 0.0
            bound[k] = max(extent[k + 1], further)
        return bound

    @cached_property
    def span(self) -> float:
        """Largest distance of the last joint's origin from the first one's within the joint limits, m."""
        key = tuple(a.tobytes() for a in (self.R_joint, self.p_joint, self.prismatic, *self.model.position_limits))
        if key not in _SPANS:  # independent of attached bodies
            _SPANS[key] = _span(self)
        return _SPANS[key]

    @cached_property
    def mobility(self) -> int:
        """Rank of the Jacobian: 4 for a SCARA, ALL_DIRECTIONS for an arm that reaches every orientation.

        Siciliano et al., "Robotics: Modelling, Planning and Control", 2009, section 3.1.
        """
        lower, upper = self.model.position_limits
        samples = np.random.default_rng(0).uniform(lower, upper, (MOBILITY_SAMPLES, self.n))
        return max(int(np.linalg.matrix_rank(self.jacobian(q), rtol=RANK_TOLERANCE)) for q in samples)

    def jacobian(self, q: np.ndarray) -> np.ndarray:
        """Linear and angular velocity (6, n) of the last frame per unit of joint velocity, base frame."""
        R, p = self.frames(q)
        axes, turning = R[1:, :, 2], (self.prismatic == 0)[:, None]
        linear = np.where(turning, np.cross(axes, p[-1] - p[1:]), axes)
        return np.concatenate([linear.T, np.where(turning, axes, 0.0).T])

    def tip_jacobian(self, q: np.ndarray) -> np.ndarray:
        """Linear velocity (3, n) of the end-effector's origin per unit of joint velocity, base frame."""
        R, p = self.frames(q)
        axes, turning = R[1:, :, 2], (self.prismatic == 0)[:, None]
        origin = p[-1] + R[-1] @ self.T_tip_ee[:3, 3]
        return np.where(turning, np.cross(axes, origin - p[1:]), axes).T

    def finger_vertices(self, opening: float) -> np.ndarray:
        """Vertices (m, 3) of the finger links at an opening (m), end-effector frame; empty without gripper."""
        return self._in_end_effector([hull.at(opening) for hull in self.hulls if hull.finger])

    def finger_gap(self, opening: float) -> float | None:
        """Distance (m) of the fingers along the closing direction at an opening (m); None if one side has no finger."""
        inner: dict[bool, list[float]] = {False: [], True: []}
        for hull in self.hulls:
            if hull.finger:
                y = self._in_end_effector([hull.at(opening)])[:, 1]
                side = y.min() + y.max() > 0.0
                inner[side].append(y.min() - hull.radius if side else y.max() + hull.radius)
        return min(inner[True]) - max(inner[False]) if all(inner.values()) else None

    def tip_vertices(self) -> np.ndarray:
        """Vertices (m, 3) of all hulls on the last frame, in the end-effector frame."""
        return self._in_end_effector([hull.vertices for hull in self.hulls if hull.frame == self.n])

    def tip_radii(self, fingers: bool) -> np.ndarray:
        """Radii (m,) of spheres round vertices, m; 0 for what the simplification of hulls adds.

        Args:
            fingers: whether of the vertices of :meth:`finger_vertices`; else of :meth:`tip_vertices`.
        """
        own = [hull for hull in self.hulls if (hull.finger if fingers else hull.frame == self.n)]
        each = [np.full(len(hull.vertices), hull.radius if hull.radius > FINGER_TOLERANCE else 0.0) for hull in own]
        return np.concatenate([np.zeros(0), *each])

    def hand(self, opening: float) -> list[tuple[np.ndarray, float]]:
        """The hulls on the last frame, at an opening (m).

        Returns:
            Vertices (m, 3) in the end-effector frame and sphere radius of each hull, m.
        """
        own = [hull for hull in self.hulls if hull.frame == self.n]
        return [(self._in_end_effector([hull.at(opening)]), hull.radius) for hull in own]

    def _in_end_effector(self, points: list[np.ndarray]) -> np.ndarray:
        if not points:
            return np.zeros((0, 3))
        inverse = np.linalg.inv(self.T_tip_ee)
        return np.concatenate(points) @ inverse[:3, :3].T + inverse[:3, 3]


def _span(arm: Arm) -> float:
    """Computes :attr:`Arm.span` by random search with decreasing step sizes."""
    rng = np.random.default_rng(0)
    lower, upper = arm.model.position_limits
    Q = rng.uniform(lower, upper, (SPAN_SAMPLES, arm.n))
    for size in SPAN_STEPS:
        _, p = forward_last(Q, arm.parent, arm.R_joint, arm.p_joint, arm.prismatic)
        far = np.linalg.norm(p - arm.p_joint[0], axis=1)
        best = Q[np.argsort(-far)[:SPAN_KEPT]]
        changes = size * (upper - lower) * rng.uniform(-1.0, 1.0, (SPAN_SAMPLES // SPAN_KEPT, SPAN_KEPT, arm.n))
        Q = np.concatenate([best, np.clip(best + changes, lower, upper).reshape(-1, arm.n)])
    return float(far.max()) + SPAN_TOLERANCE


def _align_z(axis: np.ndarray) -> np.ndarray:
    """A rotation (4, 4) that maps z to the unit vector ``axis`` (3,)."""
    matrix = np.eye(4)
    if axis[2] < 1.0 - 1e-12:
        matrix[:3, :3] = Rotation.align_vectors([axis], [[0, 0, 1]])[0].as_matrix()
    return matrix


@dataclass(frozen=True)
class _LinkMount:
    """Mounting of a link.

    Attributes:
        frame: index of the frame that carries the link.
        T: (4, 4) link frame in that frame, with the gripper closed.
        motion: motion with the opening of the gripper; None if there is none.
    """

    frame: int
    T: np.ndarray
    motion: SlidingFinger | Linkage | None


def _link_frames(urdf: Urdf, model: RobotModel) -> tuple[dict[str, _LinkMount], list[np.ndarray]]:
    """Mounting of each link, and fixed transform (4, 4) of each joint.

    Raises:
        InputError: INVALID_SCENE; the URDF does not match the names or the order of the joints of the model.
    """
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
    states: dict[str, tuple[int, np.ndarray, list[LinkageStep]]] = {}
    for link in urdf.hulls:
        above = urdf.tree.path(link, states)
        frame, T, own = states.get(above[0].parent if above else link, (0, np.eye(4), []))
        for joint in above:
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
                own = [*own, step]
                T = np.eye(4)
            states[joint.child] = frame, T, own
        placed[link] = _mount(model.gripper, frame, own, T)
    missing = [name for name in model.joint_names if name not in fixed]
    if missing:
        raise InputError(f"robot '{model.name}': joints {missing} carry no link", Code.INVALID_SCENE)
    return placed, [fixed[name] for name in model.joint_names]


def _step(urdf: Urdf, gripper: Gripper | None, joint: Joint, T: np.ndarray) -> LinkageStep | None:
    """A joint that moves with the gripper, after a fixed transform T (4, 4); None for any other joint."""
    if gripper is None:
        return None
    if joint.name in gripper.joint_names:
        return LinkageStep(T, joint, gripper.joint_names.index(joint.name), 1.0, 0.0)
    name, factor, offset = urdf.tree.driver(joint.name)
    if name not in gripper.joint_names:
        return None
    return LinkageStep(T, joint, gripper.joint_names.index(name), factor, offset)


def _mount(gripper: Gripper | None, frame: int, steps: list[LinkageStep], T: np.ndarray) -> _LinkMount:
    """Mounting of a link after some gripper joints and a fixed transform T (4, 4)."""
    if gripper is None or not steps:
        return _LinkMount(frame, T, None)
    return _LinkMount(frame, steps_frame(gripper, steps, closed_opening(gripper)) @ T, finger_motion(gripper, steps))


def _self_pairs(hulls: list[LinkHull], ignored: Iterable[tuple[str, str]]) -> np.ndarray:
    kept_out = {frozenset(pair) for pair in ignored}
    pairs = [
        (i, j)
        for (i, a), (j, b) in combinations(enumerate(hulls), 2)
        if a.frame != b.frame and frozenset((a.link, b.link)) not in kept_out
    ]
    return np.array(pairs, np.int64).reshape(-1, 2)


def build_arm(model: RobotModel) -> Arm:
    """Builds an arm from a robot model and its URDF.

    Args:
        model: the robot model; its attached body is ignored.

    Returns:
        The arm.

    Raises:
        InputError: INVALID_SCENE; the URDF cannot be read or does not match the model.
    """
    urdf = load_urdf(model.urdf)
    placed, fixed = _link_frames(urdf, model)
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
        np.array([urdf.tree.by_name[name].kind == "prismatic" for name in model.joint_names], np.int64),
        tip.T @ to_matrix(model.T_link_ee),
        tuple(hulls),
        _self_pairs(hulls, model.ignored_collisions),
        np.arange(len(fixed), dtype=np.int64),
    )
    _check_widening(arm)
    return arm


def _check_widening(arm: Arm) -> None:
    """Checks that the gap between the fingers grows like the opening; omitted if one side has no finger.

    Raises:
        InputError: INVALID_SCENE; the gap grows differently.
    """
    gripper = arm.model.gripper
    if gripper is None:
        return
    ends = np.array([gripper.min_opening, gripper.open_opening])
    closed, opened = (arm.finger_gap(opening) for opening in ends)
    if closed is None or opened is None:
        return
    if abs(abs(opened - closed) / np.ptp(ends) - 1.0) > WIDENING_TOLERANCE:
        raise InputError(
            f"robot '{arm.model.name}': from gripper.min_opening to open_opening, {np.ptp(ends):.4f} m, the gap of "
            f"finger_links grows by {opened - closed:.4f} m in the URDF; it has to be the same, see per_joint",
            Code.INVALID_SCENE,
        )


def with_attached(arm: Arm, body: AttachedBody) -> Arm:
    """The arm with a body attached to its gripper.

    The hulls of the body replace the fingers as the links that touch objects.

    Args:
        arm: without attached body.
        body: the body.

    Returns:
        The new arm, with fixed fingers.
    """
    n, opening = arm.n, body.opening
    hulls = [
        replace(h, vertices=h.at(opening), motion=None, sphere=h.sphere_at(opening), finger=False) for h in arm.hulls
    ]
    T = multiply(from_matrix(arm.T_tip_ee), body.T_ee_body)
    own = []
    for shape in body.shapes:
        points, radius = hull_vertices(shape)
        vertices = np.ascontiguousarray(apply(T, points))
        center = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
        sphere = (center, np.linalg.norm(vertices - center, axis=1).max() + radius)
        own.append(LinkHull(body.name, n, vertices, radius, None, True, sphere, hull_edges(vertices)))
    links = [i for i, hull in enumerate(hulls) if hull.frame < n]
    pairs = [(i, len(hulls) + k) for i in links for k in range(len(own))]
    self_pairs = np.concatenate([arm.self_pairs, np.array(pairs, np.int64).reshape(-1, 2)])
    return replace(arm, hulls=(*hulls, *own), self_pairs=self_pairs)


_ARMS: dict[tuple, Arm] = {}
_SPANS: dict[tuple, float] = {}
_ATTACHED: OrderedDict[tuple, Arm] = OrderedDict()  # the last MAX_CACHED arms with attached bodies


def load_arm(model: RobotModel) -> Arm:
    """The arm of a robot model with its attached body, from a cache.

    Raises:
        InputError: INVALID_SCENE; the URDF cannot be read or does not match the model.
    """
    gripper, body = model.gripper, model.attached
    key: tuple = (
        load_robot_description(model.urdf),
        model.name,
        model.joint_names,
        model.ignored_collisions,
        model.end_effector_link,
    )
    key += (model.T_link_ee.tobytes(), gripper, model.position_limits.tobytes(), model.velocity_limits.tobytes())
    key += (model.acceleration_limits.tobytes(), model.home.tobytes())
    if (bare := _ARMS.get(key)) is None:
        bare = _ARMS[key] = build_arm(model)
    if body is None:
        return bare
    key += (body.name, body.T_ee_body.tobytes(), body.opening)
    key += tuple((s.kind, s.size, s.pose.tobytes(), s.mesh) for s in body.shapes)
    if key not in _ATTACHED:
        _ATTACHED[key] = with_attached(bare, body)
        if len(_ATTACHED) > MAX_CACHED:
            _ATTACHED.popitem(last=False)
    return _ATTACHED[key]
