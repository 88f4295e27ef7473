"""Conversions of scenes, robot states and world states."""

import json
from collections import Counter
from collections.abc import Iterable
from typing import Any

from builtin_interfaces.msg import Time
from std_msgs.msg import Header

from hmap_msgs.msg import RobotState, Scene, WorldState
from hmap_msgs_py.bodies import body_from_message, body_to_message
from hmap_msgs_py.checks import ConversionError, field, finite, frame, one_of
from hmap_msgs_py.poses import pose_from_message, pose_to_message

MODES = (Scene.KINEMATIC, Scene.PHYSICAL)
WORLD_FRAME = "world"


def scene_to_message(definition: dict) -> Scene:
    """Convert a scene's definition, a JSON value with ``task``, ``seed`` and ``mode``; the message has it as text.

    Raises:
        ConversionError: the mode is unknown.
    """
    return Scene(
        task=definition["task"],
        seed=int(definition["seed"]),
        mode=one_of("mode", definition["mode"], MODES),
        text=json.dumps(definition, allow_nan=False),
    )


def scene_from_message(message: Scene) -> dict:
    """Convert to the scene's definition.

    Raises:
        ConversionError: the text is no JSON object.
    """
    try:
        definition = json.loads(message.text)
    except (ValueError, RecursionError) as error:
        raise ConversionError(f"the text of scene {message.task!r} is not JSON: {error}") from None
    if not isinstance(definition, dict):
        given = type(definition).__name__
        raise ConversionError(f"the text of scene {message.task!r} must be a JSON object, not {given}")
    return definition


def robot_state_to_message(state: Any) -> RobotState:
    """Convert the state of an arm.

    Args:
        state: has ``name``, ``model``, ``base_pose`` (7,), ``joint_names``, ``q`` (n,), ``gripper`` (opening in metres)
            and optionally ``velocity`` (n,).

    Raises:
        ConversionError: a value is not allowed.
    """
    name, joint_names = field(state, "name"), list(field(state, "joint_names"))
    velocity = field(state, "velocity", None)
    n = len(joint_names)
    return RobotState(
        name=name,
        model=field(state, "model"),
        base_pose=pose_to_message(field(state, "base_pose"), f"base pose of {name!r}"),
        joint_names=joint_names,
        position=finite(f"position of {name!r}", field(state, "q"), (n,)).tolist(),
        velocity=[] if velocity is None else finite(f"velocity of {name!r}", velocity, (n,)).tolist(),
        gripper_opening=float(finite(f"gripper of {name!r}", field(state, "gripper"), ())),
    )


def robot_state_from_message(message: RobotState) -> dict:
    """Convert to ``{name, model, base_pose, joint_names, q, velocity or None, gripper}``.

    Raises:
        ConversionError: a value is not allowed.
    """
    n = len(message.joint_names)
    velocity = finite(f"velocity of {message.name!r}", message.velocity, (n,)) if len(message.velocity) else None
    return {
        "name": message.name,
        "model": message.model,
        "base_pose": pose_from_message(message.base_pose, f"base pose of {message.name!r}"),
        "joint_names": tuple(message.joint_names),
        "q": finite(f"position of {message.name!r}", message.position, (n,)),
        "velocity": velocity,
        "gripper": float(finite(f"gripper of {message.name!r}", message.gripper_opening, ())),
    }


def world_state_to_message(
    task: str, seed: int, mode: str, robots: Iterable[Any], bodies: Iterable[Any], stamp: Time | None = None
) -> WorldState:
    """Convert the state of the world at one instant.

    Args:
        task: name of the task.
        seed: of its randomisation.
        mode: "kinematic" or "physical".
        robots: as in :func:`robot_state_to_message`.
        bodies: as in :func:`hmap_msgs_py.bodies.body_to_message`, at their current poses.
        stamp: time of the state.

    Raises:
        ConversionError: a value is not allowed.
    """
    return WorldState(
        header=Header(stamp=stamp or Time(), frame_id=WORLD_FRAME),
        task=task,
        seed=seed,
        mode=one_of("mode", mode, MODES),
        robots=[robot_state_to_message(robot) for robot in robots],
        bodies=[body_to_message(body) for body in bodies],
    )


def world_state_from_message(message: WorldState) -> dict:
    """Convert to ``{task, seed, mode, robots, bodies, q, gripper, poses}``.

    ``robots`` and ``bodies`` are dicts by name; ``q``, ``gripper`` and ``poses`` are the arguments of a SceneState.

    Raises:
        ConversionError: a value is not allowed, or two robots or bodies have the same name.
    """
    _check_names(message)
    robots = {robot.name: robot_state_from_message(robot) for robot in message.robots}
    bodies = {body.name: body_from_message(body) for body in message.bodies}
    return {
        "task": message.task,
        "seed": message.seed,
        "mode": one_of("mode", message.mode, MODES),
        "robots": robots,
        "bodies": bodies,
        "q": {name: robot["q"] for name, robot in robots.items()},
        "gripper": {name: robot["gripper"] for name, robot in robots.items()},
        "poses": {name: body["pose"] for name, body in bodies.items()},
    }


def placement_from_message(message: WorldState) -> dict:
    """Convert only where robots and bodies are, to ``{joint_names, q, gripper, poses}``, dicts by name.

    Velocities, shapes, colours and what else is not needed for this are not read. The gripper openings are not checked:
    a robot without a gripper has none.

    Raises:
        ConversionError: a value that is needed is not allowed, or two robots or bodies have the same name.
    """
    frame("the world state", message.header.frame_id, ("", WORLD_FRAME))
    _check_names(message)
    return {
        "joint_names": {robot.name: list(robot.joint_names) for robot in message.robots},
        "q": {
            robot.name: finite(f"position of {robot.name!r}", robot.position, (len(robot.joint_names),))
            for robot in message.robots
        },
        "gripper": {robot.name: float(robot.gripper_opening) for robot in message.robots},
        "poses": {body.name: pose_from_message(body.pose, f"pose of {body.name!r}") for body in message.bodies},
    }


def _check_names(message: WorldState) -> None:
    for what, entries in (("robots", message.robots), ("bodies", message.bodies)):
        for name, times in Counter(entry.name for entry in entries).items():
            if not name:
                raise ConversionError(f"the world state has {what} with an empty name")
            if times > 1:
                raise ConversionError(f"{times} {what} of the world state have the same name {name!r}")
