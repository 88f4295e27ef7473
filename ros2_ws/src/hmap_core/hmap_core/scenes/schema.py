"""Pydantic models of task, object and robot files, version 1. ``docs/scenes.md`` explains the keys."""

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, StrictBool, StrictInt, WithJsonSchema, model_validator
from pydantic_core import PydanticCustomError

from hmap_core import transforms
from hmap_core.scenes.arrays import QUATERNION_TOLERANCE
from hmap_core.scenes.fields import (
    Name,
    NonNegative,
    Number,
    OneOrEach,
    Positive,
    Quaternion,
    Rgba,
    Rpy,
    Size,
    Strict,
    Vector3,
)
from hmap_core.types import ShapeKind, TaskMode

SCHEMA_VERSION = 1
MAX_FRICTION = 5.0  # lateral Coulomb coefficient
MAX_IMAGE_SIDE = 4096  # pixels
MAX_MASS = 100.0  # kg

# the numbers of the size of each shape, with their meaning
SIZES = {
    ShapeKind.BOX: "[x, y, z] full extents",
    ShapeKind.CYLINDER: "[radius, height]",
    ShapeKind.SPHERE: "[radius]",
    ShapeKind.CAPSULE: "[radius, height of the cylindrical part]",
    ShapeKind.MESH: "[x, y, z] scale",
}


def _version(value: Any) -> Any:
    if value != SCHEMA_VERSION or isinstance(value, bool):
        raise PydanticCustomError("version", "must be {version}, the schema's version", {"version": SCHEMA_VERSION})
    return value


_PARAMETER_SCHEMA = {
    "anyOf": [
        {"type": "number"},
        {"type": "string", "description": "an expression of other parameters"},
        {
            "type": "object",
            "properties": {"uniform": {"type": "array", "minItems": 2, "maxItems": 2}},
            "required": ["uniform"],
            "additionalProperties": False,
        },
        {
            "type": "object",
            "properties": {"choice": {"type": "array", "minItems": 1}},
            "required": ["choice"],
            "additionalProperties": False,
        },
    ]
}
# parameters.draw reads and validates them
Parameters = dict[Name, Annotated[Any, WithJsonSchema(_PARAMETER_SCHEMA)]]
Version = Annotated[Literal[1], BeforeValidator(_version)]


class Pose(Strict):
    """A frame: position in metres; rotation as fixed-axis roll, pitch, yaw in degrees or as a unit quaternion."""

    xyz: Vector3 = (0.0, 0.0, 0.0)
    rpy_deg: Rpy | None = None
    quaternion: Quaternion | None = None

    @model_validator(mode="after")
    def _one_rotation(self) -> "Pose":
        if self.rpy_deg is not None and self.quaternion is not None:
            raise PydanticCustomError("invalid_pose", "give rpy_deg or quaternion, not both")
        if self.quaternion is not None:
            norm = float(np.linalg.norm(self.quaternion))
            if abs(norm - 1.0) > QUATERNION_TOLERANCE:
                raise PydanticCustomError(
                    "invalid_pose",
                    "quaternion has norm {norm}; it must be 1 within {tolerance}",
                    {"norm": f"{norm:.6g}", "tolerance": QUATERNION_TOLERANCE},
                )
        return self

    def vector(self) -> np.ndarray:
        """The frame as a pose (7,)."""
        if self.quaternion is not None:
            return transforms.pose(self.xyz, self.quaternion)
        return transforms.from_rpy(self.xyz, np.deg2rad(self.rpy_deg or (0.0, 0.0, 0.0)))


class Part(Strict):
    """A convex shape."""

    shape: ShapeKind
    size: list[Size] | None = None
    mesh: str | None = None
    convex_hull: StrictBool = False
    decompose: StrictBool = False
    pose: Pose = Pose()

    @model_validator(mode="after")
    def _size_fits(self) -> "Part":
        _check_shape(self.shape, self.size, self.mesh)
        _check_mesh(self.convex_hull, self.decompose)
        return self


