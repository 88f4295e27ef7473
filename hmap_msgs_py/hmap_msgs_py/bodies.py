"""Conversions of shapes and bodies."""

from typing import Any

import numpy as np
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA

from hmap_msgs.msg import Body, Shape
from hmap_msgs_py.checks import field, finite, one_of, same_length
from hmap_msgs_py.poses import point_from_message, point_to_message, pose_from_message, pose_to_message

SHAPE_KINDS = {Shape.BOX: 3, Shape.CYLINDER: 2, Shape.SPHERE: 1, Shape.CAPSULE: 2, Shape.MESH: 3}  # kind -> len(size)
BODY_KINDS = (Body.FIXED, Body.MOVABLE, Body.TOOL)


def shape_to_message(shape: Any) -> Shape:
    """Convert a shape with ``kind``, ``size``, ``pose`` (7,) and, for a mesh, ``mesh``.

    Raises:
        ConversionError: a value is not allowed.
    """
    kind = one_of("kind of shape", field(shape, "kind"), tuple(SHAPE_KINDS))
    size = finite(f"size of {kind}", field(shape, "size"), (SHAPE_KINDS[kind],))
    mesh = field(shape, "mesh", None)
    pose = pose_to_message(field(shape, "pose"), f"pose of {kind}")
    return Shape(kind=kind, size=size.tolist(), pose=pose, mesh="" if mesh is None else str(mesh))


def shape_from_message(message: Shape) -> dict:
    """Convert to ``{kind, size, pose, mesh}``; mesh is None except for meshes.

    Raises:
        ConversionError: a value is not allowed.
    """
    kind = one_of("kind of shape", message.kind, tuple(SHAPE_KINDS))
    return {
        "kind": kind,
        "size": tuple(finite(f"size of {kind}", message.size, (SHAPE_KINDS[kind],)).tolist()),
        "pose": pose_from_message(message.pose, f"pose of {kind}"),
        "mesh": message.mesh or None,
    }


def body_to_message(body: Any, pose: np.ndarray | None = None) -> Body:
    """Convert a body.

    Args:
        body: has ``name``, ``kind``, ``shapes``, ``pose``, ``mass``, ``friction``, ``graspable`` (boxes (2, 3)) and
            ``color`` (4,) or None.
        pose: T_world_body (7,); default: the body's own.

    Raises:
        ConversionError: a value is not allowed.
    """
    name = field(body, "name")
    color = field(body, "color", None)
    rgba = (0.0,) * 4 if color is None else finite(f"color of {name!r}", color, (4,)).tolist()
    boxes = [finite(f"graspable of {name!r}", box, (2, 3)) for box in field(body, "graspable", ())]
    return Body(
        name=name,
        kind=one_of(f"kind of {name!r}", field(body, "kind"), BODY_KINDS),
        shapes=[shape_to_message(shape) for shape in field(body, "shapes")],
        pose=pose_to_message(field(body, "pose") if pose is None else pose, f"pose of {name!r}"),
        mass=float(finite(f"mass of {name!r}", field(body, "mass"), ())),
        friction=float(finite(f"friction of {name!r}", field(body, "friction"), ())),
        graspable_lower=[point_to_message(box[0]) for box in boxes],
        graspable_upper=[point_to_message(box[1]) for box in boxes],
        color=ColorRGBA(r=rgba[0], g=rgba[1], b=rgba[2], a=rgba[3]),
    )


def body_from_message(message: Body) -> dict:
    """Convert to ``{name, kind, shapes, pose, mass, friction, graspable, color}``.

    The shapes are those of :func:`shape_from_message`.

    Raises:
        ConversionError: a value is not allowed.
    """
    name, c = message.name, message.color
    color = np.array([c.r, c.g, c.b, c.a], float)  # not needed: a malformed one is none
    return {
        "name": name,
        "kind": one_of(f"kind of {name!r}", message.kind, BODY_KINDS),
        "shapes": tuple(shape_from_message(shape) for shape in message.shapes),
        "pose": pose_from_message(message.pose, f"pose of {name!r}"),
        "mass": float(finite(f"mass of {name!r}", message.mass, ())),
        "friction": float(finite(f"friction of {name!r}", message.friction, ())),
        "graspable": _boxes(message.graspable_lower, message.graspable_upper, f"graspable_upper of {name!r}"),
        "color": tuple(color.tolist()) if np.isfinite(color).all() and color.any() else None,
    }


def _boxes(lower: list[Point], upper: list[Point], name: str) -> tuple[np.ndarray, ...]:
    same_length(name, upper, len(lower), "boxes")
    corners = zip(lower, upper, strict=True)
    return tuple(np.array([point_from_message(a, name), point_from_message(b, name)]) for a, b in corners)
