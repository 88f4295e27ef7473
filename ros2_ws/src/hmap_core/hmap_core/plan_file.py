"""Plan files: JSON that other programs can read and check without this package.

``docs/plan_file.md`` describes every field.
"""

import json
import math
import os
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from hmap_core.exceptions import Code, InputError
from hmap_core.regular_file import regular
from hmap_core.scenes.arrays import DECIMALS, JointSamples, PoseVector, PoseVectors, Vector, to_lists
from hmap_core.scenes.json_schema import schema_folder, schema_text
from hmap_core.scenes.portable import read_json, scene_from_data, scene_to_dict
from hmap_core.scenes.scene_data import Data, SceneData, parse
from hmap_core.types import BodyKind, Plan, Segment, SegmentKind, Trajectory

FORMAT = "hmap-plan"
SCHEMA_FILE = "plan.schema.json"
VERSION = 1


class TrajectoryData(Data):
    """Samples of all robots and movable bodies, as in :class:`hmap_core.types.Trajectory`."""

    time: Vector
    joints: dict[str, JointSamples]
    gripper: dict[str, Vector]
    objects: dict[str, PoseVectors]

    @model_validator(mode="after")
    def _aligned(self) -> "TrajectoryData":
        if len(self.time) < 1 or self.time[0] != 0.0 or np.any(np.diff(self.time) <= 0.0):
            raise PydanticCustomError("time", "time must start at 0 and increase")
        for key in ("joints", "gripper", "objects"):
            for name, samples in getattr(self, key).items():
                if len(samples) != len(self.time):
                    raise PydanticCustomError(
                        "length",
                        "{key}.{name} has {n} samples; time has {N}",
                        {"key": key, "name": name, "n": len(samples), "N": len(self.time)},
                    )
        return self


class SegmentData(Data):
    """An interval of the plan with one contact mode, as in :class:`hmap_core.types.Segment`."""

    start: Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
    end: Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
    robot: str
    manipulator: str
    object: str | None = None
    kind: SegmentKind
    contact_pose: PoseVector | None = None
    force: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = None

    @model_validator(mode="after")
    def _complete(self) -> "SegmentData":
        if self.end < self.start:
            raise PydanticCustomError("segment", "end must not be before start")
        if self.kind is not SegmentKind.TRANSIT and (self.object is None or self.contact_pose is None):
            problem = "a {kind} segment needs object and contact_pose"
            raise PydanticCustomError("segment", problem, {"kind": self.kind.value})
        if (self.kind is SegmentKind.PRESS) != (self.force is not None):
            raise PydanticCustomError("segment", "a press segment needs a force in N, and no other kind has one")
        return self


class PlanDocument(SceneData):
    """A plan file, version 1."""

    format: Literal["hmap-plan"]
    version: Literal[1]
    trajectory: TrajectoryData
    segments: list[SegmentData]
    waypoints: PoseVectors
    stats: dict[str, Any] = {}

    @model_validator(mode="after")
    def _consistent(self) -> "PlanDocument":
        robots = {name: len(robot.joint_names) for name, robot in self.robots.items()}
        bodies = [body.name for body in self.scene.bodies]
        movable = [body.name for body in self.scene.bodies if body.kind is not BodyKind.FIXED]
        for key in ("joints", "gripper"):
            _same_names(f"trajectory.{key}", getattr(self.trajectory, key), robots)
        _same_names("trajectory.objects", self.trajectory.objects, movable)
        for name, samples in self.trajectory.joints.items():
            if samples.shape[1] != robots[name]:
                context = {"name": name, "n": samples.shape[1], "expected": robots[name]}
                raise PydanticCustomError("length", "trajectory.joints.{name} has {n} joints, not {expected}", context)
        for i, segment in enumerate(self.segments):
            _known(f"segments[{i}].robot", segment.robot, robots)
            if segment.object is not None:
                _known(f"segments[{i}].object", segment.object, bodies)
        return self


def _same_names(key: str, given: Any, expected: Any) -> None:
    if set(given) != set(expected):
        context = {"key": key, "given": ", ".join(given) or "none", "expected": ", ".join(expected) or "none"}
        raise PydanticCustomError("name", "{key} must have the keys {expected}; it has {given}", context)


def _known(key: str, name: str, known: Any) -> None:
    if name not in known:
        context = {"key": key, "name": repr(name), "known": ", ".join(known)}
        raise PydanticCustomError("name", "{key} = {name} is not in the scene; there are: {known}", context)


def to_dict(plan: Plan, arrays: bool = False) -> dict[str, Any]:
    """Converts a plan to a JSON value. Lengths, angles and times are rounded to 1e-9.

    Args:
        plan: the plan.
        arrays: whether the numbers of the trajectory stay arrays, which JSON has not.

    Returns:
        The document, as ``docs/plan_file.md`` describes it.

    Raises:
        InputError: INVALID_PLAN_FILE if the plan contains NaN or infinity.
    """
    document = {"format": FORMAT, "version": VERSION} | scene_to_dict(plan.scene)
    document |= {
        "stats": _jsonable(plan.stats),
        "waypoints": _finite(plan.waypoints, "plan.waypoints"),
        "segments": [_segment_dict(segment) for segment in plan.segments],
    }
    _check_finite(document, "plan")
    return document | {"trajectory": _trajectory_dict(plan.trajectory, arrays)}


