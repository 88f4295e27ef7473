"""Lifts a grasped object off its support if it would tip between the fingers when dragged.

The friction of the support acts on the bottom of a dragged object and rotates it about the closing axis until it stands
on its leading edge. It then jams between hand and support, whatever the friction of the pads, if the friction has the
longer lever: mu h > a, with h the height of the grasp above the support and a the distance of the edge ahead of it. An
object whose path rises anyway, or comes from one support to another one, leaves its support upwards and reaches the
next one from above, since a level motion would hit its edge. It passes over the edges of both with ROOM, since objects
sag between soft pads by some degrees.
"""

from dataclasses import replace

import numpy as np

from hmap_core.collision.convex import set_distance
from hmap_core.contacts.feasibility import carried
from hmap_core.contacts.grasp_torque import weight_torque_ratio
from hmap_core.contacts.grip_force import lifting_problem, weight_ratio
from hmap_core.contacts.press import SlidingSupport, edge_depths
from hmap_core.contacts.push import SlidingBody
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.shapes import body_set
from hmap_core.planner.interfaces import RobotContact
from hmap_core.transforms import multiply, pose, rotation_matrices, rotation_matrix
from hmap_core.types import Body, ContactKind, ContactPoint, Scene, SceneState
from hmap_core.waypoints import DEFAULT_MIN_DISTANCE, ObjectPathProblem
from hmap_core.waypoints.checker import Geometry, ObjectChecker

LIFT = 0.01  # m off the support
ROOM = 0.008  # m from its supports that an object keeps on its way between them, where it can rise by LIFT
TOUCHED = 1e-3  # m from a body that supports an object
RISE = 3  # steps of a straight way up
SAME_HEIGHT = 1e-3  # m; a path that is lower has left the support


def lifted(
    scene: Scene,
    state: SceneState,
    object: str,
    contact: RobotContact,
    poses: np.ndarray,
    obstacles: tuple[Body, ...],
    turning: float,
) -> tuple[RobotContact, np.ndarray]:
    """The contact, and poses (M, 7) that keep the object LIFT above its supports at both ends, or else at one end.

    Contact and poses are unchanged if the object can be dragged, if there is no room to lift it, if the arm cannot lift
    it, or if its weight is too much for grip or arm, or needs more than the share ``turning`` of the friction against
    rotation between the pads.
    """
    body, own = scene.bodies[object], contact.contact
    gripper = scene.robots[contact.robot].model.gripper
    if own.kind != ContactKind.GRASP or gripper is None or scene.robots[contact.robot].model.attached is not None:
        return contact, poses
    head, tail = _low(poses), _low(poses[::-1])
    flies, pads = np.ptp(poses[:, 2]) > LIFT or crosses(body, poses, obstacles), gripper.reach_at(own.opening)
    ends = poses[:head], poses[::-1][:tail][::-1]
    if not (flies or any(drag_tips(body, own, end, pads) for end in ends)):
        return contact, poses
    model, up = scene.robots[contact.robot].model, rotation_matrix(poses[0])[2]
    if lifting_problem(body, contact.robot, model) or weight_ratio(body, [own], model, up)[0] > 1.0:
        return contact, poses
    if weight_torque_ratio(body, [own], gripper, up)[0] > turning:
        return contact, poses
    problem = ObjectPathProblem(body, poses[0], poses[-1], obstacles)
    checker = ObjectChecker(problem, Geometry(problem), False, DEFAULT_MIN_DISTANCE)
    manipulation = Manipulation(scene, state, contact.robot, object)
    last = np.arange(len(poses)) == len(poses) - 1
    higher = raised(poses, head, tail)
    between = slice(head, len(poses) - tail)
    ways = [higher, raised(poses, 0, tail), raised(poses, head, 0)]
    if flies and _passes_closely(body, higher, between, obstacles):
        ways.insert(0, higher.copy())
        ways[0][between, 2] += LIFT
    for higher in ways:
        if np.array_equal(higher, poses):
            continue
        if not all(checker.motion_free(a, b) for a, b in zip(higher, higher[1:], strict=False)):
            continue
        keyframes = carried(manipulation, own, contact.keyframes[0], higher, last)
        if len(keyframes) == len(poses):
            return replace(contact, keyframes=keyframes), higher
    return contact, poses


