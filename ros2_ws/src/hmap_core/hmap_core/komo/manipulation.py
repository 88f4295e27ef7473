"""One robot and one object through the phases of an H-MaP segment: what may touch what."""

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from hmap_core.collision.convex import ConvexSet, convex_set, set_distance, transformed
from hmap_core.collision.scene_model import ALL_PHASES, CollisionModel
from hmap_core.kinematics.arm import Arm, load_arm
from hmap_core.kinematics.model import KinematicModel, PlacedArm
from hmap_core.komo.features.pose import pose_params
from hmap_core.transforms import apply, inverse, multiply, pose
from hmap_core.types import Body, ContactKind, ContactPoint, Robot, Scene, SceneState

# distances that are kept, m
ROBOT_CLEARANCE = 0.003  # links from everything that stands around
SELF_CLEARANCE = 0.002  # links from other links of the same arm
OBJECT_CLEARANCE = 0.002  # links from the object that is handled, but for what touches it
HELD_CLEARANCE = 0.0015  # the carried object from what stands around, where start and end leave that much
TOUCH_ALLOWANCE = 0.0003  # a touching fingertip, or an object on its support, may be this far inside
# how far the hand draws back from a contact, m
GRASP_RETREAT = 0.10
TOUCH_RETREAT = 0.05
# how much wider than the object each side of the gripper opens, m
OPENING_CLEARANCE = 0.008


class Phase(IntEnum):
    """Phases of a segment, in their order."""

    TRANSIT = 0  # to the pre-contact pose, touching nothing
    APPROACH = 1  # straight to the contact
    HOLD = 2  # in contact, the object moves along
    RETREAT = 3  # straight back from the contact


def bit(*phases: Phase) -> int:
    """Bit mask of phases."""
    return sum(1 << int(p) for p in phases)


FREE = bit(Phase.TRANSIT, Phase.APPROACH, Phase.RETREAT)
# What a carried object must not hit counts only where paths are verified: the path of the object itself was planned
# free, and a hold follows it pose by pose.
CARRIED = 1 << len(Phase)


def retreat_distance(contact: ContactPoint) -> float:
    """How far from the contact the approach begins and the retreat ends, m."""
    return GRASP_RETREAT if contact.kind == ContactKind.GRASP else TOUCH_RETREAT


def free_opening(robot: Robot, contact: ContactPoint) -> float:
    """Gripper opening while coming and going, m."""
    gripper = robot.model.gripper
    if gripper is None or contact.kind != ContactKind.GRASP:
        return contact.opening
    return min(gripper.open_opening, contact.opening + 2 * OPENING_CLEARANCE)


def retreated(contact: ContactPoint, fraction: float = 1.0) -> np.ndarray:
    """T_obj_ee (7,) with the hand drawn back along its approach by a fraction of the retreat distance."""
    return multiply(contact.T_obj_ee, pose(-fraction * retreat_distance(contact) * contact.approach))


_SETS: dict[tuple, ConvexSet] = {}


def body_set(body: Body) -> ConvexSet:
    """Convex set of a body in its own frame; computed once per geometry."""
    key = tuple((s.kind, s.size, s.pose.tobytes(), s.mesh) for s in body.shapes)
    if key not in _SETS:
        _SETS[key] = convex_set(body.shapes)
    return _SETS[key]


