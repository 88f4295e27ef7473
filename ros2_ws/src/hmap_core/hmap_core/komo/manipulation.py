"""One robot and one object through the phases of an H-MaP segment: what may touch what."""

from collections import OrderedDict
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from hmap_core.collision.convex import ConvexSet, transformed
from hmap_core.collision.grown import GrownModel
from hmap_core.collision.scene_model import CollisionModel
from hmap_core.kinematics.arm import Arm, load_arm
from hmap_core.kinematics.model import KinematicModel
from hmap_core.komo.features.pose import pose_params, relative_pose
from hmap_core.komo.min_distances import HELD_CLEARANCE, OBJECT_CLEARANCE, TOUCH_ALLOWANCE
from hmap_core.komo.objective import Objective, ObjectiveType
from hmap_core.komo.options import IK_OPTIONS
from hmap_core.komo.surroundings import Surroundings
from hmap_core.komo.transcription import KomoProblem
from hmap_core.komo.workspace import Workspace
from hmap_core.transforms import IDENTITY, inverse, multiply, pose
from hmap_core.types import ContactKind, ContactPoint, Robot, Scene, SceneState

# how far the hand draws back from a contact, m
GRASP_RETREAT = 0.10
TOUCH_RETREAT = 0.05
# how much wider than the object each side of the gripper opens, m
OPENING_CLEARANCE = 0.008
WORKSPACES_KEPT = 8  # for the next contact or motion in the same state


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
# In which phases the hand is near the object, and in which far from it: where that is taken, and where it is left.
COMING, LEAVING = (bit(Phase.APPROACH), bit(Phase.TRANSIT)), (bit(Phase.RETREAT), 0)
# What a carried object must not hit counts only where paths are verified: the path of the object itself was planned
# free, and a hold follows it pose by pose.
CARRIED = 1 << len(Phase)


def retreat_distance(contact: ContactPoint) -> float:
    """How far from the contact the approach begins and the retreat ends, m."""
    return GRASP_RETREAT if contact.kind == ContactKind.GRASP else TOUCH_RETREAT


def free_opening(robot: Robot, contact: ContactPoint) -> float:
    """Gripper opening while coming and going, m."""
    gripper = robot.model.gripper
    if robot.model.attached is not None:
        return robot.model.attached.opening
    if gripper is None or contact.kind != ContactKind.GRASP:
        return contact.opening
    return min(gripper.open_opening, contact.opening + 2 * OPENING_CLEARANCE)


def retreated(contact: ContactPoint, fraction: float = 1.0) -> np.ndarray:
    """T_obj_ee (7,) with the hand drawn back along its approach by a fraction of the retreat distance."""
    return multiply(contact.T_obj_ee, pose(-fraction * retreat_distance(contact) * contact.approach))


_WORKSPACES: OrderedDict[tuple, Workspace] = OrderedDict()  # the last WORKSPACES_KEPT


def _workspace(scene: Scene, state: SceneState, robot: str) -> Workspace:
    """The workspace of one moving robot in a scene; contacts and motions from one state share it."""
    states = (values.items() for values in (state.q, state.poses))
    placed = tuple((name, value.tobytes()) for values in states for name, value in values)
    key = id(scene), robot, placed, tuple(state.gripper.items())
    known = _WORKSPACES.get(key)
    if known is None:
        # it holds the scene, so that no other one gets its id
        known = _WORKSPACES[key] = Workspace(scene, state.copy(), [robot])
        if len(_WORKSPACES) > WORKSPACES_KEPT:
            _WORKSPACES.popitem(last=False)
    return known


