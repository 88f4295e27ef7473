"""Mesh files as convex shapes."""

import hashlib
import logging
import os
from pathlib import Path

import numpy as np
import trimesh

from hmap_core.exceptions import Code, InputError
from hmap_core.mesh_files import read_hull
from hmap_core.scenes import resources

LOGGER = logging.getLogger(__name__)
MIN_HULL_FILL = 0.95  # volume of a mesh relative to its convex hull below which it counts as concave
HULL_TOLERANCE = 1e-6  # in units of the file; hulls whose vertices differ by less are equal


def check_convex(path: Path, accept_hull: bool) -> None:
    """Checks that a mesh can be used as a convex shape.

    Args:
        path: the mesh file.
        accept_hull: accept concave meshes, for which the convex hull is used.

    Raises:
        InputError: INVALID_SCENE; the mesh cannot be read, or is concave or open and ``accept_hull`` is not set.
    """
    hull = read_hull(path)
    if hull.fill < MIN_HULL_FILL and not accept_hull:
        raise InputError(
            f"the mesh is concave or open (it fills {100 * hull.fill:.0f} % of its convex hull); set decompose: true, "
            f"list convex parts, as 'python -m hmap_core.scenes.decompose {path.name}' writes them, or set "
            "convex_hull: true",
            Code.INVALID_SCENE,
        )
    _note(path, hull.notes)


def hull_vertices(path: Path) -> np.ndarray:
    """Vertices (V, 3) of the convex hull of a mesh file, in units of the file.

    Raises:
        InputError: INVALID_SCENE; the mesh cannot be read or spans no volume.
    """
    return read_hull(path).vertices.copy()


def local_file(uri: str, vertices: np.ndarray | None) -> Path:
    """Path on this machine of a mesh that a scene from another machine names.

    If the named file is missing or has another hull, a file with the hull is written to the user's cache.

    Args:
        uri: of the mesh.
        vertices: (V, 3) of its convex hull, if known.

    Returns:
        The path.

    Raises:
        InputError: the file is missing and ``vertices`` is None, or the cache cannot be written.
    """
    try:
        path = resources.resolve(uri, Path())
        if vertices is None or _same(hull_vertices(path), vertices):
            return path
    except InputError:
        if vertices is None:
            raise
    return _cached(vertices)


def _same(first: np.ndarray, second: np.ndarray) -> bool:
    return first.shape == second.shape and bool(np.allclose(first, second, rtol=0.0, atol=HULL_TOLERANCE))


def cache_folder() -> Path:
    """The folder of the user's cache for meshes."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hmap" / "meshes"


def _cached(vertices: np.ndarray) -> Path:
    """Writes the hull of ``vertices`` to a file in the user's cache, named by its content."""
    cache = cache_folder()
    path = cache / f"{hashlib.sha256(np.round(vertices, 9).tobytes()).hexdigest()[:16]}.obj"
    if not path.is_file():
        try:
            hull = trimesh.PointCloud(vertices).convex_hull
        except Exception as error:  # raised by the hull library if the points are coplanar or too few
            raise InputError(f"the vertices of a mesh span no volume: {error}", Code.INVALID_SCENE) from error
        try:
            cache.mkdir(parents=True, exist_ok=True)
            temporary = path.with_suffix(f".{os.getpid()}.obj")
            hull.export(temporary)
            temporary.replace(path)  # atomic, since another process may write the same file
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error}") from error
    return path


def _note(path: Path, notes: tuple[str, ...]) -> None:
    """Logs what was assumed in reading a mesh, once for each file."""
    if path not in _NOTED:
        _NOTED.add(path)
        for note in notes:
            LOGGER.warning("mesh '%s' %s", path, note)


_NOTED: set[Path] = set()
