"""The bound by poses: whether contacts exist that hold at the mode switches of an action.

It is necessary for a path of the action (Toussaint and Lopes, Multi-bound tree search for logic-geometric programming
in cooperative manipulation domains, ICRA 2017), and takes a hundredth of the time of one.
"""

from dataclasses import replace

import numpy as np

from hmap_core.baselines.komo.places import Places
from hmap_core.baselines.lgp.actions import Action, Target
from hmap_core.baselines.move_contacts import contacts_of_move
from hmap_core.collision.convex import set_distance
from hmap_core.komo.shapes import body_set
from hmap_core.types import ContactPoint, Goal, Scene, SceneState
from hmap_core.waypoints.checker import PENETRATION_ALLOWED


def target_pose(
    scene: Scene, state: SceneState, goal: Goal, action: Action, rng: np.random.Generator
) -> np.ndarray | None:
    """Where (7,) an action releases its object; None where no place was found."""
    if action.target is Target.GOAL:
        return goal.pose
    if action.target is Target.REMOVAL:
        return scene.removable[action.object]
    own = goal if action.object == goal.object else Goal(action.object, state.poses[action.object])
    around = replace(scene, motion=scene.motion if own is goal else "auto", goal=own)
    return Places(around, state, own).draw(rng)


def blockers(scene: Scene, state: SceneState, object: str, T: np.ndarray) -> list[str]:
    """Names of the bodies in which an object would be at T (7,)."""
    own = body_set(scene.bodies[object])
    return [
        name
        for name, body in scene.bodies.items()
        if name != object and set_distance(own, T, body_set(body), state.poses[name], 0.0) < -PENETRATION_ALLOWED
    ]


def contacts_at_switches(
    state: SceneState, action: Action, T_end: np.ndarray, rng: np.random.Generator
) -> list[ContactPoint]:
    """Contacts of the action's hand that hold where its object is, and where it is released; none: it is infeasible."""
    hand = action.hand
    if blockers(hand.scene, state, action.object, T_end):
        return []
    ends = np.array([state.poses[action.object], T_end])
    return contacts_of_move(hand.scene, state, hand.robot, action.object, ends, rng)
