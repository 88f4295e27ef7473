"""Tools in the hands of robots: scenes and states with a tool attached or placed."""

import numpy as np

from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.shapes import body_set
from hmap_core.planner.interfaces import ToolGrasp
from hmap_core.planner.segments import attach_body
from hmap_core.transforms import apply, inverse, multiply, rotation_matrix
from hmap_core.types import BodyKind, ContactPoint, Scene, SceneState

TURN_LENGTH = 0.1  # m that count as much as a turn of the hand by 1 rad in the distance between two contacts


def attach_tool(scene: Scene, grasp: ToolGrasp) -> Scene:
    """The scene in which the tool is part of the robot's hand."""
    return attach_body(scene, grasp.robot, grasp.tool, grasp.contact.contact, grasp.T_place)


def with_tool_attached(scene: Scene, state: SceneState, grasp: ToolGrasp) -> SceneState:
    """The state with the tool exactly at the pose in which the grasp holds it."""
    placed, contact = scene.robots[grasp.robot], grasp.contact.contact
    T_world_ee = multiply(placed.base_pose, load_arm(placed.model).end_effector(state.q[grasp.robot]))
    exact = state.copy()
    exact.poses[grasp.tool] = multiply(T_world_ee, inverse(contact.T_obj_ee))
    exact.gripper[grasp.robot] = contact.opening
    return exact


def with_tool_placed(state: SceneState, grasp: ToolGrasp | None) -> SceneState:
    """The state in which the tool stands where it was picked; the same state where there is no grasp."""
    if grasp is None:
        return state
    back = state.copy()
    back.poses[grasp.tool] = grasp.T_place
    return back


def tools_of(scene: Scene, object: str) -> list[str]:
    """Names of the tools with which an object may be moved."""
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


def farthest_points(contacts: list[ContactPoint], count: int) -> list[int]:
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
