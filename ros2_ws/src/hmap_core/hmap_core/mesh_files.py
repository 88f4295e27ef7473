"""Mesh files: the one reader for robots, scenes and simulation. See ``docs/robots.md``.

The judge has a reader of its own (:mod:`hmap_core.validation.files`).
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from io import BytesIO, StringIO
from pathlib import Path
from xml.parsers import expat

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError

from hmap_core import obj_text
from hmap_core.array_cache import kept_arrays
from hmap_core.exceptions import Code, InputError
from hmap_core.obj_text import DamagedLine, clean_obj

FORMATS = (".stl", ".obj", ".dae", ".glb", ".gltf", ".ply", ".off")
MIN_FACES = 4  # faces of a surface that encloses a volume
LARGEST = 1e6  # m, of a coordinate
SMALLEST = 1e-9  # m, thickness below which a mesh counts as flat
FLAT = 1e-6  # thickness relative to the largest extent below which a mesh counts as flat
MAX_HULL_VERTICES = (
    8192  # of a hull; larger ones are simplified. Indices of vertices have 16 bits in the collision checks
)
FILES_KEPT = 16384  # whose hulls a process keeps; a decomposed body has one for each of its parts
READERS = Path(obj_text.__file__).read_bytes()  # what meshes depend on beside this file
STL_HEADER, STL_TRIANGLE = 84, 50  # bytes of a binary STL file, and of each of its triangles
SNIFFED = 200  # bytes of a file in which it is looked what it is
OTHER_CONTENT = {  # what a file that is no mesh begins with, in small letters -> what it is, and the remedy
    b"version https://git-lfs": "a pointer of Git LFS; fetch the files themselves by 'git lfs pull'",
    b"<!doctype html": "a page of the web; download the file itself",
    b"<html": "a page of the web; download the file itself",
    b"pk\x03\x04": "a ZIP archive; unpack it",
    b"\x1f\x8b": "compressed; unpack it",
}
CHUNK = 256  # directions at once in the computation of support points

logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # its readers log the traces of errors that they get over

# What was assumed in reading a mesh: bits of a number, so that they can be kept with the hull.
INSIDE_OUT, TURNED, SIMPLIFIED = 1, 2, 4
NOTES = {
    INSIDE_OUT: "is inside out: its faces are turned",
    TURNED: "has another <up_axis> than Z_UP, which is ignored, as in RViz and MoveIt",
    SIMPLIFIED: f"has a convex hull of more than {MAX_HULL_VERTICES} vertices, which is simplified from outside",
}


@dataclass(frozen=True)
class MeshHull:
    """The convex hull of a mesh file.

    Attributes:
        vertices: (V, 3), m for formats with a unit, else in units of the file. Must not be modified.
        fill: volume of the mesh relative to its hull; 0 if the surface is open or its faces are not oriented alike.
        notes: what was assumed, one text each that continues the file's name.
    """

    vertices: np.ndarray
    fill: float
    notes: tuple[str, ...]


def read_mesh(path: Path) -> "trimesh.Trimesh":
    """Reads a mesh file as one surface.

    Parts of a scene are placed by the transforms of their nodes. A COLLADA file is scaled by its ``<unit>``. Vertices
    that no face uses are dropped. The faces of a closed surface that is inside out are turned.

    Args:
        path: a file of one of :data:`FORMATS`.

    Returns:
        The surface.

    Raises:
        InputError: INVALID_SCENE; the file is no mesh, or has no volume.
    """
    return _read(path)[0]


def read_hull(path: Path) -> MeshHull:
    """Reads the convex hull of a mesh file.

    Args:
        path: a file of one of :data:`FORMATS`.

    Returns:
        The hull, from a cache.

    Raises:
        InputError: INVALID_SCENE; the file is no mesh, or has no volume.
    """
    try:
        state = path.stat()
    except (OSError, ValueError) as error:
        raise _unusable(path, f"cannot be read: {getattr(error, 'strerror', None) or error}") from error
    return _hull(path, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=FILES_KEPT)
def _hull(path: Path, _changed: int, _size: int) -> MeshHull:
    def compute() -> tuple[np.ndarray, np.ndarray]:
        mesh, notes = _read(path)
        points = np.asarray(mesh.vertices, float)
        hull = _convex_hull(path, points)
        vertices = points[hull.vertices]
        if len(vertices) > MAX_HULL_VERTICES:
            vertices, notes = _simplified(vertices), notes | SIMPLIFIED
        fill = float(mesh.volume) / hull.volume if mesh.is_watertight and mesh.is_winding_consistent else 0.0
        return vertices, np.array([fill, notes])

    if path.suffix.lower() == ".gltf":  # its vertices may be in other files
        vertices, (fill, notes) = compute()
    else:
        try:
            inputs = READERS, path.suffix.lower().encode(), path.read_bytes()
        except OSError as error:
            raise _unusable(path, f"cannot be read: {error.strerror}") from error
        vertices, (fill, notes) = kept_arrays(__file__, inputs, ("numpy", "scipy", "trimesh"), compute)
    vertices.setflags(write=False)
    return MeshHull(vertices, float(fill), tuple(text for bit, text in NOTES.items() if int(notes) & bit))


def _unusable(path: Path, problem: str) -> InputError:
    return InputError(f"mesh '{path}' {problem}", Code.INVALID_SCENE)


def _read(path: Path) -> tuple["trimesh.Trimesh", int]:
    """A surface, and what was assumed: bits of :data:`NOTES`."""
    if path.suffix.lower() not in FORMATS:
        raise _unusable(path, f"is of an unknown format; allowed: {', '.join(FORMATS)}")
    try:
        _check_content(path)
    except OSError as error:
        raise _unusable(path, f"cannot be read: {error.strerror}") from error
    unit, notes = _collada_asset(path) if path.suffix.lower() == ".dae" else (1.0, 0)
    try:
        load = _loader(path)
        finite = bool(np.isfinite(load(process=False).vertices).all())
        mesh = load(process=True)  # drops vertices that are not finite, and their faces
        if mesh.vertices.shape[1:] != (3,):
            raise ValueError("its vertices have no three coordinates")
        mesh.remove_unreferenced_vertices()
    except ModuleNotFoundError as error:
        raise _unusable(path, f"needs the Python package {error.name}: pip install {error.name}") from error
    except DamagedLine as error:
        raise _unusable(path, f"is not a mesh: {error}") from error
    except Exception as error:  # the readers of the various formats raise exceptions of any type
        what = " ".join(f"{type(error).__name__}: {error}".split())
        raise _unusable(path, f"is not a mesh: {what}; export it again") from error
    if not finite:
        raise _unusable(path, "is not a mesh: a coordinate is not finite; export it again")
    if len(mesh.faces) < MIN_FACES:
        raise _unusable(path, f"is not a mesh: it has {len(mesh.faces)} triangles; at least {MIN_FACES} are needed")
    if np.abs(mesh.vertices).max() * unit > LARGEST:
        raise _unusable(path, f"is not a mesh: a coordinate is larger than {LARGEST:g} m")
    if unit != 1.0:
        mesh.apply_scale(unit)
    with np.errstate(all="ignore"):  # a volume of 0 is refused with the hull
        if mesh.is_watertight and mesh.is_winding_consistent and mesh.volume < 0.0:
            mesh.invert()
            notes |= INSIDE_OUT
    return mesh, notes


def _check_content(path: Path) -> None:
    """Refuses what is no mesh whatever the file's name says, with its remedy."""
    with path.open("rb") as stream:
        begin = stream.read(SNIFFED).lstrip().lower()
    for start, problem in OTHER_CONTENT.items():
        if begin.startswith(start):
            raise _unusable(path, f"is not a mesh: it is {problem}")


