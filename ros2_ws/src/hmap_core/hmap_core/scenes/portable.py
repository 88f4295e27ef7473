"""An instantiated scene as JSON: the part of a plan file that says what was planned for. See ``docs/plan_file.md``."""

import json
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from hmap_core.exceptions import Code, InputError
from hmap_core.scenes import meshes, resources
from hmap_core.scenes.arrays import DECIMALS, PoseVector, Vector, array_of, listed
from hmap_core.scenes.document import key_text
from hmap_core.scenes.schema import SIZES
from hmap_core.transforms import IDENTITY
from hmap_core.types import (
    Body,
    BodyKind,
    Camera,
    Goal,
    Gripper,
    Robot,
    RobotModel,
    Scene,
    Shape,
    ShapeKind,
    TaskMode,
)

SCENE_FORMAT = "hmap-scene"
VERSION = 1
Extent = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Amount = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Real = Annotated[float, Field(allow_inf_nan=False)]


class Data(BaseModel):
    """Part of a document. Keys that are not known are left alone, so that later versions may add some."""

    model_config = ConfigDict(extra="ignore", frozen=True, arbitrary_types_allowed=True)


Model = TypeVar("Model", bound=Data)


class ShapeData(Data):
    """A convex shape in its body's frame; ``size`` as in a task file, ``vertices`` of a mesh's hull, unscaled."""

    shape: ShapeKind
    size: list[Extent]
    pose: PoseVector = Field(default_factory=IDENTITY.copy)
    mesh: str | None = None
    vertices: array_of(None, 3) | None = None

    @model_validator(mode="after")
    def _size_fits(self) -> "ShapeData":
        _check_size(self.shape, self.size, self.mesh)
        return self


def _check_size(shape: ShapeKind, size: list[float], mesh: str | None) -> None:
    meaning = SIZES[shape]
    if len(size) != meaning.split("]")[0].count(",") + 1:
        raise PydanticCustomError("size", "size of a {shape} is {meaning}", {"shape": shape, "meaning": meaning})
    if shape is ShapeKind.MESH and mesh is None:
        raise PydanticCustomError("mesh", "a mesh needs the key mesh")


class RegionData(Data):
    """An axis-aligned box in the body frame."""

    lower: array_of(3)
    upper: array_of(3)


class BodyData(Data):
    """A body; ``shape`` is ``compound`` when it has several, then in ``parts``."""

    name: str
    kind: BodyKind
    shape: Literal["box", "cylinder", "sphere", "capsule", "mesh", "compound"]
    size: list[Extent] | None = None
    mesh: str | None = None
    vertices: array_of(None, 3) | None = None
    parts: list[ShapeData] | None = None
    pose: PoseVector
    mass: Amount = 0.0
    friction: Amount
    graspable: list[RegionData] = []
    color: array_of(4) | None = None

    @model_validator(mode="after")
    def _shape_or_parts(self) -> "BodyData":
        if self.shape == "compound" and not self.parts:
            raise PydanticCustomError("parts", "a compound body needs parts")
        if self.shape != "compound":
            if self.size is None:
                raise PydanticCustomError("size", "a {shape} needs a size", {"shape": self.shape})
            _check_size(ShapeKind(self.shape), self.size, self.mesh)
        return self


class GripperData(Data):
    """A parallel gripper; lengths in metres, force in newtons."""

    joint_names: list[str]
    per_joint: Real
    finger_links: list[str]
    min_opening: Real
    max_opening: Real
    open_opening: Real
    tip_offset: Real
    pad_half_width: Real
    force: Real


class RobotData(Data):
    """A robot: where it stands, where it starts, and its model."""

    model: str
    urdf: str
    base_pose: PoseVector
    q_start: Vector
    joint_names: list[str]
    end_effector_link: str
    T_link_ee: PoseVector
    home: Vector
    position_limits: array_of(2, None)
    velocity_limits: Vector
    acceleration_limits: Vector
    ignored_collisions: list[tuple[str, str]] = []
    gripper: GripperData | None = None
    simulation: dict[str, Any] = {}

    @model_validator(mode="after")
    def _lengths(self) -> "RobotData":
        for key in ("q_start", "home", "position_limits", "velocity_limits", "acceleration_limits"):
            if getattr(self, key).shape[-1] != len(self.joint_names):
                raise PydanticCustomError(
                    "length",
                    "{key} must have one number for each of the {n} joints",
                    {"key": key, "n": len(self.joint_names)},
                )
        return self


class CameraData(Data):
    """A pinhole camera; its frame is x right, y down, z forward."""

    pose: PoseVector
    width: Annotated[int, Field(ge=1)]
    height: Annotated[int, Field(ge=1)]
    fov_y_rad: Extent


class GoalData(Data):
    """Where an object has to end."""

    object: str
    pose: PoseVector
    position_tolerance_m: Extent
    rotation_tolerance_rad: Extent


class ToleranceData(Data):
    """How far from its goal the object may end when the plan is executed."""

    position_m: Extent
    rotation_rad: Extent


class BodiesData(Data):
    """The bodies, and how the goal's object may move among them."""

    bodies: list[BodyData]
    motion: Literal["auto", "planar", "spatial"] = "auto"
    removable: dict[str, PoseVector | None] = {}