@dataclass
class Manipulation:
    """A robot about to handle an object in a scene.

    Attributes:
        scene, state: where everything is before the segment.
        robot: name of the robot that moves; the others stand still.
        object: name of the object that it handles.
    """

    scene: Scene
    state: SceneState
    robot: str
    object: str
    arm: Arm = field(init=False)
    model: KinematicModel = field(init=False)
    _without_object: dict = field(init=False, default_factory=dict, repr=False)

    def __post_init__(self):
        placed = self.scene.robots[self.robot]
        self.arm = load_arm(placed.model)
        self.model = KinematicModel([PlacedArm(self.robot, self.arm, placed.base_pose)])
        self.tip = self.model.tip(self.robot)
        self.T_tip_ee = self.model.T_tip_ee(self.robot)

    def target(self, T_world_ee: np.ndarray) -> np.ndarray:
        """Parameters of the relative_pose feature that bring the end-effector to a world pose (7,)."""
        return pose_params(self.T_tip_ee, T_world_ee)

    def collisions(self, contact: ContactPoint, T_start: np.ndarray, T_end: np.ndarray | None = None) -> CollisionModel:
        """What keeps apart from what in each phase, for an object that goes from T_start to T_end (7,)."""
        scene, links, static = self._base(contact)
        scene = scene.copy()
        self._add_object(scene, links, static, contact, T_start, T_end)
        return scene

    def surroundings(self, contact: ContactPoint) -> CollisionModel:
        """The same without the object."""
        return self._base(contact)[0]

    def _base(self, contact: ContactPoint):
        openings = free_opening(self.scene.robots[self.robot], contact), contact.opening
        if openings not in self._without_object:
            self._without_object[openings] = self._arm_and_surroundings(*openings)
        return self._without_object[openings]

    def _arm_and_surroundings(self, opening: float, contact_opening: float):
        """The part of the collision model that does not depend on the object: (model, links, static shapes by name)."""
        scene = CollisionModel()
        links = self._add_arm(scene, opening, contact_opening)
        static = self._add_static(scene)
        around = [s for shapes in static.values() for s in shapes]
        for group in links:
            moving = [s for s in links[group] if scene.frames[s] > 0]
            scene.keep_apart(moving, around, ROBOT_CLEARANCE, self._phases(links, (links[group] or [-1])[0]))
        return scene, links, static

    def standing_collisions(self, T_obj: np.ndarray) -> CollisionModel:
        """What keeps apart while the robot moves in the air with its gripper as it is, the object standing at T_obj."""
        opening = self.state.gripper[self.robot]
        scene = CollisionModel()
        links = self._add_arm(scene, opening, opening)
        moving = [s for s in links["free"] + links["link"] if scene.frames[s] > 0]
        for shapes in self._add_static(scene).values():
            scene.keep_apart(moving, shapes, ROBOT_CLEARANCE, FREE)
        standing = scene.add_set(self.object, transformed(body_set(self.scene.bodies[self.object]), T_obj), 0)
        scene.keep_apart(moving, standing, OBJECT_CLEARANCE, FREE)
        return scene

    @staticmethod
    def _phases(links: dict[str, list[int]], shape: int) -> int:
        return FREE if shape in links["free"] else (bit(Phase.HOLD) if shape in links["hold"] else ALL_PHASES)

    def _add_arm(self, scene: CollisionModel, opening: float, contact_opening: float) -> dict[str, list[int]]:
        """Adds the moving arm with its self-collision pairs; fingers once as open as they come, once as they hold."""
        T_base = self.model.arms[self.robot].T_world_base
        groups: dict[str, list[int]] = {"link": [], "free": [], "hold": []}
        numbers: list[list[int]] = []  # of each hull; two for a finger
        for hull in self.arm.hulls:
            own = []
            variants = (("free", opening), ("hold", contact_opening)) if hull.finger else (("link", 0.0),)
            for group, width in variants:
                vertices, (center, bound) = hull.at(width), hull.sphere_at(width)
                if hull.frame == 0:
                    vertices, center = apply(T_base, vertices), apply(T_base, center)
                frame = self.model.frame(self.robot, hull.frame)
                own.append(
                    scene.add(
                        f"{self.robot}/{hull.link}", vertices, hull.radius, frame, (center, bound), edges=hull.edges
                    )
                )
                groups[group].append(own[-1])
            numbers.append(own)
        for i, j in self.arm.self_pairs:
            for a in numbers[i]:
                for b in numbers[j]:
                    phases = self._phases(groups, a) & self._phases(groups, b)
                    if phases:
                        scene.keep_apart([a], [b], SELF_CLEARANCE, phases)
        return groups

    def _add_static(self, scene: CollisionModel) -> dict[str, list[int]]:
        """Adds every other body and every other robot, where they are now."""
        static = {}
        for name, body in self.scene.bodies.items():
            if name != self.object:
                shapes = transformed(body_set(body), self.state.poses[name])
                static[name] = scene.add_set(name, shapes, 0)
        for name, robot in self.scene.robots.items():
            if name != self.robot:
                static[f"robot {name}"] = [
                    scene.add(f"{name}/{link}", vertices, radius, 0, sphere, edges=edges)
                    for link, vertices, radius, sphere, edges in posed_links(
                        robot, self.state.q[name], self.state.gripper[name]
                    )
                ]
        return static

    def _add_object(self, scene, links, static, contact: ContactPoint, T_start, T_end) -> None:
        body = self.scene.bodies[self.object]
        own = body_set(body)
        touching = contact.kind != ContactKind.GRASP
        fingers = -TOUCH_ALLOWANCE if touching else OBJECT_CLEARANCE
        tip = self.tip
        moving = [s for s in links["link"] if scene.frames[s] > 0]
        # an arm without fingers touches with its last link
        toucher = links["free"] or [s for s in moving if scene.frames[s] == tip]
        hand = [s for s in moving if s not in toucher]
        places = [(T_start, bit(Phase.APPROACH), bit(Phase.TRANSIT))]
        if T_end is not None:
            places.append((T_end, bit(Phase.RETREAT), 0))
        for T, near, far in places:
            standing = scene.add_set(self.object, transformed(own, T), 0)
            scene.keep_apart(hand, standing, OBJECT_CLEARANCE, near | far)
            scene.keep_apart(toucher, standing, fingers, near)
            if far:
                scene.keep_apart(toucher, standing, OBJECT_CLEARANCE, far)
        carried = transformed(own, multiply(self.T_tip_ee, inverse(contact.T_obj_ee)))
        extent = np.linalg.norm(carried.center, axis=1) + carried.bound
        held = scene.add_set(self.object, carried, tip, self.arm.speed(extent.max()))
        upper = [s for s in links["link"] if scene.frames[s] < tip]
        scene.keep_apart(upper, held, OBJECT_CLEARANCE, bit(Phase.HOLD))
        ends = [T_start] if T_end is None else [T_start, T_end]
        for name, shapes in static.items():
            margin = HELD_CLEARANCE
            if name in self.scene.bodies:
                other, T_other = body_set(self.scene.bodies[name]), self.state.poses[name]
                margin = min(margin, *(set_distance(own, T, other, T_other, HELD_CLEARANCE) for T in ends))
            scene.keep_apart(held, shapes, margin - TOUCH_ALLOWANCE, CARRIED)


def posed_links(robot: Robot, q: np.ndarray, opening: float):
    """Links of a robot standing at q (n,) as (name, world vertices (m, 3), radius, bounding sphere, edges)."""
    arm = load_arm(robot.model)
    R, p = arm.frames(q)
    posed = []
    for hull in arm.hulls:
        center, bound = hull.sphere_at(opening)
        vertices = apply(robot.base_pose, hull.at(opening) @ R[hull.frame].T + p[hull.frame])
        center = apply(robot.base_pose, R[hull.frame] @ center + p[hull.frame])
        posed.append((hull.link, vertices, hull.radius, (center, bound), hull.edges))
    return posed
