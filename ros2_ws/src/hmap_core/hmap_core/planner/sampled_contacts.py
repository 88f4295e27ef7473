"""Contacts sampled on the surface of an object: the sampling half of Algorithm 3."""

from collections import OrderedDict
from collections.abc import Iterator
from itertools import chain

import numpy as np

from hmap_core.contacts.access import accessible
from hmap_core.contacts.camera import SKIN, Cloud, visible_points
from hmap_core.contacts.candidates import Hand, Situation
from hmap_core.contacts.feasibility import reach_bounds
from hmap_core.contacts.free_rotation import reached_frames
from hmap_core.contacts.grasp_torque import pad_balance, push_torque_ratio
from hmap_core.contacts.hand import align_pads, drawn_back, drop_unfit_grasps, hand_of
from hmap_core.contacts.press import SlidingSupport
from hmap_core.contacts.sampler import sample_contacts
from hmap_core.contacts.solids import solids
from hmap_core.deadline import check_time
from hmap_core.kinematics.arm import ALL_DIRECTIONS, load_arm
from hmap_core.komo.manipulation import Manipulation
from hmap_core.planner.nearby_shapes import box_of, shapes_in_box
from hmap_core.planner.protocols import ContactProposals, ContactQuery
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.transforms import multiply, rotation_matrix
from hmap_core.types import Body, ContactPoint, Robot, Scene, SceneState, TaskMode

SURFACE_POINTS = 600  # samples of the object's surface
BATCH = 240  # contacts in a batch
MAX_CONTACTS = 480  # proposed for one robot
ACCESS = 0.002  # m of room before a point of the surface that an arm without fingers, or a tool, needs
PAD_BALANCE = 0.5  # of a finger's pad on an object: the narrower side of its middle to the wider
MORE_CONTACTS = 6000  # that are looked at by the hand alone where none of these serves
PLACE_SEED = 0  # of the contacts that are looked at by the hand alone
PLACES_KEPT = 64  # for which these are kept
STEP = 0.01  # m of the object's path for which these are ranked
TURNS = 1e-6  # how much less than 1 the product of two unit quaternions is where an object counts as turned
TURNING_SHARE = 0.7  # of the friction against turning between the fingers that weight or pushing may use


