"""Files that a plan names by URI, and the vertices of mesh files."""

import re
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from hmap_core.exceptions import Code, InputError

PACKAGES = ("pybullet_data", "hmap_scenes")  # data packages that a URI may name; they are not imported


def invalid_plan(reason: str) -> InputError:
    """The exception for a plan file that cannot be judged: INVALID_PLAN_FILE."""
    return InputError(reason, Code.INVALID_PLAN_FILE)


def _root(scheme: str, uri: str) -> Path:
    if scheme not in PACKAGES:
        allowed = ", ".join(PACKAGES)
        raise invalid_plan(f"{uri!r}: unknown scheme {scheme!r}; allowed are {allowed}, file, or a plain path")
    spec = find_spec(scheme)
    if spec is None or not spec.submodule_search_locations:
        raise invalid_plan(f"{uri!r}: the Python package {scheme!r} is not installed")
    return Path(next(iter(spec.submodule_search_locations)))


def locate(uri: str) -> Path:
    """Path of the file that a URI names.

    Args:
        uri: ``pybullet_data://`` and ``hmap_scenes://`` are relative to these packages; ``file://`` or no scheme is a
            path.

    Returns:
        The path.

    Raises:
        InputError: INVALID_PLAN_FILE; the scheme is unknown or the file does not exist.
    """
    scheme, separator, rest = uri.partition("://")
    if not separator:
        path = Path(uri)
    elif scheme == "file":
        path = Path(rest)
    else:
        path = _root(scheme, uri) / rest
    if not path.is_file():
        raise invalid_plan(f"{uri!r}: no such file ({path})")
    return path


def mesh_points(path: Path) -> np.ndarray:
    """Vertices of a mesh file.

    Args:
        path: the file.

    Returns:
        (V, 3), those that a face uses. In metres for COLLADA files, which have a unit; else in units of the file.

    Raises:
        InputError: INVALID_PLAN_FILE; the file cannot be read or has fewer than four vertices.
    """
    try:
        points = _obj_points(path) if path.suffix.lower() == ".obj" else _other_points(path)
    except Exception as error:
        raise invalid_plan(f"mesh {path}: {error}") from error
    if len(points) < 4 or not np.isfinite(points).all():
        raise invalid_plan(f"mesh {path}: {len(points)} points; a solid needs at least 4, all finite")
    return points


def _obj_points(path: Path) -> np.ndarray:
    vertices: list[list[str]] = []
    used: set[int] = set()
    begun = ""
    for text in (*path.read_text(errors="replace").splitlines(), ""):
        line = begun + text.partition("#")[0]  # a comment ends with its line
        if line.endswith("\\"):
            begun = line[:-1] + " "
            continue
        begun, words = "", line.split()
        if words[:1] == ["v"]:
            vertices.append(words[1:4])
        elif words[:1] == ["f"]:
            numbers = [int(word.partition("/")[0]) for word in words[1:]]
            used |= {number - 1 if number > 0 else len(vertices) + number for number in numbers}
    return np.array([vertices[i] for i in sorted(used)], float).reshape(-1, 3)


def _other_points(path: Path) -> np.ndarray:
    if path.suffix.lower() == ".stl":
        points = _binary_stl_points(path.read_bytes())
        if len(points):
            return points
    import trimesh  # slow to import, and not needed for other files

    mesh: Any = trimesh.load(path, force="mesh")  # declared without the attributes of a mesh
    points = np.asarray(mesh.vertices, float)[np.unique(mesh.faces)]
    return points * _collada_unit(path) if path.suffix.lower() == ".dae" else points


def _binary_stl_points(data: bytes) -> np.ndarray:
    """Corners (3 n, 3) of the n triangles of a binary STL file; none of another one. Bytes may follow."""
    count = int.from_bytes(data[80:84], "little")
    if not count or len(data) < 84 + 50 * count:
        return np.zeros((0, 3))
    triangles = np.frombuffer(
        data, np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")]), count, 84
    )
    return triangles["corners"].reshape(-1, 3).astype(float)


def _collada_unit(path: Path) -> float:
    """The unit of a COLLADA file, m."""
    head = path.read_text(errors="replace").partition("</asset>")[0]
    unit = re.search(r"<(?:\w+:)?unit\b[^>]*\bmeter\s*=\s*[\"']([^\"']*)[\"']", head)
    return float(unit.group(1)) if unit else 1.0