def _stl(path: Path) -> bytes:
    """The content of an STL file; of a binary one as many bytes as its header says, since trimesh allows no more."""
    data = path.read_bytes()
    count = int.from_bytes(data[STL_HEADER - 4 : STL_HEADER], "little")
    size = STL_HEADER + STL_TRIANGLE * count
    if count and size <= len(data):
        return data[:size]
    if b"facet" not in data.lower():
        raise ValueError(f"its header says {count} triangles, which are {size} bytes, and it has {len(data)}")
    return data


def _loader(path: Path) -> Callable[..., "trimesh.Trimesh"]:
    """Loads a file by trimesh, with its options; an OBJ file in plain text, since trimesh guesses at other text."""
    if path.suffix.lower() == ".stl":
        content = _stl(path)
        return lambda **options: trimesh.load_mesh(BytesIO(content), file_type="stl", **options)
    if path.suffix.lower() != ".obj":
        return partial(trimesh.load_mesh, path)
    text = clean_obj(path.read_text(encoding="utf-8", errors="replace"))
    resolver = trimesh.resolvers.FilePathResolver(str(path))
    return lambda **options: trimesh.load_mesh(StringIO(text), file_type="obj", resolver=resolver, **options)


def _collada_asset(path: Path) -> tuple[float, int]:
    """The unit of a COLLADA file in metres, and the bits of :data:`NOTES`."""
    unit, up, texts = ["1"], [""], []
    parser = expat.ParserCreate()

    def begin(tag: str, attributes: dict[str, str]) -> None:
        texts.append("")
        if tag.endswith("unit") and "meter" in attributes:
            unit[0] = attributes["meter"]

    def add(text: str) -> None:
        if texts:
            texts[-1] += text

    def end(tag: str) -> None:
        text = texts.pop()
        if tag.endswith("up_axis"):
            up[0] = text.strip()
        if tag.endswith("asset"):
            raise StopIteration  # only the first one counts, and the geometry after it is long

    parser.StartElementHandler, parser.EndElementHandler, parser.CharacterDataHandler = begin, end, add
    try:
        parser.Parse(path.read_bytes(), True)
    except StopIteration:
        pass
    except (OSError, expat.ExpatError, ValueError, LookupError) as error:
        raise _unusable(path, f"is not a mesh: {error}") from error
    try:
        factor = float(unit[0])
    except ValueError:
        factor = 0.0
    if not 0.0 < factor < LARGEST:
        raise _unusable(path, f'has <unit meter="{unit[0]}">; a number above 0 is needed')
    return factor, TURNED if up[0] not in ("", "Z_UP") else 0