def _check_shape(shape: ShapeKind, size: list[float] | None, mesh: str | None) -> None:
    if shape is ShapeKind.MESH and mesh is None:
        raise PydanticCustomError("shape", "a mesh needs the key mesh: the file it is in")
    if shape is not ShapeKind.MESH and mesh is not None:
        raise PydanticCustomError("shape", "the key mesh is for shape: mesh")
    meaning = SIZES[shape]
    count = meaning.split("]")[0].count(",") + 1
    if size is None and shape is not ShapeKind.MESH or size is not None and len(size) != count:
        raise PydanticCustomError(
            "shape", "size of a {shape} is {meaning}", {"shape": shape.value, "meaning": meaning, "key": "size"}
        )


def _check_mesh(convex_hull: bool, decompose: bool) -> None:
    if convex_hull and decompose:
        raise PydanticCustomError("shape", "give convex_hull: true or decompose: true, not both")


class Region(Strict):
    """An axis-aligned box in the body frame that restricts the contact positions."""

    lower: Vector3
    upper: Vector3

    @model_validator(mode="after")
    def _ordered(self) -> "Region":
        if any(low >= high for low, high in zip(self.lower, self.upper, strict=True)):
            raise PydanticCustomError("region", "lower must be below upper in x, y and z")
        return self


class Geometry(Strict):
    """Geometry and material of a body: one shape, or several in ``parts``."""

    shape: ShapeKind | None = None
    size: list[Size] | None = None
    mesh: str | None = None
    convex_hull: StrictBool = False
    decompose: StrictBool = False
    parts: Annotated[list[Part], Field(min_length=1)] | None = None
    mass: Annotated[Number, Field(ge=0.0, le=MAX_MASS)] | None = None
    friction: Annotated[Number, Field(ge=0.0, le=MAX_FRICTION)] | None = None
    graspable: list[Region] | None = None
    color: Rgba | None = None

    @model_validator(mode="after")
    def _shape_or_parts(self) -> "Geometry":
        if self.shape is not None:
            if self.parts is not None:
                raise PydanticCustomError("shape", "give shape or parts, not both")
            _check_shape(self.shape, self.size, self.mesh)
            _check_mesh(self.convex_hull, self.decompose)
        elif self.size is not None or self.mesh is not None:
            raise PydanticCustomError("shape", "size and mesh need the key shape")
        return self


class ObjectFile(Geometry):
    """A reusable object: ``objects/*.yaml``."""

    version: Version = Field(alias="schema")
    description: str = ""
    parameters: Parameters | None = None

    @model_validator(mode="after")
    def _has_shape(self) -> "ObjectFile":
        if self.shape is None and self.parts is None:
            raise PydanticCustomError("shape", "an object needs the key shape or parts")
        return self


class BodyEntry(Geometry):
    """A body of a task: with its own shape, or a reusable object with values for its parameters."""

    object: str | None = None
    values: dict[Name, Number] | None = Field(default=None, alias="with")
    pose: Pose

    @model_validator(mode="after")
    def _object_or_shape(self) -> "BodyEntry":
        has_shape = self.shape is not None or self.parts is not None
        if has_shape == (self.object is not None):
            raise PydanticCustomError("shape", "give one of shape, parts and object")
        if self.values is not None and self.object is None:
            raise PydanticCustomError("shape", "the key with needs the key object")
        return self


class RobotEntry(Strict):
    """A robot of a task."""

    model: str
    base: Pose
    q: list[Number] | None = None


class CameraEntry(Strict):
    """A camera, aimed at a point."""

    position: Vector3
    look_at: Vector3
    up: Vector3 = (0.0, 0.0, 1.0)
    fov_y_deg: Annotated[Number, Field(ge=1.0, le=170.0)] = 42.0
    width: Annotated[StrictInt, Field(ge=1, le=MAX_IMAGE_SIDE)] = 640
    height: Annotated[StrictInt, Field(ge=1, le=MAX_IMAGE_SIDE)] = 480


class GoalEntry(Strict):
    """Goal pose of an object, with tolerances."""

    object: str
    pose: Pose
    position_tolerance: Positive = 0.005
    rotation_tolerance_deg: Annotated[Number, Field(gt=0.0, le=180.0)] = 2.0


