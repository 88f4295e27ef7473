"""Scenes as JSON: for messages between machines, and as part of plan files. See ``docs/plan_file.md``."""

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from hmap_core.exceptions import Code, InputError
from hmap_core.scenes import meshes, resources
from hmap_core.scenes.arrays import DECIMALS, to_lists
from hmap_core.scenes.robot_rules import checked_model
from hmap_core.scenes.scene_data import AttachedData, BodyData, RobotData, SceneData, SceneDocument, ShapeData, parse
from hmap_core.transforms import IDENTITY
from hmap_core.types import AttachedBody, Body, Camera, Goal, Gripper, Robot, RobotModel, Scene, Shape, ShapeKind

SCENE_FORMAT = "hmap-scene"
VERSION = 1


def scene_to_dict(scene: Scene) -> dict[str, Any]:
    """Converts a scene to a JSON value, without the keys ``format`` and ``version``.

    Raises:
        InputError: INVALID_SCENE; a mesh file cannot be read.
    """
    position, rotation = scene.execution_tolerance
    return {
        "task": scene.task,
        "seed": scene.seed,
        "mode": scene.mode.value,
        "goal": {
            "object": scene.goal.object,
            "pose": to_lists(scene.goal.pose),
            "position_tolerance_m": _rounded(scene.goal.position_tolerance),
            "rotation_tolerance_rad": _rounded(scene.goal.rotation_tolerance),
        },
        "execution_tolerance": {"position_m": _rounded(position), "rotation_rad": _rounded(rotation)},
        "scene": {
            "bodies": [_body_dict(body) for body in scene.bodies.values()],
            "motion": scene.motion,
            "removable": {name: None if p is None else to_lists(p) for name, p in scene.removable.items()},
        },
        "robots": {name: _robot_dict(robot) for name, robot in scene.robots.items()},
        "cameras": {name: _camera_dict(camera) for name, camera in scene.cameras.items()},
    }


def _rounded(value: float) -> float:
    return round(float(value), DECIMALS)


def _body_dict(body: Body) -> dict[str, Any]:
    single = len(body.shapes) == 1 and np.array_equal(body.shapes[0].pose, IDENTITY)
    parts = [_shape_dict(shape) for shape in body.shapes]
    shape = {key: value for key, value in parts[0].items() if key != "pose"} if single else {}
    return {
        "name": body.name,
        "kind": body.kind.value,
        **(shape if single else {"shape": "compound", "parts": parts}),
        "pose": to_lists(body.pose),
        "mass": _rounded(body.mass),
        "friction": _rounded(body.friction),
        "graspable": [{"lower": to_lists(region[0]), "upper": to_lists(region[1])} for region in body.graspable],
        "color": None if body.color is None else to_lists(body.color),
    }


def _shape_dict(shape: Shape) -> dict[str, Any]:
    result = {"shape": shape.kind.value, "size": to_lists(shape.size), "pose": to_lists(shape.pose)}
    if shape.mesh is not None:
        result |= {"mesh": resources.portable(shape.mesh), "vertices": to_lists(meshes.hull_vertices(shape.mesh))}
    return result


def _robot_dict(robot: Robot) -> dict[str, Any]:
    model = robot.model
    gripper = None
    if model.gripper is not None:
        values = {field.name: getattr(model.gripper, field.name) for field in fields(Gripper)}
        gripper = {key: _plain(value) for key, value in values.items()}
    payload = {} if model.payload is None else {"payload": _rounded(model.payload)}
    return {
        "model": model.name,
        "urdf": model.urdf_uri,
        "base_pose": to_lists(robot.base_pose),
        "q_start": to_lists(robot.q),
        "joint_names": list(model.joint_names),
        "end_effector_link": model.end_effector_link,
        "T_link_ee": to_lists(model.T_link_ee),
        "home": to_lists(model.home),
        "position_limits": to_lists(model.position_limits),
        "velocity_limits": to_lists(model.velocity_limits),
        "acceleration_limits": to_lists(model.acceleration_limits),
        "ignored_collisions": [list(pair) for pair in model.ignored_collisions],
        "gripper": gripper,
        "simulation": model.simulation,
        **payload,
    } | ({} if model.attached is None else {"held": _attached_dict(model.attached)})


def _plain(value: Any) -> Any:
    """Converts a gripper attribute to JSON; floats are rounded."""
    if isinstance(value, tuple):
        return [_plain(entry) for entry in value]
    return _rounded(value) if isinstance(value, float) else value


def _attached_dict(held: AttachedBody) -> dict[str, Any]:
    return {
        "name": held.name,
        "parts": [_shape_dict(shape) for shape in held.shapes],
        "T_ee_body": to_lists(held.T_ee_body),
        "opening": _rounded(held.opening),
        "friction": _rounded(held.friction),
        "up": to_lists(held.up),
        "mass": _rounded(held.mass),
    }


