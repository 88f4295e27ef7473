"""One robot and one object: the segments between them as problems, and their one-step sub-problems for contact checks.

Contacts and motions from one state share what does not differ between them: the workspace, the collision models of
contacts that open alike, and the packed one-step problems.
"""

from collections import OrderedDict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hmap_core.collision.scene_model import CollisionModel
from hmap_core.kinematics.arm import Arm, load_arm
from hmap_core.kinematics.model import KinematicModel
from hmap_core.komo.clearances import Clearances
from hmap_core.komo.features.pose import pose_params
from hmap_core.komo.options import IK_OPTIONS, SolverOptions
from hmap_core.komo.segment import Phase, free_opening, hand_skeleton, mode_skeleton, transit_skeleton
from hmap_core.komo.skeleton import Skeleton
from hmap_core.komo.skeleton_problem import SkeletonProblem
from hmap_core.komo.timeline import Timeline
from hmap_core.komo.workspace import Workspace
from hmap_core.transforms import IDENTITY
from hmap_core.types import ContactKind, ContactPoint, Scene, SceneState

WORKSPACES_KEPT = 8  # for the next contact or motion in the same state


# A workspace, its packed one-step problems by phase, and what else was computed of its state, by any key.
Shared = tuple[Workspace, dict[Phase, SkeletonProblem], dict[tuple, Any]]
_SHARED: OrderedDict[tuple, Shared] = OrderedDict()  # the last WORKSPACES_KEPT


def _shared(scene: Scene, state: SceneState, robot: str) -> Shared:
    """The workspace of one moving robot in a scene; contacts and motions from one state share it."""
    states = (values.items() for values in (state.q, state.poses))
    placed = tuple((name, value.tobytes()) for values in states for name, value in values)
    key = id(scene), robot, placed, tuple(state.gripper.items())
    known = _SHARED.get(key)
    if known is None:
        # it holds the scene, so that no other one gets its id
        known = _SHARED[key] = Workspace(scene, state.copy(), [robot]), {}, {}
        if len(_SHARED) > WORKSPACES_KEPT:
            _SHARED.popitem(last=False)
    return known


@dataclass
class Manipulation:
    """A robot about to handle an object in a scene.

    Attributes:
        scene, state: where everything is before the segment.
        robot: name of the robot that moves; the others stand still.
        object: name of the object that it handles; None: it only moves.
        workspace: the robot in the scene.
    """

    scene: Scene
    state: SceneState
    robot: str
    object: str | None
    arm: Arm = field(init=False)
    model: KinematicModel = field(init=False)
    workspace: Workspace = field(init=False)

    def __post_init__(self):
        self.arm = load_arm(self.scene.robots[self.robot].model)
        self.workspace, self._ik, self._known = _shared(self.scene, self.state, self.robot)
        self.model = self.workspace.model
        self.tip, self.T_tip_ee = self.workspace.end_effector(self.robot)
        self._near: dict[tuple, CollisionModel] = {}

    @property
    def handled(self) -> str:
        """Name of the object that the robot handles.

        Raises:
            ValueError: the robot only moves.
        """
        if self.object is None:
            raise ValueError(f"'{self.robot}' handles no object")
        return self.object

    def target(self, T_world_ee: np.ndarray) -> np.ndarray:
        """Parameters of the relative_pose feature that bring the end-effector to a world pose (7,)."""
        return pose_params(self.T_tip_ee, T_world_ee)

    def known(self, key: tuple, compute: Callable[[], Any]) -> Any:
        """What is computed of the scene and the state, once; contacts and motions from one state share it."""
        if key not in self._known:
            self._known[key] = compute()
        return self._known[key]

    # --- problems

    def problem(
        self,
        skeleton: Skeleton,
        steps_per_phase: Sequence[int],
        options: SolverOptions,
        T_start: np.ndarray | None = None,
        collisions: CollisionModel | None = None,
    ) -> SkeletonProblem:
        """The problem of a skeleton of this robot and object.

        Args:
            T_start: (7,) where the object stands at the start; by default as in the state.
            collisions: what keeps apart, where that is known already; by default it follows from the modes.
        """
        start = {} if T_start is None else {self.handled: T_start}
        return SkeletonProblem(skeleton, self.workspace, steps_per_phase, options, start, collisions)

    def ik_problem(self, collisions: CollisionModel, phase: Phase) -> SkeletonProblem:
        """The one-step problem of bringing the end-effector to a pose in a phase; packed once."""
        if phase not in self._ik:
            skeleton = hand_skeleton(self.robot, IDENTITY, phase)
            steps = (0,) * int(phase) + (1,)
            problem = self._ik[phase] = self.problem(skeleton, steps, IK_OPTIONS, collisions=collisions)
            problem.packed()
        return self._ik[phase].among(collisions)

    # --- what keeps apart

    def collisions(
        self, contact: ContactPoint, T_start: np.ndarray, T_end: np.ndarray, path: np.ndarray | None = None
    ) -> CollisionModel:
        """What keeps apart in each phase of a segment in which the object goes from T_start to T_end (7,).

        Args:
            path: (K, 7) along which it goes; pairs of its shapes with others that are never near there are left out.
        """
        return self._clearances(contact, T_start, T_end, path).model()

    def carrying_collisions(self, contact: ContactPoint) -> CollisionModel:
        """What :meth:`collisions` says of the hold, without what counts in verification only."""
        return self._clearances(contact, IDENTITY, IDENTITY).model([Phase.HOLD], verified=False)

    def coming_collisions(self, contact: ContactPoint, T_start: np.ndarray) -> CollisionModel:
        """What :meth:`collisions` says of transit and approach; alike for contacts that open alike."""
        return self._standing(contact, T_start, Phase.TRANSIT, Phase.APPROACH)

    def leaving_collisions(self, contact: ContactPoint, T_end: np.ndarray) -> CollisionModel:
        """What it says of the retreat from the object at T_end (7,); alike for contacts that open alike."""
        return self._standing(contact, T_end, Phase.RETREAT)

    def surroundings(self, contact: ContactPoint) -> CollisionModel:
        """The robot in all phases among what stands around, without the object."""
        return self._clearances(contact, IDENTITY, IDENTITY).around.model

    def standing_collisions(self) -> CollisionModel:
        """What keeps apart in a transit alone, with the gripper as it is."""
        skeleton = transit_skeleton(self.robot, self.state.q[self.robot])
        return Clearances(Timeline(skeleton, self.workspace)).model()

    def _standing(self, contact: ContactPoint, T: np.ndarray, *phases: Phase) -> CollisionModel:
        """The object where it stands at T (7,) in some phases."""
        free, touching = free_opening(self.scene.robots[self.robot], contact), contact.kind != ContactKind.GRASP
        key = free, contact.opening, touching, T.tobytes(), phases
        if key not in self._near:
            self._near[key] = self._clearances(contact, T, T).model(phases)
        return self._near[key]

    def _clearances(
        self, contact: ContactPoint, T_start: np.ndarray, T_end: np.ndarray, path: np.ndarray | None = None
    ) -> Clearances:
        skeleton = mode_skeleton(self.robot, self.handled, contact, np.array([T_start, T_end]))
        paths = {} if path is None else {self.handled: path}
        return Clearances(Timeline(skeleton, self.workspace, {self.handled: T_start}), paths)