class ExecutionTolerance(Strict):
    """Required accuracy of the executed plan; see :class:`hmap_core.types.Scene` for the defaults."""

    position: Positive | None = None
    rotation_deg: Annotated[Number, Field(gt=0.0, le=180.0)] | None = None


class TaskFile(Strict):
    """A task: ``tasks/*.yaml``."""

    version: Version = Field(alias="schema")
    description: str = ""
    mode: TaskMode
    seed: Annotated[StrictInt, Field(ge=0)] = 0
    motion: Literal["auto", "planar", "spatial"] = "auto"
    parameters: Parameters | None = None
    fixed: dict[Name, BodyEntry] = {}
    movable: Annotated[dict[Name, BodyEntry], Field(min_length=1)]
    tools: dict[Name, BodyEntry] = {}
    robots: Annotated[dict[Name, RobotEntry], Field(min_length=1)]
    cameras: dict[Name, CameraEntry] = {}
    goal: GoalEntry
    removable: dict[Name, Pose | None] = {}
    execution_tolerance: ExecutionTolerance = ExecutionTolerance()
    unsolvable: StrictBool = False


class EndEffector(Strict):
    """A link and the end-effector frame in it: z along the approach direction, y along the closing direction."""

    link: str
    pose: Pose = Pose()


class Limits(Strict):
    """Lower and upper joint positions in rad."""

    lower: list[Number]
    upper: list[Number]


class GripperEntry(Strict):
    """A two-finger gripper; openings are gaps between the pads in metres.

    ``per_joint`` is for joints that are proportional to the opening. ``closed`` and ``open`` are for other joints; the
    openings in between are computed from the URDF.
    """

    joints: Annotated[list[str], Field(min_length=1)]
    per_joint: OneOrEach = None
    at_zero: OneOrEach = None
    closed: OneOrEach = None
    open: OneOrEach = None
    finger_links: Annotated[list[str], Field(min_length=1)]
    min_opening: NonNegative | None = None
    max_opening: Positive | None = None
    open_opening: Positive | None = None
    tip_offset: NonNegative | None = None
    pad_half_width: Positive
    force: Positive
    speed: Positive | None = None

    @model_validator(mode="after")
    def _one_way_to_move(self) -> "GripperEntry":
        turning = self.closed is not None or self.open is not None
        if turning == (self.per_joint is not None) or turning and None in (self.closed, self.open):
            raise PydanticCustomError("gripper", "give per_joint, or closed and open")
        if turning and self.at_zero is not None:
            raise PydanticCustomError("gripper", "goes with per_joint, not with closed and open", {"key": "at_zero"})
        if not turning and None in (self.max_opening, self.open_opening):
            raise PydanticCustomError("gripper", "with per_joint, max_opening and open_opening are needed")
        for key in ("per_joint", "at_zero", "closed", "open"):
            value = getattr(self, key)
            if isinstance(value, list) and len(value) != len(self.joints):
                problem = "has {n} numbers; joints has {joints}"
                context = {"key": key, "n": len(value), "joints": len(self.joints)}
                raise PydanticCustomError("gripper", problem, context)
        if not turning and 0.0 in np.atleast_1d(self.per_joint):
            raise PydanticCustomError("gripper", "must not be 0: every joint has to move", {"key": "per_joint"})
        if turning and np.any(np.equal(self.closed, self.open)):
            raise PydanticCustomError("gripper", "must differ from closed: every joint has to move", {"key": "open"})
        return self


class RobotFile(Strict):
    """An arm: ``robots/*.yaml``."""

    version: Version = Field(alias="schema")
    description: str = ""
    urdf: str
    joints: Annotated[list[str], Field(min_length=1)]
    end_effector: EndEffector
    home: list[Number]
    position_limits: Limits
    velocity_limits: list[Positive]
    acceleration_limits: list[Positive]
    payload: Positive | None = None
    gripper: GripperEntry | None = None
    ignored_collisions: list[Annotated[list[str], Field(min_length=2, max_length=2)]] = []
    simulation: dict[str, Any] = {}
