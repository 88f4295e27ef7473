"""Tools: which body a robot takes in its hand to move an object with, and where it holds it.

Chosen from geometry alone: every body of kind ``tool``, every robot, holds spread over the tool; one is worth how far
hand, tool and object could go along the object's path, which is asked without any inverse kinematics.
"""

import numpy as np

from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.shapes import body_set
from hmap_core.planner.interfaces import Grip
from hmap_core.planner.motion import scene_holding
from hmap_core.transforms import apply, rotation_matrix
from hmap_core.types import BodyKind, ContactPoint, Scene, SceneState

TURN_LENGTH = 0.1  # m that count as much as a turn of the hand by 1 rad, when holds are spread over a tool


def holding(scene: Scene, grip: Grip) -> Scene:
    """The scene in which the robot holds the tool."""
    return scene_holding(scene, grip.robot, grip.tool, grip.contact.contact, grip.T_place)


def tools_of(scene: Scene, object: str) -> list[str]:
    """Names of the bodies that may be taken to move an object with."""
    return [name for name, body in scene.bodies.items() if body.kind == BodyKind.TOOL and name != object]


def within_reach(scene: Scene, state: SceneState, robot: str, tool: str, object: str) -> bool:
    """Whether a robot might touch a tool, and an object with the tool's farthest end."""
    placed = scene.robots[robot]
    arm = load_arm(placed.model)
    shoulder, reach = apply(placed.base_pose, arm.p_joint[0]), arm.reach()[0]
    far = {
        name: float(np.linalg.norm(state.poses[name][:3] - shoulder)) - _extent(scene, name) for name in (tool, object)
    }
    return far[tool] <= reach and far[object] <= reach + 2.0 * _extent(scene, tool)


def _extent(scene: Scene, name: str) -> float:
    """Largest distance of a point of a body from its origin, m."""
    shapes = body_set(scene.bodies[name])
    return float((np.linalg.norm(shapes.center, axis=1) + shapes.bound).max())


def spread(contacts: list[ContactPoint], count: int) -> list[int]:
    """Indices of up to ``count`` contacts that are far from each other, the first of them first."""
    if not contacts:
        return []
    frames = np.array([c.T_obj_ee for c in contacts])
    turns = np.array([rotation_matrix(T)[:, 1:].T.ravel() for T in frames])
    features = np.concatenate([frames[:, :3], TURN_LENGTH * turns], axis=1)
    chosen = [0]
    far = np.linalg.norm(features - features[0], axis=1)
    while len(chosen) < min(count, len(contacts)):
        chosen.append(int(far.argmax()))
        far = np.minimum(far, np.linalg.norm(features - features[chosen[-1]], axis=1))
    return chosen
