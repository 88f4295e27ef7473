"""Conversions of scenes, states and plans, on top of hmap_msgs_py; incoming values are checked against their scene."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from builtin_interfaces.msg import Time
from std_msgs.msg import Header

from hmap_core import plan_file
from hmap_core.contacts.camera import Cloud
from hmap_core.exceptions import Code, HmapError, InputError
from hmap_core.kinematics.arm import load_arm
from hmap_core.scenes import scene_from_text, scene_to_text
from hmap_core.scenes.fields import NAME_PATTERN
from hmap_core.scenes.resources import resolve
from hmap_core.transforms import apply, multiply
from hmap_core.types import Body, BodyKind, Plan, Scene, SceneState, Shape, ShapeKind
from hmap_msgs import msg
from hmap_msgs_py import bodies, clouds, plans, world
from hmap_msgs_py.checks import ConversionError, finite, frame
from hmap_msgs_py.poses import pose_from_message, pose_to_message

SCENES_KEPT = 16  # number of cached scenes; every request of a plan has the same scene


def scene_to_message(scene: Scene) -> msg.Scene:
    """Convert a scene; the message is complete and needs no file."""
    return msg.Scene(task=scene.task, seed=scene.seed, mode=scene.mode.value, text=scene_to_text(scene))


def scene_from_message(message: msg.Scene) -> Scene:
    """Convert to a scene.

    Raises:
        InputError: INVALID_SCENE; the text is no scene.
    """
    if not message.text.strip():
        raise InputError(
            "the scene has no text; take it from the topic `scene` or the service `get_scene`", Code.INVALID_SCENE
        )
    return _scene(message.text)


@lru_cache(SCENES_KEPT)
def _scene(text: str) -> Scene:
    return scene_from_text(text)


def body_from_message(message: msg.Body) -> Body:
    """Convert to a body that is not in a scene yet.

    Raises:
        InputError: INVALID_SCENE; a value is not allowed.
        ConversionError: the message is malformed.
    """
    fields = bodies.body_from_message(message)
    if not re.fullmatch(NAME_PATTERN, message.name):  # the name becomes a part of topic names
        raise InputError(
            f"name of a body {message.name!r}: must be a letter, then letters, digits and underscores",
            Code.INVALID_SCENE,
        )
    if not fields["shapes"]:
        raise InputError(f"body {message.name!r} has no shapes; at least one is needed", Code.INVALID_SCENE)
    if min(fields["mass"], fields["friction"]) < 0.0:
        raise InputError(f"body {message.name!r}: mass and friction must be 0 or larger", Code.INVALID_SCENE)
    shapes = tuple(_shape(shape, message.name) for shape in fields["shapes"])
    return Body(**fields | {"kind": BodyKind(fields["kind"]), "shapes": shapes})


def bodies_from_message(message: msg.BodyArray) -> tuple[dict[str, Body], list[str]]:
    """Convert to bodies by name, each for itself.

    Returns:
        The bodies, and why others are left out.

    Raises:
        ConversionError: the bodies are in another frame than the world.
    """
    frame("the bodies", message.header.frame_id, ("", world.WORLD_FRAME))
    found: dict[str, Body] = {}
    problems = []
    for entry in message.bodies:
        try:
            body = body_from_message(entry)
        except (HmapError, ConversionError) as error:
            problems.append(str(error))
            continue
        if body.name in found:
            problems.append(f"two bodies have the name {body.name!r}; the first one is used")
        else:
            found[body.name] = body
    return found, problems


def _shape(fields: dict, body: str) -> Shape:
    if min(fields["size"]) <= 0.0:
        raise InputError(f"body {body!r}: size {fields['size']} must be above 0", Code.INVALID_SCENE)
    mesh = None if fields["mesh"] is None else resolve(fields["mesh"], Path())
    return Shape(ShapeKind(fields["kind"]), fields["size"], fields["pose"], mesh)


def state_to_message(
    scene: Scene, state: SceneState, stamp: Time | None = None, velocity: dict[str, np.ndarray] | None = None
) -> msg.WorldState:
    """Convert the state of a scene's robots and bodies.

    Args:
        scene: the scene.
        state: its state.
        stamp: time of the state.
        velocity: robot -> joint velocities (n,), rad/s, if measured.
    """
    robots = [
        {
            "name": name,
            "model": robot.model.name,
            "base_pose": robot.base_pose,
            "joint_names": robot.model.joint_names,
            "q": state.q[name],
            "velocity": (velocity or {}).get(name),
            "gripper": state.gripper.get(name, 0.0),
        }
        for name, robot in scene.robots.items()
    ]
    placed = [replace(body, pose=state.poses.get(name, body.pose)) for name, body in scene.bodies.items()]
    return world.world_state_to_message(scene.task, scene.seed, scene.mode.value, robots, placed, stamp)


def placement_to_message(scene: Scene, state: SceneState) -> msg.WorldState:
    """Convert where the robots and bodies of a scene are, and nothing else that the scene tells, such as shapes.

    :func:`state_from_message` reads no more than that.

    Raises:
        ConversionError: a value is not allowed.
    """
    robots = [
        msg.RobotState(
            name=name,
            model=robot.model.name,
            joint_names=list(robot.model.joint_names),
            position=finite(f"position of {name!r}", state.q[name], (len(robot.model.joint_names),)).tolist(),
            gripper_opening=float(finite(f"gripper of {name!r}", state.gripper.get(name, 0.0), ())),
        )
        for name, robot in scene.robots.items()
    ]
    placed = [
        msg.Body(name=name, kind=body.kind.value, pose=pose_to_message(state.poses.get(name, body.pose), name))
        for name, body in scene.bodies.items()
    ]
    header = Header(frame_id=world.WORLD_FRAME)
    return msg.WorldState(
        header=header, task=scene.task, seed=scene.seed, mode=scene.mode.value, robots=robots, bodies=placed
    )


def state_from_message(scene: Scene, message: msg.WorldState) -> SceneState:
    """Convert to the state of every robot and body of a scene; joints are matched by name.

    Only what the state needs is read: wrong velocities or shapes do not matter. A body that is attached to a robot of
    the scene is not in the message; its pose follows from the robot's.

    Raises:
        ConversionError: NaN, a quaternion that is not normalised, a wrong size, or another frame than the world.
        InputError: a robot or body is not in the scene, or one of the scene is missing.
    """
    fields = world.placement_from_message(message)
    _same_names("robots", fields["q"], scene.robots, Code.UNKNOWN_ROBOT)
    _same_names("bodies", fields["poses"], scene.bodies, Code.UNKNOWN_OBJECT)
    q, gripper = {}, {}
    for name, robot in scene.robots.items():
        given, wanted = fields["joint_names"][name], robot.model.joint_names
        if sorted(given) != sorted(wanted):
            raise InputError(f"the joints of {name!r} are {', '.join(given)}; they must be {', '.join(wanted)}")
        q[name] = fields["q"][name][[given.index(joint) for joint in wanted]]
        opening = fields["gripper"][name] if robot.model.gripper else 0.0
        gripper[name] = float(finite(f"gripper of {name!r}", opening, ()))
    return SceneState(q, gripper, fields["poses"] | _attached_poses(scene, q))


def _attached_poses(scene: Scene, q: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The poses T_world_body (7,) of attached bodies, by name."""
    poses = {}
    for name, robot in scene.robots.items():
        held = robot.model.attached
        if held is not None:
            T_world_ee = multiply(robot.base_pose, load_arm(robot.model).end_effector(q[name]))
            poses[held.name] = multiply(T_world_ee, held.T_ee_body)
    return poses