def from_dict(document: Any, source: str = "plan") -> Plan:
    """Builds a plan from a JSON value; inverse of :func:`to_dict` up to rounding.

    Args:
        document: as :func:`to_dict` returns it.
        source: name of the document in error messages, such as its file name.

    Returns:
        The plan.

    Raises:
        InputError: INVALID_PLAN_FILE; the reason names the key, its value and what is allowed.
    """
    data = parse(PlanDocument, document, source, Code.INVALID_PLAN_FILE)
    return Plan(
        scene=scene_from_data(data, source, Code.INVALID_PLAN_FILE),
        trajectory=Trajectory(
            time=data.trajectory.time,
            joints=data.trajectory.joints,
            gripper=data.trajectory.gripper,
            objects=data.trajectory.objects,
        ),
        segments=tuple(Segment(**dict(segment)) for segment in data.segments),
        waypoints=data.waypoints,
        stats=data.stats,
    )


def save(plan: Plan, path: str | Path) -> None:
    """Writes a plan file atomically: no other process sees an incomplete file.

    Args:
        plan: the plan.
        path: the file, which is replaced if it exists.

    Raises:
        InputError: INVALID_PLAN_FILE if the file cannot be written or the plan contains NaN or infinity.
    """
    path = Path(path)
    members = [f"{json.dumps(key)}: {json.dumps(value)}" for key, value in to_dict(plan).items()]
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.write_text("{\n" + ",\n".join(members) + "\n}\n", encoding="utf-8")
        temporary.replace(path)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise InputError(f"{path}: cannot be written: {error}", Code.INVALID_PLAN_FILE) from error


def load(path: str | Path) -> Plan:
    """Reads a plan file.

    Args:
        path: the file.

    Returns:
        The plan.

    Raises:
        InputError: INVALID_PLAN_FILE if the file cannot be read or is not a valid plan file.
    """
    try:
        text = regular(path).read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise InputError(f"{path}: cannot be read: {why}", Code.INVALID_PLAN_FILE) from error
    return from_dict(read_json(text, str(path), Code.INVALID_PLAN_FILE), str(path))


def _trajectory_dict(trajectory: Trajectory, arrays: bool) -> dict[str, Any]:
    def written(samples: np.ndarray, key: str) -> Any:
        rounded = _rounded(samples, f"plan.trajectory.{key}")
        return rounded if arrays else rounded.tolist()

    def each(key: str) -> dict[str, Any]:
        return {name: written(samples, f"{key}.{name}") for name, samples in getattr(trajectory, key).items()}

    time = written(trajectory.time, "time")
    return {"time": time} | {key: each(key) for key in ("joints", "gripper", "objects")}


def _finite(array: np.ndarray, key: str) -> list:
    """Converts an array to nested lists of rounded numbers; raises as :func:`_rounded`."""
    return _rounded(array, key).tolist()


def _rounded(array: np.ndarray, key: str) -> np.ndarray:
    """The rounded numbers of an array.

    Args:
        array: the numbers.
        key: name of the array in error messages.

    Raises:
        InputError: the array contains NaN or infinity; the reason names the index.
    """
    fine = np.isfinite(array)
    if not fine.all():
        wrong = np.argwhere(~fine)
        place = "".join(f"[{i}]" for i in wrong[0])
        raise InputError(f"{key}{place} = {array[tuple(wrong[0])]}: must be finite", Code.INVALID_PLAN_FILE)
    return np.round(np.asarray(array, float), DECIMALS)


def _segment_dict(segment: Segment) -> dict[str, Any]:
    data: dict[str, Any] = {
        "start": round(float(segment.start), DECIMALS),
        "end": round(float(segment.end), DECIMALS),
        "robot": segment.robot,
        "manipulator": segment.manipulator,
        "object": segment.object,
        "kind": segment.kind.value,
        "contact_pose": None if segment.contact_pose is None else to_lists(segment.contact_pose),
    }
    if segment.force is not None:
        data["force"] = float(segment.force)
    return data


def _jsonable(value: Any) -> Any:
    """Converts statistics, which may contain NumPy values, to JSON; numbers that are not finite become null."""
    if isinstance(value, dict):
        return {str(key): _jsonable(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_jsonable(entry) for entry in value]
    if isinstance(value, np.ndarray | np.generic):
        return _jsonable(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, bool | int | str):
        return value
    return str(value)


def _check_finite(value: Any, key: str) -> None:
    if isinstance(value, dict):
        for name, entry in value.items():
            _check_finite(entry, f"{key}.{name}")
    elif isinstance(value, list):
        for i, entry in enumerate(value):
            _check_finite(entry, f"{key}[{i}]")
    elif isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{key} = {value}: must be finite", Code.INVALID_PLAN_FILE)


def json_schema() -> str:
    """The JSON Schema of plan files. ``python -m hmap_core.plan_file`` writes it into ``hmap_scenes``."""
    return schema_text("plan", PlanDocument)


if __name__ == "__main__":
    (schema_folder() / SCHEMA_FILE).write_text(json_schema(), encoding="utf-8")
