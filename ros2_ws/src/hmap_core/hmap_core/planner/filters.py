"""Backends that change which contacts another backend hands out, and in which order."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from hmap_core.exceptions import Code, ContactError
from hmap_core.planner.interfaces import AttachedPath, Backend, RobotContact, ToolGrasp
from hmap_core.planner.local import away_from_home
from hmap_core.planner.obstruction import HAND_MIN_DISTANCE, RelaxedSolution
from hmap_core.planner.sweep import nearest, placed, robot_sweeps
from hmap_core.types import Scene, SceneState


class Filter:
    """A backend that does as another one does."""

    def __init__(self, backend: Backend):
        self._backend = backend
        self.plan_waypoints, self.solve_segment = backend.plan_waypoints, backend.solve_segment
        self.tool_grasps, self.pick_tool, self.place_tool = backend.tool_grasps, backend.pick_tool, backend.place_tool
        self.contacts_at_both_ends = backend.contacts_at_both_ends


class Whole(Filter):
    """A backend that hands out only contacts that carry the object all the way."""

    def propose_contacts(self, scene: Scene, state: SceneState, object: str, poses: np.ndarray, *request):
        """As :meth:`hmap_core.planner.interfaces.Backend.propose_contacts`."""
        contacts = self._backend.propose_contacts(scene, state, object, poses, *request)
        kept = [contact for contact in contacts if contact.reach == len(poses) - 1]
        if not kept:
            raise ContactError(f"none of {len(contacts)} contacts carries '{object}' all the way", Code.NO_CONTACT)
        return kept


class Considerate(Filter):
    """A backend that hands out first the contacts in which the robot is in the way of the fewest of some bodies.

    Attributes:
        solved: the contact of the last motion that was found; None where it was made with a tool.
        grip: on that tool.
    """

    def __init__(self, backend: Backend, scene: Scene, names: Sequence[str]):
        super().__init__(backend)
        self.solve_segment, self.pick_tool = self._solve_segment, self._pick_tool
        self._scene, self._names = scene, tuple(names)
        self.solved: RobotContact | None = None
        self.grip: ToolGrasp | None = None

    def propose_contacts(self, scene: Scene, state: SceneState, *request) -> list[RobotContact]:
        """As :meth:`hmap_core.planner.interfaces.Backend.propose_contacts`."""
        contacts = self._backend.propose_contacts(scene, state, *request)
        bodies = placed(self._scene, state, self._names)
        return sorted(contacts, key=lambda contact: len(self._hit(scene, contact, bodies)))

    def _solve_segment(self, scene: Scene, state: SceneState, object: str, contact: RobotContact, *request):
        motion = self._backend.solve_segment(scene, state, object, contact, *request)
        self.solved = contact if scene.robots[contact.robot].model.attached is None else None
        return motion

    def _pick_tool(self, scene: Scene, state: SceneState, grip: ToolGrasp, *request):
        motion = self._backend.pick_tool(scene, state, grip, *request)
        self.grip = grip
        return motion

    def _hit(self, scene: Scene, contact: RobotContact, bodies) -> dict[str, float]:
        openings = np.full(len(contact.keyframes), contact.contact.opening)
        sweeps = robot_sweeps(scene.robots[contact.robot], contact.keyframes, openings)
        return nearest(sweeps, bodies, HAND_MIN_DISTANCE)


class Reminded(Filter):
    """A backend that hands out what is known to work before it looks for others.

    Args:
        known: a contact for the poses (M, 7) of the object, or a grip on a tool.
    """

    def __init__(self, backend: Backend, known: RelaxedSolution, poses: np.ndarray):
        super().__init__(backend)
        self.tool_grasps = self._tool_grasps
        self._contact, self._grip, self._poses = known.contact, known.grip, poses

    def propose_contacts(self, scene: Scene, state: SceneState, object: str, poses: np.ndarray, *request):
        """As :meth:`hmap_core.planner.interfaces.Backend.propose_contacts`."""
        known, self._contact = self._contact, None
        if known is None or not np.array_equal(poses, self._poses):
            return self._backend.propose_contacts(scene, state, object, poses, *request)
        return [replace(known, clear=away_from_home(scene, state, known.robot))]

    def _tool_grasps(self, scene: Scene, state: SceneState, object: str, poses: np.ndarray, *request):
        known, self._grip = self._grip, None
        if known is None or not np.array_equal(state.poses[known.tool], known.T_place):
            return self._backend.tool_grasps(scene, state, object, poses, *request)
        return [(known, len(poses) - 1)]


class InHand(Filter):
    """A backend that hands out the contact of a held path only, once for each path that it serves to the end."""

    def __init__(self, backend: Backend, held: AttachedPath):
        super().__init__(backend)
        self.tool_grasps = self._no_tool_grasps
        self._held = held
        self._handed_out: set[bytes] = set()

    def propose_contacts(self, scene: Scene, state: SceneState, object: str, poses: np.ndarray, *request):
        """As :meth:`hmap_core.planner.interfaces.Backend.propose_contacts`."""
        held, key, found = self._held, poses.tobytes(), []
        if key not in self._handed_out:
            self._handed_out.add(key)
            rng = np.random.default_rng(0)
            found = self._backend.check_contacts(scene, state, object, poses, held.robot, [held.contact], rng)
        found = [contact for contact in found if contact.reach == len(poses) - 1]
        if not found:
            raise ContactError(f"the hand of '{held.robot}' does not carry '{object}' all the way", Code.NO_CONTACT)
        return found

    def _no_tool_grasps(self, *request) -> list:
        return []