class SceneData(Data):
    """The keys that a scene and a plan file have in common."""

    task: str
    seed: Annotated[int, Field(ge=0)]
    mode: TaskMode
    scene: BodiesData
    robots: dict[str, RobotData]
    cameras: dict[str, CameraData] = {}
    goal: GoalData
    execution_tolerance: ToleranceData

    @model_validator(mode="after")
    def _names(self) -> "SceneData":
        names = [body.name for body in self.scene.bodies]
        for name in names:
            if names.count(name) > 1 or name in self.robots:
                raise PydanticCustomError("name", "the name {name} is used twice", {"name": repr(name)})
        known = [body.name for body in self.scene.bodies if body.kind is not BodyKind.FIXED]
        for name in (self.goal.object, *self.scene.removable):
            if name not in known:
                problem = "{name} is not a movable body; there are: {known}"
                raise PydanticCustomError("name", problem, {"name": repr(name), "known": ", ".join(known)})
        return self


class SceneDocument(SceneData):
    """A scene on its own."""

    format: Literal["hmap-scene"]
    version: Literal[1]


def parse(model: type[Model], data: Any, source: str, code: Code) -> Model:
    """``data`` as ``model``.

    Raises:
        InputError: with ``code``, naming ``source``, the key and the problem.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        detail = error.errors(include_url=False)[0]
        problem = detail["msg"].replace("Input should", "must")
        value = detail.get("input")
        shown = f" = {value!r}" if isinstance(value, str | int | float | bool) else ""
        raise InputError(f"{source}: {key_text(tuple(detail['loc']))}{shown}: {problem}", code) from error


def scene_to_dict(scene: Scene) -> dict[str, Any]:
    """The scene as a JSON value, without ``format`` and ``version``."""
    position, rotation = scene.execution_tolerance
    return {
        "task": scene.task,
        "seed": scene.seed,
        "mode": scene.mode.value,
        "goal": {
            "object": scene.goal.object,
            "pose": listed(scene.goal.pose),
            "position_tolerance_m": _rounded(scene.goal.position_tolerance),
            "rotation_tolerance_rad": _rounded(scene.goal.rotation_tolerance),
        },
        "execution_tolerance": {"position_m": _rounded(position), "rotation_rad": _rounded(rotation)},
        "scene": {
            "bodies": [_body_dict(body) for body in scene.bodies.values()],
            "motion": scene.motion,
            "removable": {name: None if p is None else listed(p) for name, p in scene.removable.items()},
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
        "pose": listed(body.pose),
        "mass": _rounded(body.mass),
        "friction": _rounded(body.friction),
        "graspable": [{"lower": listed(region[0]), "upper": listed(region[1])} for region in body.graspable],
        "color": None if body.color is None else listed(body.color),
    }


def _shape_dict(shape: Shape) -> dict[str, Any]:
    result = {"shape": shape.kind.value, "size": listed(shape.size), "pose": listed(shape.pose)}
    if shape.mesh is not None:
        result |= {"mesh": resources.portable(shape.mesh), "vertices": listed(meshes.hull_vertices(shape.mesh))}
    return result


def _robot_dict(robot: Robot) -> dict[str, Any]:
    model = robot.model
    gripper = None
    if model.gripper is not None:
        gripper = {field.name: getattr(model.gripper, field.name) for field in fields(Gripper)}
        gripper |= {key: list(gripper[key]) for key in ("joint_names", "finger_links")}
    return {
        "model": model.name,
        "urdf": model.urdf_uri,
        "base_pose": listed(robot.base_pose),
        "q_start": listed(robot.q),
        "joint_names": list(model.joint_names),
        "end_effector_link": model.end_effector_link,
        "T_link_ee": listed(model.T_link_ee),
        "home": listed(model.home),
        "position_limits": listed(model.position_limits),
        "velocity_limits": listed(model.velocity_limits),
        "acceleration_limits": listed(model.acceleration_limits),
        "ignored_collisions": [list(pair) for pair in model.ignored_collisions],
        "gripper": gripper,
        "simulation": model.simulation,
    }


def _camera_dict(camera: Camera) -> dict[str, Any]:
    return {
        "pose": listed(camera.pose),
        "width": camera.width,
        "height": camera.height,
        "fov_y_rad": _rounded(camera.fov_y),
    }


def scene_of(data: SceneData, source: str, code: Code) -> Scene:
    """The scene that validated data describe.

    Raises:
        InputError: with ``code``, when a URDF or a mesh is not on this machine.
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
    mesh = None if data.mesh is None else meshes.local(data.mesh, data.vertices)
    return Shape(data.shape, tuple(data.size), data.pose, mesh)


def _robot(name: str, data: RobotData) -> Robot:
    gripper = None
    if data.gripper is not None:
        values = data.gripper.model_dump()
        gripper = Gripper(**values | {key: tuple(values[key]) for key in ("joint_names", "finger_links")})
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
    )
    return Robot(name, model, data.base_pose, data.q_start)


def scene_to_text(scene: Scene) -> str:
    """The scene as JSON text, so that it can cross a network."""
    return json.dumps({"format": SCENE_FORMAT, "version": VERSION} | scene_to_dict(scene), allow_nan=False)


def scene_from_text(text: str) -> Scene:
    """The scene that :func:`scene_to_text` wrote.

    Raises:
        InputError: INVALID_SCENE when it is not such a text, or a URDF or mesh is not on this machine.
    """
    data = parse(SceneDocument, read_json(text, "scene", Code.INVALID_SCENE), "scene", Code.INVALID_SCENE)
    return scene_of(data, "scene", Code.INVALID_SCENE)


def read_json(text: str, source: str, code: Code) -> Any:
    """JSON text as a value; InputError with ``code`` when it is not JSON."""
    try:
        return json.loads(text)
    except (ValueError, TypeError, RecursionError) as error:
        raise InputError(f"{source}: not JSON: {error}", code) from error
