"""Tools: which body a robot takes in its hand to move an object with, and where it holds it.

Chosen from geometry alone: every body of kind ``tool``, every robot, holds spread over the tool; one is worth how far
hand, tool and object could go along the object's path, which is asked without any inverse kinematics.
"""

import numpy as np

from hmap_core.execution.attached_tool import AttachedTool
from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.shapes import body_set
from hmap_core.planner.interfaces import RobotContact, ToolGrasp
from hmap_core.planner.segments import attach_body
from hmap_core.transforms import apply, inverse, multiply, rotation_matrix
from hmap_core.types import BodyKind, ContactKind, ContactPoint, Scene, SceneState

TURN_LENGTH = 0.1  # m that count as much as a turn of the hand by 1 rad, when holds are spread over a tool


def attach_tool(scene: Scene, grip: ToolGrasp) -> Scene:
    """The scene in which the robot holds the tool."""
    return attach_body(scene, grip.robot, grip.tool, grip.contact.contact, grip.T_place)


def grip_of(held: AttachedTool) -> ToolGrasp:
    """The grip on a tool that is in a robot's hand, taken along the end-effector's z axis."""
    T = held.contact_pose
    approach = np.array([0.0, 0.0, 1.0])
    contact = ContactPoint(ContactKind.GRASP, T, T[:3], -rotation_matrix(T)[:, 2], held.opening, approach)
    return ToolGrasp(held.tool, RobotContact(held.robot, contact, 0, held.q_place[None]), held.T_place)


def with_tool_attached(scene: Scene, state: SceneState, grip: ToolGrasp) -> SceneState:
    """The state with the tool exactly where the grip holds it."""
    placed, contact = scene.robots[grip.robot], grip.contact.contact
    T_world_ee = multiply(placed.base_pose, load_arm(placed.model).end_effector(state.q[grip.robot]))
    held = state.copy()
    held.poses[grip.tool] = multiply(T_world_ee, inverse(contact.T_obj_ee))
    held.gripper[grip.robot] = contact.opening
    return held


def with_tool_placed(state: SceneState, grip: ToolGrasp | None) -> SceneState:
    """The state in which a tool stands again where it was taken; the same where there is no grip."""
    if grip is None:
        return state
    back = state.copy()
    back.poses[grip.tool] = grip.T_place
    return back


def tools_of(scene: Scene, object: str) -> list[str]:
    """Names of the bodies that may be taken to move an object with."""
    return [name for name, body in scene.bodies.items() if body.kind == BodyKind.TOOL and name != object]


def within_reach(scene: Scene, state: SceneState, robot: str, tool: str, object: str) -> bool:
    """Whether a robot might touch a tool, and an object with the tool's farthest end."""
    placed = scene.robots[robot]
    arm = load_arm(placed.model)
    shoulder, reach = apply(placed.base_pose, arm.p_joint[0]), arm.length
    far = {
        name: float(np.linalg.norm(state.poses[name][:3] - shoulder)) - extent(scene, name) for name in (tool, object)
    }
    return far[tool] <= reach and far[object] <= reach + 2.0 * extent(scene, tool)


def extent(scene: Scene, name: str) -> float:
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