def _same_names(what: str, given, known, code: Code) -> None:
    unknown, missing = sorted(set(given) - set(known)), sorted(set(known) - set(given))
    if unknown or missing:
        raise InputError(f"{what} of the world state: unknown {unknown}, missing {missing}", code)


def known_object(scene: Scene, name: str) -> str:
    """Check for the name of a body that can move; returns the name.

    Raises:
        InputError: UNKNOWN_OBJECT.
    """
    movable = [body.name for body in scene.bodies.values() if body.kind is not BodyKind.FIXED]
    if name not in movable:
        problem = "is fixed" if name in scene.bodies else "is not in the scene"
        raise InputError(f"object {name!r} {problem}; movable: {', '.join(movable) or 'none'}", Code.UNKNOWN_OBJECT)
    return name


def known_robots(scene: Scene, names: Sequence[str]) -> list[str]:
    """Check for names of robots; returns them, or all robots if there are none.

    Raises:
        InputError: UNKNOWN_ROBOT.
    """
    for name in names:
        if name not in scene.robots:
            known = ", ".join(scene.robots)
            raise InputError(f"robot {name!r} is not in the scene; there are: {known}", Code.UNKNOWN_ROBOT)
    return list(names) or list(scene.robots)


@dataclass(frozen=True)
class ReceivedCloud(Cloud):
    """A cloud with the message that it came in, which can be sent on without being encoded again.

    Attributes:
        message: the message; None if the cloud has been made here.
    """

    message: msg.ObjectCloud | None = None


def cloud_to_message(name: str, pose: np.ndarray, cloud: Cloud, stamp: Time | None = None) -> msg.ObjectCloud:
    """Convert the visible surface of an object. A received cloud is sent on as it came.

    Args:
        name: of the object.
        pose: T_world_obj (7,).
        cloud: in the object frame.
        stamp: time of the measurement.
    """
    if isinstance(cloud, ReceivedCloud) and cloud.message is not None and cloud.message.object == name:
        return cloud.message
    return clouds.object_cloud_to_message(name, pose, cloud.points, cloud.normals, stamp)


def cloud_from_message(message: msg.ObjectCloud) -> Cloud | None:
    """Convert to a cloud in the object frame; None if the message has no points.

    Raises:
        ConversionError: the cloud has no normals or is malformed.
    """
    if not message.cloud.fields:
        return None
    fields = clouds.object_cloud_from_message(message)
    points, normals = fields["points"], fields["normals"]
    if len(points) == 0:
        return None
    if normals is None:
        raise ConversionError(f"the cloud of {message.object!r} has no normals")
    return ReceivedCloud(points.astype(float), normals.astype(float), np.ones(len(points), bool), message)


def clouds_in_world(message: msg.ObjectClouds) -> dict[str, np.ndarray]:
    """The visible points (N, 3) of each object, world frame, m.

    Raises:
        ConversionError: a pose or a cloud is malformed.
    """
    found = {}
    for each in message.clouds:
        cloud = cloud_from_message(each)
        if cloud is not None:
            found[each.object] = apply(pose_from_message(each.pose, f"pose of {each.object!r}"), cloud.points)
    return found


def plan_to_message(plan: Plan, stamp: Time | None = None) -> msg.Plan:
    """Convert a plan, in the form of its file."""
    return plans.plan_to_message(plan_file.to_dict(plan, arrays=True), stamp)


def plan_from_message(message: msg.Plan) -> Plan:
    """Convert to a plan.

    Raises:
        InputError: the message contains no plan.
    """
    return plan_file.from_dict(plans.plan_from_message(message), "the plan message")