class SampledContacts:
    """Implements :class:`hmap_core.planner.protocols.ContactProposer`.

    Batches come from the measured cloud first, then from the points of the known surface that cameras see, then from
    the rest of that surface, then grasps across a gap between two walls. Within each, contacts are ranked by the score
    of the sampler. Last come those of the others that the hand alone can make where the object is.

    Args:
        uniform: contacts come in a random order instead, as a data set needs them.
    """

    name = "sampled"

    def __init__(self, uniform: bool = False):
        self._uniform = uniform

    def propose(self, query: ContactQuery) -> Iterator[ContactProposals]:
        """Yield batches of at most BATCH contacts, MAX_CONTACTS from each source."""
        scene, placed, poses = query.scene, query.scene.robots[query.robot], query.object_poses
        surface = query.surface
        if surface is None:
            surface = sampled_surface(scene, query.state, query.object, poses[0], query.rng)
        hand = hand_of(placed)
        ahead = poses[1] if len(poses) > 1 else None
        limited = load_arm(placed.model).mobility < ALL_DIRECTIONS
        home = _home_orientation(placed) if limited else None
        situation = Situation(poses[0], ahead, placed.base_pose[:3], home, support_friction(query, poses))
        body, total = scene.bodies[query.object], 0
        for batches in self._sources(query, hand, surface, situation, query.rng):
            for batch in batches:
                total += len(batch)
                check_time()
                if limited:
                    manipulation = Manipulation(scene, query.state, query.robot, query.object)
                    batch = reached_frames(manipulation, body, hand, batch, poses, query.rng)
                yield ContactProposals(tuple(self._sound(query, batch)))
                if total >= MAX_CONTACTS:
                    break
        if not limited:
            yield ContactProposals(())
            free = self._free_for_hand(query)
            if free:
                yield ContactProposals(tuple(free))

    def _sources(
        self, query: ContactQuery, hand: Hand, surface: Cloud, situation: Situation, rng: np.random.Generator
    ) -> Iterator[Iterator[list[ContactPoint]]]:
        """Batches of contacts by where they come from: measured, seen, not seen, across a gap between two walls."""
        scene, T = query.scene, query.object_poses[0]
        body = scene.bodies[query.object]
        room = ACCESS if hand.gripper is None else hand.gripper.pad_half_width
        check_time()
        near = box_of(body, T) + (room + SKIN) * np.array([[-1.0], [1.0]])
        others = shapes_in_box(_others(scene, query.state, query.object), near)
        around = solids([(shape, pose) for other, pose in others for shape in other.shapes])
        check_time()
        surface = surface[accessible(surface, T, around, room)]
        sources = (query.cloud, False), (surface[surface.seen], False), (surface[~surface.seen], False), (surface, True)
        for points, spanning in sources:
            if points is not None and len(points):
                yield sample_contacts(body, points, hand, scene.mode, situation, rng, BATCH, spanning, self._uniform)

    def _free_for_hand(self, query: ContactQuery) -> list[ContactPoint]:
        """Those of thousands of contacts which the hand alone can make where the object is.

        They are found once for all paths that begin alike: their random numbers are those of the place, not of the
        query. What was measured of the object is looked at each time.
        """
        manipulation = Manipulation(query.scene, query.state, query.robot, query.object)
        way = first_direction(query.object_poses)
        if query.cloud is not None or way is None:
            ahead = query.object_poses[1] if len(query.object_poses) > 1 else None
            return self._looked_through(query, manipulation, ahead, query.rng)
        key = self._uniform, way.tobytes(), *_place(query)
        known = _FREE.get(key)
        if known is None:
            T = query.object_poses[0]
            ahead = np.concatenate([T[:3] + STEP * way, T[3:]]) if way.any() else None
            free = self._looked_through(query, manipulation, ahead, np.random.default_rng(PLACE_SEED))
            known = _FREE[key] = query.scene, free  # it holds the bodies, so that no others get their ids
            if len(_FREE) > PLACES_KEPT:
                _FREE.popitem(last=False)
        return known[1]

    def _looked_through(
        self, query: ContactQuery, manipulation: Manipulation, ahead: np.ndarray | None, rng: np.random.Generator
    ) -> list[ContactPoint]:
        """The contacts that the hand alone can make, of MORE_CONTACTS.

        The object goes on to the pose ``ahead`` (7,), if any.

        In narrow places few of thousands can. Grasps that it cannot make are looked at once more with less of the pads
        on the object: the hand then is farther out.
        """
        robot, T = query.scene.robots[query.robot], query.object_poses[0]
        hand = hand_of(robot)
        gripper = hand.gripper
        surface = sampled_surface(query.scene, query.state, query.object, T, rng)
        friction = support_friction(query, T[None])
        situation = Situation(T, ahead, robot.base_pose[:3], support_friction=friction)
        free: list[ContactPoint] = []
        looked = 0
        for batch in chain.from_iterable(self._sources(query, hand, surface, situation, rng)):
            looked += len(batch)
            placed = batch if gripper is None else align_pads(batch, gripper)
            bound = reach_bounds(manipulation, placed, query.object_poses[:1])
            free += self._sound(query, [contact for contact, far in zip(batch, bound, strict=True) if far >= 0])
            blocked = [contact for contact, far in zip(batch, bound, strict=True) if far < 0]
            back = [] if gripper is None else drawn_back(blocked, gripper)
            if gripper is not None and back:
                bound = reach_bounds(manipulation, align_pads(back, gripper), query.object_poses[:1])
                free += self._sound(query, [contact for contact, far in zip(back, bound, strict=True) if far >= 0])
            if len(free) >= BATCH or looked >= MORE_CONTACTS:
                break
        return free

    def _sound(self, query: ContactQuery, batch: list[ContactPoint]) -> list[ContactPoint]:
        """The contacts whose fingers, or tool, hold on the object."""
        check_time()
        scene, placed = query.scene, query.scene.robots[query.robot]
        body, hand = scene.bodies[query.object], hand_of(placed)
        if hand.attached is not None and scene.mode == TaskMode.PHYSICAL:
            share = push_torque_ratio(hand.attached, placed.model.require_gripper(), body, batch)
            return [c for c, used in zip(batch, share, strict=True) if used <= TURNING_SHARE]
        if hand.gripper is not None:
            even = pad_balance(body, batch, hand.gripper)
            batch = [c for c, share in zip(batch, even, strict=True) if share >= PAD_BALANCE]
            check_time()
            return drop_unfit_grasps(body, align_pads(batch, hand.gripper), placed)
        return batch