def crosses(body: Body, poses: np.ndarray, around: tuple[Body, ...]) -> bool:
    """Whether a body comes over the edge of a support on which it did not stand at first, along level poses (M, 7)."""
    slide, tops = SlidingBody(body, poses[0]), SlidingSupport.of(body, poses, around).tops
    if len(tops) < 2 or not slide.footprint:
        return False
    turns = (rotation_matrices(poses) @ slide.level.T)[:, :2, :2]

    def over(k: int) -> list[bool]:
        feet = [foot @ turns[k].T + poses[k, :2] for foot in slide.footprint]
        return [any(not (_beside(foot, top) or _beside(top, foot)) for foot in feet) for top in tops]

    first = over(0)
    return any(now and not before for k in range(1, len(poses)) for now, before in zip(over(k), first, strict=True))


def _beside(polygon: np.ndarray, other: np.ndarray) -> bool:
    """Whether a polygon (n, 2) is beyond one of the edges of a convex, counter-clockwise one, or touches it there."""
    return bool((edge_depths(other, polygon).max(axis=0) <= TOUCHED).any())


def drag_tips(body: Body, contact: ContactPoint, poses: np.ndarray, pads: float = 0.0) -> bool:
    """Whether a body that is dragged by a grasp over its support, along poses (M, 7), tips between the fingers.

    The pads are ``pads`` metres along the approach from the end-effector frame.
    """
    if len(poses) < 2:
        return False
    slide = SlidingBody(body, poses[0])
    if not slide.footprint:
        return False
    grip = slide.level @ multiply(contact.T_obj_ee, pose((0.0, 0.0, pads)))[:3]
    closing = slide.level @ rotation_matrix(contact.T_obj_ee)[:, 1]
    corners = np.concatenate(slide.footprint) - grip[:2]
    for twists in slide.twists(poses):
        way = np.zeros(2) if twists is None else twists[0, :2]
        size = np.linalg.norm(way)
        if size == 0.0:
            continue
        way = way / size
        lever = body.friction * (grip[2] - slide.lowest) * abs(closing[1] * way[0] - closing[0] * way[1])
        if lever > (corners @ way).max():
            return True
    return False


def raised(poses: np.ndarray, head: int, tail: int) -> np.ndarray:
    """Poses (M, 7) of which the first ``head`` and the last ``tail`` are raised, but not the very first and last.

    Where the path goes on below them, the next ones are raised, too, by less and less, so that no step is a leap.
    """
    higher = poses.copy()
    count = len(poses)
    for first, step, count_raised, end in ((head, 1, head, poses[0]), (count - tail - 1, -1, tail, poses[-1])):
        for k in range(RISE if count_raised else 0):
            i = first + step * k
            if not (0 < i < count - 1 and poses[i, 2] < end[2]):
                break
            higher[i, 2] += LIFT * (RISE - k) / (RISE + 1)
    higher[1:head, 2] = np.maximum(higher[1:head, 2], poses[0, 2] + LIFT)
    higher[count - tail : count - 1, 2] = np.maximum(higher[count - tail : count - 1, 2], poses[-1, 2] + LIFT)
    higher[[0, -1]] = poses[[0, -1]]
    return higher


def raised_at_ends(poses: np.ndarray) -> np.ndarray:
    """The poses (M, 7) and some more, so that the path leaves the support at its start straight upwards, and reaches
    the one at its end straight from above.
    """
    higher = raised(poses, _low(poses), _low(poses[::-1]))
    up = np.outer(np.linspace(0.0, LIFT, RISE + 1), np.eye(7)[2])
    return np.concatenate([higher[0] + up, higher[1:-1], (higher[-1] + up)[::-1]])


def _passes_closely(body: Body, poses: np.ndarray, between: slice, obstacles: tuple[Body, ...]) -> bool:
    """Whether a body comes nearer than ROOM to one of its supports at both ends, ``between`` these poses (M, 7)."""
    own, ends = body_set(body), poses[[0, -1]]
    for other in obstacles:
        around, T_other = body_set(other), other.pose
        if all(set_distance(own, T, around, T_other, 2.0 * TOUCHED) > TOUCHED for T in ends):
            continue
        if any(set_distance(own, T, around, T_other, 2.0 * ROOM) < ROOM for T in poses[between]):
            return True
    return False


def _low(poses: np.ndarray) -> int:
    """How many of the poses (M, 7), from the first on, are less than LIFT over the height of the first."""
    over = poses[:, 2] - poses[0, 2]
    return int(np.argmin(np.append((over < LIFT) & (over > -SAME_HEIGHT), False)))
