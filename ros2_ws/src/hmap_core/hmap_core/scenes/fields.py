"""Field types of scene files: numbers and expressions, vectors, names, and mappings without unknown keys."""

import difflib
import math
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationInfo, WithJsonSchema, model_validator
from pydantic_core import PydanticCustomError

from hmap_core.scenes.expressions import ExpressionError, evaluate

MAX_MAGNITUDE = 1e3  # largest length, mass or angle of a scene, in its unit
MIN_SIZE = 1e-4  # m; smaller shapes are below the resolution of contacts and collision checks
MAX_SIZE = 100.0  # m
NAME_PATTERN = r"^[A-Za-z][A-Za-z0-9_]*$"  # names become frames, topics and keys of plan files
NAME_RULE = "a name is letters, digits and _, a letter first"

_NUMBER_SCHEMA = {"anyOf": [{"type": "number"}, {"type": "string", "description": "an expression of parameters"}]}


def _number(value: Any, info: ValidationInfo) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise PydanticCustomError("number", "must be a number or an expression of parameters")
    try:
        value = evaluate(value, (info.context or {}).get("parameters", {})) if isinstance(value, str) else float(value)
    except ExpressionError as error:
        raise PydanticCustomError("number", "{problem}", {"problem": str(error)}) from error
    except OverflowError:
        value = math.inf
    if not math.isfinite(value):
        raise PydanticCustomError("not_finite", "must be a finite number")
    if abs(value) > MAX_MAGNITUDE:
        raise PydanticCustomError(
            "too_large", "must be between -{limit} and {limit}; units are SI", {"limit": f"{MAX_MAGNITUDE:g}"}
        )
    return value


def _one_or_each(value: Any, info: ValidationInfo) -> float | list[float]:
    if isinstance(value, list):
        return [_number(entry, info) for entry in value]
    if value is None or isinstance(value, dict):
        raise PydanticCustomError("number", "must be a number, or a list with one for each of the joints")
    return _number(value, info)


def _list_of(count: int, meaning: str) -> BeforeValidator:
    def check(value: Any) -> Any:
        if not isinstance(value, list | tuple) or len(value) != count:
            raise PydanticCustomError(
                "vector", "must be a list of {count} numbers {meaning}", {"count": count, "meaning": meaning}
            )
        return value

    return BeforeValidator(check)


Number = Annotated[float, BeforeValidator(_number), WithJsonSchema(_NUMBER_SCHEMA)]
OneOrEach = Annotated[
    Any,
    BeforeValidator(_one_or_each),
    WithJsonSchema({"anyOf": [*_NUMBER_SCHEMA["anyOf"], {"type": "array", "items": _NUMBER_SCHEMA, "minItems": 1}]}),
]  # one number for all joints, or a list with one number for each
Positive = Annotated[Number, Field(gt=0.0)]
NonNegative = Annotated[Number, Field(ge=0.0)]
Size = Annotated[Number, Field(ge=MIN_SIZE, le=MAX_SIZE)]
Unit = Annotated[Number, Field(ge=0.0, le=1.0)]
Vector3 = Annotated[tuple[Number, Number, Number], _list_of(3, "[x, y, z]")]
Rpy = Annotated[tuple[Number, Number, Number], _list_of(3, "[roll, pitch, yaw]")]
Quaternion = Annotated[tuple[Number, Number, Number, Number], _list_of(4, "[x, y, z, w]")]
Rgba = Annotated[tuple[Unit, Unit, Unit, Unit], _list_of(4, "[red, green, blue, alpha]")]
Name = Annotated[str, Field(pattern=NAME_PATTERN)]


def did_you_mean(word: str, known: list[str]) -> str:
    """The text `` Did you mean 'x'?`` if a known word is similar to ``word``, else an empty text."""
    near = difflib.get_close_matches(word, known, n=1)
    return f" Did you mean {near[0]!r}?" if near else ""


class Strict(BaseModel):
    """A mapping that rejects unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=False)

    @model_validator(mode="before")
    @classmethod
    def _known_keys(cls, data: Any) -> Any:
        known = [field.alias or name for name, field in cls.model_fields.items()]
        if not isinstance(data, dict):
            raise PydanticCustomError("mapping", "must be a mapping with the keys {known}", {"known": ", ".join(known)})
        for key in data:
            if key not in known:
                raise PydanticCustomError(
                    "unknown_key",
                    "unknown key.{suggestion} Known: {known}",
                    {"key": key, "suggestion": did_you_mean(key, known), "known": ", ".join(known)},
                )
        return data
