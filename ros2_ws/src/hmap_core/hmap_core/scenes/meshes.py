"""Mesh files as convex shapes."""

import hashlib
import os
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hmap_core.exceptions import Code, InputError
from hmap_core.scenes import resources

if TYPE_CHECKING:
    import trimesh

MIN_FACES = 4  # faces of a surface that encloses a volume
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
    _, fill = _read_hull(path)
    if fill < MIN_HULL_FILL and not accept_hull:
        raise InputError(
            f"the mesh is concave or open (it fills {100 * fill:.0f} % of its convex hull); list convex parts, as "
            f"'python -m hmap_core.scenes.decompose {path.name}' writes them, or set convex_hull: true",
            Code.INVALID_SCENE,
        )


def hull_vertices(path: Path) -> np.ndarray:
    """Vertices (V, 3) of the convex hull of a mesh file, in units of the file.

    Raises:
        InputError: INVALID_SCENE; the mesh cannot be read or spans no volume.
    """
    return _read_hull(path)[0].copy()


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


def _cached(vertices: np.ndarray) -> Path:
    """Writes the hull of ``vertices`` to a file in the user's cache, named by its content."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hmap" / "meshes"
    path = cache / f"{hashlib.sha256(np.round(vertices, 9).tobytes()).hexdigest()[:16]}.obj"
    if not path.is_file():
        import trimesh  # slow to import, as in read_mesh

        hull = _convex_hull(trimesh.PointCloud(vertices), "the vertices of a mesh")
        try:
            cache.mkdir(parents=True, exist_ok=True)
            temporary = path.with_suffix(f".{os.getpid()}.obj")
            hull.export(temporary)
            temporary.replace(path)  # atomic, since another process may write the same file
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error}") from error
    return path


def read_mesh(path: Path) -> "trimesh.Trimesh":
    """Reads a mesh file as one surface.

    Args:
        path: the file, of any format that trimesh reads.

    Returns:
        The surface.

    Raises:
        InputError: INVALID_SCENE; the file is no mesh, or has too few faces.
    """
    import trimesh  # takes a second to import, and few scenes have meshes

    try:
        mesh = trimesh.load_mesh(path)
        faces, finite = len(mesh.faces), bool(np.isfinite(mesh.vertices).all())
    except Exception as error:  # the readers of the various formats raise exceptions of any type
        raise InputError(f"{path}: not a mesh: {error}", Code.INVALID_SCENE) from error
    if faces < MIN_FACES or not finite:
        problem = f"{path}: not a mesh: it has {faces} triangles, at least {MIN_FACES} with finite vertices are needed"
        raise InputError(problem, Code.INVALID_SCENE)
    return mesh


def _read_hull(path: Path) -> tuple[np.ndarray, float]:
    """Vertices (V, 3) of the hull of a mesh, and the volume of the mesh relative to its hull."""
    return _hull(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=64)
def _hull(path: Path, _changed: int) -> tuple[np.ndarray, float]:
    mesh = read_mesh(path)
    hull = _convex_hull(mesh, str(path))
    # the volume of an open surface is undefined; it counts as concave
    fill = float(mesh.volume / hull.volume) if mesh.is_watertight else 0.0
    return np.asarray(hull.vertices, float), fill


def _convex_hull(points: "trimesh.Trimesh | trimesh.PointCloud", name: str) -> "trimesh.Trimesh":
    try:
        return points.convex_hull
    except Exception as error:  # raised by the hull library if the points are coplanar or too few
        raise InputError(f"{name}: its points span no volume: {error}", Code.INVALID_SCENE) from error