def _convex_hull(path: Path, points: np.ndarray) -> ConvexHull:
    extent = np.ptp(points, axis=0).max()
    thickness = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1] / np.sqrt(len(points))
    try:
        if thickness <= max(FLAT * extent, SMALLEST):
            raise QhullError("flat")
        return ConvexHull(points)
    except QhullError as error:
        raise _unusable(path, "is flat: its points span no volume") from error


def _simplified(points: np.ndarray) -> np.ndarray:
    """A hull of fewer vertices that contains a convex hull with the vertices ``points`` (V, 3).

    It is the hull of the support points in directions that cover the sphere evenly (a Fibonacci lattice), enlarged from
    its centre until it contains all points.
    """
    n = MAX_HULL_VERTICES
    z = 1.0 - (2.0 * np.arange(n) + 1.0) / n
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(n)
    around = np.sqrt(1.0 - z * z)
    directions = np.column_stack([around * np.cos(angle), around * np.sin(angle), z])
    size = np.ptp(points, axis=0)
    chosen = [(d @ (points / size).T).argmax(axis=1) for d in np.array_split(directions, n // CHUNK)]
    inner = points[np.unique(np.concatenate(chosen))]
    center = inner.mean(axis=0)
    hull = ConvexHull(inner)
    normals, offsets = hull.equations[:, :3], hull.equations[:, 3] + hull.equations[:, :3] @ center
    chunks = np.array_split(np.arange(len(normals)), len(normals) // CHUNK + 1)
    reach = np.concatenate([(normals[i] @ (points - center).T).max(axis=1) for i in chunks])
    return center + (inner[hull.vertices] - center) * float((reach / -offsets).max())