def _camera_dict(camera: Camera) -> dict[str, Any]:
    return {
        "pose": to_lists(camera.pose),
        "width": camera.width,
        "height": camera.height,
        "fov_y_rad": _rounded(camera.fov_y),
    }


def scene_from_data(data: SceneData, source: str, code: Code) -> Scene:
    """Builds the scene that validated data describe.

    Args:
        data: the data.
        source: name of the document in error messages.
        code: error code.

    Returns:
        The scene.

    Raises:
        InputError: with ``code``; a URDF or a mesh does not exist on this machine.
    """
    try:
        return Scene(
            task=data.task,
            seed=data.seed,
            mode=data.mode,
            bodies={body.name: _body(body) for body in data.scene.bodies},
            robots={name: _robot(name, robot) for name, robot in data.robots.items()},
            cameras={n: Camera(n, c.pose, c.width, c.height, c.fov_y_rad) for n, c in data.cameras.items()},
            goal=Goal(
                data.goal.object, data.goal.pose, data.goal.position_tolerance_m, data.goal.rotation_tolerance_rad
            ),
            motion=data.scene.motion,
            removable=dict(data.scene.removable),
            execution_tolerance=(data.execution_tolerance.position_m, data.execution_tolerance.rotation_rad),
        )
    except InputError as error:
        raise InputError(f"{source}: {error.reason}", code) from error


def _body(data: BodyData) -> Body:
    if data.shape == "compound":
        shapes = tuple(_shape(part) for part in data.parts or ())
    else:
        if data.size is None:
            raise ValueError(f"body '{data.name}' has no size")
        single = ShapeData(shape=ShapeKind(data.shape), size=data.size, mesh=data.mesh, vertices=data.vertices)
        shapes = (_shape(single),)
    return Body(
        name=data.name,
        kind=data.kind,
        shapes=shapes,
        pose=data.pose,
        mass=data.mass,
        friction=data.friction,
        graspable=tuple(np.array([region.lower, region.upper]) for region in data.graspable),
        color=None if data.color is None else tuple(data.color.tolist()),
    )


def _shape(data: ShapeData) -> Shape:
    mesh = None if data.mesh is None else meshes.local_file(data.mesh, data.vertices)
    return Shape(data.shape, tuple(data.size), data.pose, mesh)


def _robot(name: str, data: RobotData) -> Robot:
    gripper = None
    if data.gripper is not None:
        values = data.gripper.model_dump()
        arguments: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}
        gripper = Gripper(**arguments)
    model = RobotModel(
        name=data.model,
        urdf=resources.resolve(data.urdf, Path()),
        urdf_uri=data.urdf,
        joint_names=tuple(data.joint_names),
        end_effector_link=data.end_effector_link,
        T_link_ee=data.T_link_ee,
        home=data.home,
        position_limits=data.position_limits,
        velocity_limits=data.velocity_limits,
        acceleration_limits=data.acceleration_limits,
        gripper=gripper,
        ignored_collisions=tuple(data.ignored_collisions),
        simulation=data.simulation,
        payload=data.payload,
        attached=None if data.held is None else _attached(data.held),
    )
    return Robot(name, checked_model(model), data.base_pose, data.q_start)


def _attached(data: AttachedData) -> AttachedBody:
    shapes = tuple(_shape(part) for part in data.parts)
    return AttachedBody(data.name, shapes, data.T_ee_body, data.opening, data.friction, data.up, data.mass)


def scene_to_text(scene: Scene) -> str:
    """Converts a scene to JSON text, for messages between machines.

    Raises:
        InputError: INVALID_SCENE; a mesh file cannot be read.
        ValueError: the scene contains NaN or infinity.
    """
    return json.dumps({"format": SCENE_FORMAT, "version": VERSION} | scene_to_dict(scene), allow_nan=False)


def scene_from_text(text: str) -> Scene:
    """Builds a scene from JSON text; inverse of :func:`scene_to_text`.

    Raises:
        InputError: INVALID_SCENE; the text is invalid, or a URDF or mesh does not exist on this machine.
    """
    data = parse(SceneDocument, read_json(text, "scene", Code.INVALID_SCENE), "scene", Code.INVALID_SCENE)
    return scene_from_data(data, "scene", Code.INVALID_SCENE)


def read_json(text: str, source: str, code: Code) -> Any:
    """Parses JSON text.

    Args:
        text: the text.
        source: name of the document in error messages.
        code: error code.

    Returns:
        The value.

    Raises:
        InputError: with ``code``; the text is not JSON.
    """
    try:
        return json.loads(text)
    except (ValueError, TypeError, RecursionError) as error:
        raise InputError(f"{source}: not JSON: {error}", code) from error