_FREE: OrderedDict[tuple, tuple[Scene, list[ContactPoint]]] = OrderedDict()  # the last PLACES_KEPT


def support_friction(query: ContactQuery, object_poses: np.ndarray) -> float | None:
    """The highest friction coefficient of what the object slides on along poses (M, 7); None if on nothing level."""
    around = placed_bodies(query.scene, query.state, query.object)
    support = SlidingSupport.of(query.scene.bodies[query.object], object_poses, around)
    return support.friction if support.tops else None


def _place(query: ContactQuery) -> tuple:
    """What the contacts depend on that a hand alone can make; not where its own arm is."""
    scene, state = query.scene, query.state
    bodies = tuple((name, id(body), state.poses[name].tobytes()) for name, body in scene.bodies.items())
    others = tuple(
        (name, id(robot), state.gripper[name], state.q[name].tobytes())
        for name, robot in scene.robots.items()
        if name != query.robot
    )
    own = query.robot, id(scene.robots[query.robot]), query.object, query.object_poses[0].tobytes()
    return own, scene.mode, id(scene.cameras), bodies, others


def first_direction(poses: np.ndarray) -> np.ndarray | None:
    """The direction (3,) in which a path (M, 7) begins, its largest number 1, each rounded to -1, 0 or 1.

    Zero for a path of one pose, and where the object stays; None if the object turns first.
    """
    if len(poses) == 1:
        return np.zeros(3)
    if abs(float(poses[0, 3:] @ poses[1, 3:])) < 1.0 - TURNS:
        return None
    way = poses[1, :3] - poses[0, :3]
    length = float(np.abs(way).max())
    return np.round(way / length) + 0.0 if length > 0.0 else np.zeros(3)


def _home_orientation(robot: Robot) -> np.ndarray:
    """Orientation (3, 3) of the hand with the robot at home, world frame."""
    T_world_ee = multiply(robot.base_pose, load_arm(robot.model).end_effector(robot.model.home))
    return rotation_matrix(T_world_ee)


def sampled_surface(scene: Scene, state: SceneState, object: str, T_world_obj: np.ndarray, rng) -> Cloud:
    """Sample points on the known surface of an object.

    Args:
        scene, state: the world, and where everything is.
        object: name of the object.
        T_world_obj: (7,) its pose.
        rng: the only source of randomness.

    Returns:
        SURFACE_POINTS points in the object's frame, with which of them the cameras of the scene see.
    """
    cameras = scene.cameras.values()
    eyes = [camera.pose[:3] for camera in cameras]
    between = np.concatenate([box_of(scene.bodies[object], T_world_obj), *(eye[None] for eye in eyes)])
    box = np.array([between.min(axis=0), between.max(axis=0)])  # all lines of sight are in it
    around = shapes_in_box(_others(scene, state, object), box)
    return visible_points(scene.bodies[object], T_world_obj, around, cameras, rng, SURFACE_POINTS, include_unseen=True)


def _others(scene: Scene, state: SceneState, object: str) -> list[tuple[Body, np.ndarray]]:
    return [(body, state.poses[name]) for name, body in scene.bodies.items() if name != object]
