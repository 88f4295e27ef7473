"""Validates a YAML document against a pydantic model; errors name the file and line."""

from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import ValidationError

from hmap_core.exceptions import Code, InputError
from hmap_core.scenes.document import Document, Location
from hmap_core.scenes.expressions import evaluate
from hmap_core.scenes.fields import NAME_RULE, Strict, did_you_mean

Model = TypeVar("Model", bound=Strict)
_BOUNDS = {"greater_than", "greater_than_equal", "less_than", "less_than_equal", "too_large"}
_KINDS = {
    "dict_type": "must be a mapping of names to entries",
    "list_type": "must be a list",
    "string_type": "must be text",
    "bool_type": "must be true or false",
    "int_type": "must be an integer",
}
_POSE_KEYS = {"xyz", "rpy_deg", "quaternion"}


def validate(model: type[Model], document: Document, parameters: Mapping[str, float], location: Location = ()) -> Model:
    """Validates a document, or a part of it.

    Args:
        model: the pydantic model.
        document: the YAML file, or data built in code.
        parameters: values for the expressions in the document.
        location: of the part; empty for the whole document.

    Returns:
        The part as ``model``, with expressions evaluated.

    Raises:
        InputError: INVALID_SCENE, or INVALID_POSE for an invalid pose; the reason names the file, line, key and value.
    """
    try:
        return model.model_validate(document.value(location), context={"parameters": parameters})
    except ValidationError as error:
        raise _input_error(document, error, parameters, location) from error


def _input_error(
    document: Document, error: ValidationError, parameters: Mapping[str, float], part: Location
) -> InputError:
    details = error.errors(include_url=False)
    first = details[0]
    location = (*part, *_location(first))
    problem = _problem(first) + _evaluated(document.value(location), first, parameters)
    error_out = document.error(location, problem, _code(first))
    if len(details) > 1 and not document.origin:
        more = ", ".join(str(document.line((*part, *_location(detail)))) for detail in details[1:4])
        return InputError(f"{error_out.reason} (further errors in line {more})", error_out.code)
    return error_out


def _location(detail: Mapping[str, Any]) -> Location:
    location = tuple(step for step in detail["loc"] if step != "[key]")
    key = detail.get("ctx", {}).get("key")
    return (*location, key) if key is not None else location


def _problem(detail: Mapping[str, Any]) -> str:
    kind, context, value = detail["type"], detail.get("ctx", {}), detail.get("input")
    match kind:
        case "missing":
            return "is missing; it must be given"
        case "enum" | "literal_error":
            expected = [word.strip("'") for word in context["expected"].replace(" or ", ", ").split(", ")]
            return f"must be one of {', '.join(expected)}.{did_you_mean(str(value), expected)}"
        case "string_pattern_mismatch":
            return NAME_RULE
        case "too_short" | "too_long":
            least, most = context.get("min_length"), context.get("max_length")
            return f"has {context['actual_length']} entries; " + (
                f"at least {least} needed" if kind == "too_short" else f"at most {most} allowed"
            )
        case _ if kind in _KINDS:
            return _KINDS[kind]
    problem = detail["msg"]
    if problem.startswith("Input should"):
        problem = "must" + problem.removeprefix("Input should")
    return problem


def _evaluated(written: Any, detail: Mapping[str, Any], parameters: Mapping[str, float]) -> str:
    """The value of an expression that is out of bounds; empty for other errors."""
    if not isinstance(written, str) or detail["type"] not in _BOUNDS:
        return ""
    return f"; it is {evaluate(written, parameters):.6g}"


def _code(detail: Mapping[str, Any]) -> Code:
    if detail["type"] == "invalid_pose":
        return Code.INVALID_POSE
    if detail["type"] in ("not_finite", "vector") and _POSE_KEYS.intersection(map(str, detail["loc"])):
        return Code.INVALID_POSE
    return Code.INVALID_SCENE
