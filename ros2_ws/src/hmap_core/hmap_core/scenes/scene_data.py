"""Pydantic models of the JSON form of a scene. ``docs/plan_file.md`` describes the keys."""

from itertools import pairwise
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import PydanticCustomError

from hmap_core.exceptions import Code, InputError
from hmap_core.scenes.arrays import Limits, Points, PoseVector, Vector, Vector3, Vector4
from hmap_core.scenes.document import key_text
from hmap_core.scenes.schema import SIZES
from hmap_core.transforms import IDENTITY
from hmap_core.types import GRIPPER_SPEED, BodyKind, ShapeKind, TaskMode

Extent = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Amount = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Real = Annotated[float, Field(allow_inf_nan=False)]


class Data(BaseModel):
    """Part of a document. Unknown keys are ignored, so that later versions may add keys."""

    model_config = ConfigDict(extra="ignore", frozen=True, arbitrary_types_allowed=True)


Model = TypeVar("Model", bound=Data)


class ShapeData(Data):
    """A convex shape in the body frame; ``size`` as in a task file, ``vertices`` of the hull of a mesh, unscaled."""

    shape: ShapeKind
    size: list[Extent]
    pose: PoseVector = Field(default_factory=IDENTITY.copy)
    mesh: str | None = None
    vertices: Points | None = None

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

    lower: Vector3
    upper: Vector3


class BodyData(Data):
    """A body; ``shape`` is ``compound`` if it has several shapes, which are listed in ``parts``."""

    name: str
    kind: BodyKind
    shape: Literal["box", "cylinder", "sphere", "capsule", "mesh", "compound"]
    size: list[Extent] | None = None
    mesh: str | None = None
    vertices: Points | None = None
    parts: list[ShapeData] | None = None
    pose: PoseVector
    mass: Amount = 0.0
    friction: Amount
    graspable: list[RegionData] = []
    color: Vector4 | None = None

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
    """A two-finger gripper; lengths in metres, force in newtons, speed in metres per second."""

    joint_names: list[str]
    per_joint: Real | list[Real]
    finger_links: list[str]
    min_opening: Real
    max_opening: Real
    open_opening: Real
    tip_offset: Real
    pad_half_width: Real
    force: Real
    at_zero: Real | list[Real] = 0.0
    openings: list[Real] = []
    tips: list[Real] = []
    speed: Extent = GRIPPER_SPEED

    @model_validator(mode="after")
    def _fits(self) -> "GripperData":
        for key in ("per_joint", "at_zero"):
            value = getattr(self, key)
            if isinstance(value, list) and len(value) != len(self.joint_names):
                problem = "{key} must be one number, or one for each of the {n} joints"
                raise PydanticCustomError("length", problem, {"key": key, "n": len(self.joint_names)})
        if len(self.openings) == 1 or any(b <= a for a, b in pairwise(self.openings)):
            raise PydanticCustomError("openings", "openings must be two or more that increase, or none")
        if self.tips and len(self.tips) != len(self.openings):
            problem = "tips has {m} numbers; openings has {n}"
            raise PydanticCustomError("length", problem, {"m": len(self.tips), "n": len(self.openings)})
        return self


class AttachedData(Data):
    """A body that is attached to a robot, such as a tool in use; ``opening`` of the gripper in metres."""

    name: str
    parts: list[ShapeData]
    T_ee_body: PoseVector
    opening: Real
    friction: Amount
    up: Vector3
    mass: Amount = 0.0


class RobotData(Data):
    """A robot: its base pose, start configuration and model."""

    model: str
    urdf: str
    base_pose: PoseVector
    q_start: Vector
    joint_names: list[str]
    end_effector_link: str
    T_link_ee: PoseVector
    home: Vector
    position_limits: Limits
    velocity_limits: Vector
    acceleration_limits: Vector
    ignored_collisions: list[tuple[str, str]] = []
    gripper: GripperData | None = None
    simulation: dict[str, Any] = {}
    held: AttachedData | None = None
    payload: Extent | None = None

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
    """Goal pose of an object, with tolerances."""

    object: str
    pose: PoseVector
    position_tolerance_m: Extent
    rotation_tolerance_rad: Extent


class ToleranceData(Data):
    """Distance of the object from its goal that counts as reached after execution."""

    position_m: Extent
    rotation_rad: Extent


class BodiesData(Data):
    """The bodies, and the freedom of the goal's object."""

    bodies: list[BodyData]
    motion: Literal["auto", "planar", "spatial"] = "auto"
    removable: dict[str, PoseVector | None] = {}


class SceneData(Data):
    """The keys that scene and plan files have in common."""

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
    """A scene without a plan."""

    format: Literal["hmap-scene"]
    version: Literal[1]


def parse(model: type[Model], data: Any, source: str, code: Code) -> Model:
    """Validates data.

    Args:
        model: the pydantic model.
        data: a JSON value.
        source: name of the document in error messages.
        code: error code.

    Returns:
        The data as ``model``.

    Raises:
        InputError: with ``code``; the reason names ``source``, the key and the problem.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        detail = error.errors(include_url=False)[0]
        problem = detail["msg"].replace("Input should", "must")
        value = detail.get("input")
        shown = f" = {value!r}" if isinstance(value, str | int | float | bool) else ""
        raise InputError(f"{source}: {key_text(tuple(detail['loc']))}{shown}: {problem}", code) from error
