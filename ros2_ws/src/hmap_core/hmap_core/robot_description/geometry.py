"""Reads the shapes of links."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.mesh_files import read_hull
from hmap_core.robot_description.joints import read_origin
from hmap_core.robot_description.node import Node
from hmap_core.types import Shape, ShapeKind

SIZES = {  # attributes of each kind of shape, with the number of numbers
    "box": (("size", 3),),
    "sphere": (("radius", 1),),
    "cylinder": (("radius", 1), ("length", 1)),
    "capsule": (("radius", 1), ("length", 1)),
}
SPECK = 1e-4  # m; nothing of a robot that collides is smaller
MILLIMETRES = 20.0  # m; a shape that is larger is probably in millimetres

FindFile = Callable[[str], tuple[Path | None, str]]


def read_shape(node: Node, find: FindFile) -> Shape | None:
    """Reads the shape of an element ``<collision>`` or ``<visual>``.

    Args:
        node: the element.
        find: see :func:`hmap_core.robot_description.uris.find_file`.

    Returns:
        The shape, in the link frame; None, with recorded errors, if it cannot be used.
    """
    pose = read_origin(node)
    geometry = node.child("geometry")
    if geometry is None:
        node.error("has no <geometry>", f"give one of {', '.join(SIZES)}, mesh, or remove the element")
        return None
    kinds = geometry.children()
    if len(kinds) != 1:
        problem = "is empty" if not kinds else f"has {len(kinds)} shapes"
        geometry.error(problem, f"give one of {', '.join(SIZES)}, mesh")
        return None
    kind = kinds[0]
    if kind.tag == "mesh":
        return _mesh(kind, pose, find)
    if kind.tag not in SIZES:
        kind.error(f"<{kind.tag}> is not known", f"allowed: {', '.join(SIZES)}, mesh")
        return None
    size: list[float] = []
    for key, count in SIZES[kind.tag]:
        numbers = kind.numbers(key, count)
        if numbers is None:
            return None
        if numbers.min() <= 0.0:
            kind.error(f'{key}="{kind.element.get(key)}" must be above 0')
            return None
        size += numbers.tolist()
    _check_size(kind, max(size))
    return Shape(ShapeKind(kind.tag), tuple(size), pose)


def _mesh(node: Node, pose: np.ndarray, find: FindFile) -> Shape | None:
    name = node.text("filename")
    scale = node.numbers("scale", 3, (1.0, 1.0, 1.0))
    if name is None or scale is None:
        return None
    shown = f'scale="{node.element.get("scale")}"'
    if (scale == 0.0).any():
        node.error(f"{shown} makes the mesh flat", "no number may be 0")
        return None
    if (scale < 0.0).any():
        node.warn(f"{shown} mirrors the mesh")
    path, remedy = find(name)
    if path is None:
        node.error(f"mesh '{name.partition('://')[2] or name}' named in {node.file.name} does not exist", remedy)
        return None
    try:
        hull = read_hull(path)
    except InputError as error:
        node.error(error.reason)
        return None
    for note in hull.notes:
        node.warn(f"mesh '{path}' {note}")
    _check_size(node, float((np.ptp(hull.vertices, axis=0) * np.abs(scale)).max()))
    return Shape(ShapeKind.MESH, tuple(scale.tolist()), pose, path)


def _check_size(node: Node, extent: float) -> None:
    if not SPECK <= extent <= MILLIMETRES:
        node.warn(f"is {extent:g} m large", "lengths are in metres")