@dataclass
class Manipulation:
    """A robot about to handle an object in a scene.

    Attributes:
        scene, state: where everything is before the segment.
        robot: name of the robot that moves; the others stand still.
        object: name of the object that it handles; None: it only moves.
    """

    scene: Scene
    state: SceneState
    robot: str
    object: str | None
    arm: Arm = field(init=False)
    model: KinematicModel = field(init=False)

    def __post_init__(self):
        self.arm = load_arm(self.scene.robots[self.robot].model)
        self._workspace = _workspace(self.scene, self.state, self.robot)
        self.model = self._workspace.model
        self.tip, self.T_tip_ee = self._workspace.end_effector(self.robot)
        self._near: dict[tuple, CollisionModel] = {}
        self._ik: dict[Phase, KomoProblem] = {}

    def target(self, T_world_ee: np.ndarray) -> np.ndarray:
        """Parameters of the relative_pose feature that bring the end-effector to a world pose (7,)."""
        return pose_params(self.T_tip_ee, T_world_ee)

    def ik_problem(self, collisions: CollisionModel, phase: Phase) -> KomoProblem:
        """The one-step problem of bringing the end-effector to a pose in a phase; what it is asked is packed once."""
        if phase not in self._ik:
            problem = KomoProblem(self.model.chain, (0,) * int(phase) + (1,), collisions, IK_OPTIONS)
            problem.add(Objective(relative_pose(self.tip, IDENTITY, IDENTITY), ObjectiveType.EQ, [0]))
            problem.packed()
            self._ik[phase] = problem
        return self._ik[phase].among(collisions)

    def collisions(self, contact: ContactPoint, T_start: np.ndarray, T_end: np.ndarray | None = None) -> CollisionModel:
        """What keeps apart from what in each phase, for an object that goes from T_start to T_end (7,)."""
        around = self._around(free_opening(self.scene.robots[self.robot], contact), contact.opening)
        model = GrownModel(around.model)
        self._add_standing(model, around, contact, T_start, T_end)
        self._add_held(model, around, contact, [T_start] if T_end is None else [T_start, T_end])
        return model

    def carrying_collisions(self, contact: ContactPoint) -> CollisionModel:
        """What :meth:`collisions` says of the hold but for what the object must not hit."""
        around = self._around(free_opening(self.scene.robots[self.robot], contact), contact.opening)
        model = GrownModel(around.model)
        self._add_in_hand(model, around, contact)
        return model

    def coming_collisions(self, contact: ContactPoint, T_start: np.ndarray) -> CollisionModel:
        """What :meth:`collisions` says of the way to the object at T_start (7,); alike for contacts open alike."""
        return self._with_object(contact, T_start, *COMING)

    def leaving_collisions(self, contact: ContactPoint, T_end: np.ndarray) -> CollisionModel:
        """What it says of the retreat from the object at T_end (7,); alike for contacts open alike."""
        return self._with_object(contact, T_end, *LEAVING)

    def _with_object(self, contact: ContactPoint, T: np.ndarray, near: int, far: int) -> CollisionModel:
        """With the object at T (7,), by which the hand is near and far in phases given as bit masks."""
        free, touching = free_opening(self.scene.robots[self.robot], contact), contact.kind != ContactKind.GRASP
        key = free, contact.opening, touching, T.tobytes(), near
        if key not in self._near:
            around = self._around(free, contact.opening)
            model = self._near[key] = GrownModel(around.model)
            self._add_places(model, around, contact, [(T, near, far)])
        return self._near[key]

    def surroundings(self, contact: ContactPoint) -> CollisionModel:
        """The same without the object."""
        return self._around(free_opening(self.scene.robots[self.robot], contact), contact.opening).model

    def standing_collisions(self, T_obj: np.ndarray | None = None) -> CollisionModel:
        """What keeps apart while the robot moves in the air with its gripper as it is, the object standing at T_obj."""
        opening = self.state.gripper[self.robot]
        around = self._around(opening, opening)
        model = GrownModel(around.model)
        if self.object is None:
            return model
        arm, fingers, linkage = around.arms[self.robot], around.fingers[self.robot], around.linkages[self.robot]
        moving = arm.upper + arm.hand + sum((part[0].shapes for part in (fingers, linkage) if part), ())
        standing = model.add_set(self.object, transformed(self._own, T_obj), 0)
        model.keep_apart(moving, standing, OBJECT_CLEARANCE, FREE)
        return model

    @property
    def _own(self) -> ConvexSet:
        return self._workspace.shapes[self.object]

    def _around(self, opening: float, contact_opening: float) -> Surroundings:
        """The arm among what stands around; its fingers once as open as they come, once as they hold."""
        openings = (opening, FREE), (contact_opening, bit(Phase.HOLD))
        handled = frozenset() if self.object is None else frozenset([self.object])
        return self._workspace.surroundings(handled, ((self.robot, openings),))

    def _add_standing(self, model: CollisionModel, around: Surroundings, contact: ContactPoint, T_start, T_end) -> None:
        """The object where it is taken and where it is left."""
        places = [(T_start, *COMING)]
        if T_end is not None:
            places.append((T_end, *LEAVING))
        self._add_places(model, around, contact, places)

    def _add_places(self, model: CollisionModel, around: Surroundings, contact: ContactPoint, places) -> None:
        """The object in places (7,), each with the bit masks of phases in which the hand is near and far from there."""
        arm, fingers, linkage = around.arms[self.robot], around.fingers[self.robot], around.linkages[self.robot]
        touching = contact.kind != ContactKind.GRASP
        min_distance = -TOUCH_ALLOWANCE if touching else OBJECT_CLEARANCE
        # an arm without fingers touches with its last link
        toucher, hand = (fingers[0].shapes, arm.upper + arm.hand) if fingers else (arm.hand, arm.upper)
        hand += linkage[0].shapes if linkage else ()
        for T, near, far in places:
            standing = model.add_set(self.object, transformed(self._own, T), 0)
            model.keep_apart(hand, standing, OBJECT_CLEARANCE, near | far)
            model.keep_apart(toucher, standing, min_distance, near)
            if linkage and not touching:  # nor does it meet the object once the gripper has closed
                model.keep_apart(linkage[1].shapes, standing, OBJECT_CLEARANCE, near)
            if far:
                model.keep_apart(toucher, standing, OBJECT_CLEARANCE, far)

    def _add_held(self, model: CollisionModel, around: Surroundings, contact: ContactPoint, ends) -> None:
        """The object on the hand, between two places (7,)."""
        held = self._add_in_hand(model, around, contact)
        nearest = around.nearest(self._own, ends, HELD_CLEARANCE)
        for name, shapes in around.standing.items():
            min_distance = nearest.get(name, HELD_CLEARANCE) if name in self.scene.bodies else HELD_CLEARANCE
            model.keep_apart(held, shapes, min_distance - TOUCH_ALLOWANCE, CARRIED)

    def _add_in_hand(self, model: CollisionModel, around: Surroundings, contact: ContactPoint) -> list[int]:
        """The object on the hand, which its own arm must not hit; the numbers of its shapes."""
        arm = around.arms[self.robot]
        carried = transformed(self._own, multiply(self.T_tip_ee, inverse(contact.T_obj_ee)))
        held = model.add_set(self.object, carried, self.tip, self._workspace.speed(self.robot, carried))
        model.keep_apart(arm.base + arm.upper, held, OBJECT_CLEARANCE, bit(Phase.HOLD))
        return held
