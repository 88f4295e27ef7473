"""Triangles of links and bodies, as they are drawn."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from hmap_core.array_cache import kept_arrays
from hmap_core.collision.convex import hull_vertices
from hmap_core.exceptions import InputError
from hmap_core.mesh_files import read_mesh
from hmap_core.robot_description import load_robot_description
from hmap_core.robot_description.geometry import read_shape
from hmap_core.robot_description.node import Node
from hmap_core.robot_description.uris import find_file
from hmap_core.transforms import apply
from hmap_core.types import Body, RobotModel, Shape, ShapeKind

CELLS = 90  # cells of the grid on which a mesh is simplified, along its longest side
SECTIONS = 32  # of round shapes
GREY = (200, 200, 204)  # of links without a colour

Color = tuple[int, int, int]


@dataclass(frozen=True)
class Surface:
    """Triangles of one colour.

    Attributes:
        vertices: (V, 3) m.
        faces: (F, 3) indices of vertices.
        color: RGB, 0 to 255.
        opacity: 0 to 1.
    """

    vertices: np.ndarray
    faces: np.ndarray
    color: Color = GREY
    opacity: float = 1.0


def body_surface(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and faces (F, 3) of a body, in its frame."""
    return _joined([_shape_surface(shape) for shape in body.shapes])


def link_surfaces(model: RobotModel) -> dict[str, list[Surface]]:
    """The surfaces of a robot's links, in their frames: what its description draws, else its collision shapes."""
    description = load_robot_description(model.urdf).require_valid()
    found: dict[str, list[Surface]] = {}
    element: Element = Element("robot") if description.element is None else description.element
    named = {m.get("name", ""): color for m in element.findall("material") if (color := _color(m))}
    for material in element.findall("link/visual/material"):
        if color := _color(material):
            named.setdefault(material.get("name", ""), color)
    drawn = {link.get("name", ""): link.findall("visual") for link in element.findall("link")}
    for name, link in description.links.items():
        parts: dict[tuple[Color, float], list] = {}
        for visual in drawn.get(name, ()):
            shape = read_shape(
                Node(visual, f"link '{name}'", description.file, []),
                lambda mesh: find_file(mesh, description.file, description.packages),
            )
            painted = visual.find("material")
            color = None if painted is None else _color(painted) or named.get(painted.get("name", ""))
            if shape is not None:
                parts.setdefault(color or (GREY, 1.0), []).append(_drawn(shape))
        if not parts and link.shapes:
            parts[GREY, 1.0] = [_shape_surface(shape) for shape in link.shapes]
        found[name] = [Surface(*_joined(surfaces), *color) for color, surfaces in parts.items()]
    return found


def _color(material: Element) -> tuple[Color, float] | None:
    """RGB and opacity that a material names; None where it names none."""
    color = material.find("color")
    texts = "" if color is None else color.get("rgba", "")
    try:
        numbers = [min(max(float(text), 0.0), 1.0) for text in texts.split()]
    except ValueError:
        return None
    if len(numbers) != 4:
        return None
    r, g, b = (round(255 * number) for number in numbers[:3])
    return (r, g, b), numbers[3]


def _drawn(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """A visual shape: a mesh as it is, not its hull."""
    if shape.mesh is None:
        return _shape_surface(shape)
    try:
        vertices, faces = _mesh(shape.mesh)
    except InputError:
        return _shape_surface(shape)
    return apply(shape.pose, vertices * np.array(shape.size)), faces


@lru_cache(maxsize=256)
def _mesh(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """A simplified mesh, from the cache of arrays."""

    def compute() -> tuple[np.ndarray, np.ndarray]:
        mesh = read_mesh(path)
        return simplified(np.asarray(mesh.vertices, float), np.asarray(mesh.faces))

    try:
        inputs = path.suffix.lower().encode(), path.read_bytes()
    except OSError as error:
        raise InputError(f"mesh '{path}' cannot be read: {error.strerror}") from error
    vertices, faces = kept_arrays(__file__, inputs, ("numpy", "trimesh"), compute)
    return vertices, faces


def simplified(vertices: np.ndarray, faces: np.ndarray, cells: int = CELLS) -> tuple[np.ndarray, np.ndarray]:
    """A mesh whose vertices in one cell of a grid are one vertex, their mean.

    Method: Rossignac & Borrel, "Multi-resolution 3D approximations for rendering complex scenes", 1993.

    Args:
        vertices: (V, 3).
        faces: (F, 3).
        cells: of the grid, along the longest side of the mesh.
    """
    lower = vertices.min(axis=0)
    size = max(float(np.ptp(vertices, axis=0).max()) / cells, 1e-9)
    keys = np.floor((vertices - lower) / size).astype(np.int64)
    _, cell, count = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    cell = cell.ravel()
    means = np.stack([np.bincount(cell, vertices[:, k]) / count for k in range(3)], axis=1)
    merged = cell[faces]
    a, b, c = merged.T
    kept = merged[(a != b) & (b != c) & (c != a)]
    if len(kept) == 0:
        return vertices, faces
    _, first = np.unique(np.sort(kept, axis=1), axis=0, return_index=True)
    return means, kept[np.sort(first)]


def _shape_surface(shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """A shape as collisions are checked with it: a mesh is its convex hull."""
    size = [float(number) for number in shape.size]
    if shape.kind is ShapeKind.BOX:
        mesh = trimesh.creation.box(extents=size)
    elif shape.kind is ShapeKind.SPHERE:
        mesh = trimesh.creation.icosphere(subdivisions=3, radius=size[0])
    elif shape.kind is ShapeKind.CYLINDER:
        mesh = trimesh.creation.cylinder(radius=size[0], height=size[1], sections=SECTIONS)
    elif shape.kind is ShapeKind.CAPSULE:
        mesh = trimesh.creation.capsule(radius=size[0], height=size[1], count=[SECTIONS, SECTIONS // 2])
    else:
        vertices, _ = hull_vertices(shape)  # placed in the frame of its body
        return _hull(vertices)
    return apply(shape.pose, np.asarray(mesh.vertices, float)), np.asarray(mesh.faces)


def _hull(vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and faces of a convex hull, whose faces look outwards."""
    hull = ConvexHull(vertices)
    faces = hull.simplices.copy()
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    faces[inwards] = faces[inwards][:, ::-1]
    return vertices, faces


def _joined(surfaces: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in surfaces)])
    vertices = np.concatenate([vertices for vertices, _ in surfaces])
    return vertices, np.concatenate([faces + start for (_, faces), start in zip(surfaces, starts, strict=False)])
