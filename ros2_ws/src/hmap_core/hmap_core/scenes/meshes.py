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

MIN_FACES = 4  # of a surface with a volume
MIN_HULL_FILL = 0.95  # a mesh that fills less of its convex hull than this is concave
SAME_HULL = 1e-6  # in units of the file; hulls whose vertices differ by less are the same


def check_convex(path: Path, accept_hull: bool) -> None:
    """Raises InputError when the mesh is unreadable, or concave and ``accept_hull`` is not set."""
    _, fill = _read_hull(path)
    if fill < MIN_HULL_FILL and not accept_hull:
        raise InputError(
            f"the mesh is concave or open (it fills {100 * fill:.0f} % of its convex hull); list convex parts, as "
            f"'python -m hmap_core.scenes.decompose {path.name}' writes them, or set convex_hull: true",
            Code.INVALID_SCENE,
        )


def hull_vertices(path: Path) -> np.ndarray:
    """Vertices (V, 3) of the convex hull of a mesh file, unscaled."""
    return _read_hull(path)[0].copy()


def local(uri: str, vertices: np.ndarray | None) -> Path:
    """A file on this machine with the mesh that ``uri`` named on another, of whose hull ``vertices`` (V, 3) are known.

    Raises:
        InputError: when there is none and ``vertices`` is None.
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
    return first.shape == second.shape and bool(np.allclose(first, second, rtol=0.0, atol=SAME_HULL))


def _cached(vertices: np.ndarray) -> Path:
    """The hull of ``vertices`` as a file in the user's cache, named by its content."""
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "hmap" / "meshes"
    path = cache / f"{hashlib.sha256(np.round(vertices, 9).tobytes()).hexdigest()[:16]}.obj"
    if not path.is_file():
        import trimesh  # as in read_mesh

        hull = _convex_hull(trimesh.PointCloud(vertices), "the vertices of a mesh")
        try:
            cache.mkdir(parents=True, exist_ok=True)
            draft = path.with_suffix(f".{os.getpid()}.obj")
            hull.export(draft)
            draft.replace(path)  # at once: another process may want the same file
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error}") from error
    return path


def read_mesh(path: Path) -> "trimesh.Trimesh":
    """A mesh file as one surface.

    Raises:
        InputError: INVALID_SCENE when it is not a mesh, or has no extent.
    """
    import trimesh  # takes a second, and few scenes have meshes

    try:
        mesh = trimesh.load_mesh(path)
        faces, finite = len(mesh.faces), bool(np.isfinite(mesh.vertices).all())
    except Exception as error:  # the readers of the many formats raise errors of every kind
        raise InputError(f"{path}: not a mesh: {error}", Code.INVALID_SCENE) from error
    if faces < MIN_FACES or not finite:
        problem = f"{path}: not a mesh: it has {faces} triangles, at least {MIN_FACES} with finite vertices are needed"
        raise InputError(problem, Code.INVALID_SCENE)
    return mesh


def _read_hull(path: Path) -> tuple[np.ndarray, float]:
    """Vertices (V, 3) of the hull of a mesh, and the share of it that the mesh fills."""
    return _hull(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=64)
def _hull(path: Path, _changed: int) -> tuple[np.ndarray, float]:
    mesh = read_mesh(path)
    hull = _convex_hull(mesh, str(path))
    # the volume of an open surface means nothing; it counts as concave
    fill = float(mesh.volume / hull.volume) if mesh.is_watertight else 0.0
    return np.asarray(hull.vertices, float), fill


def _convex_hull(points: "trimesh.Trimesh | trimesh.PointCloud", name: str) -> "trimesh.Trimesh":
    try:
        return points.convex_hull
    except Exception as error:  # of the hull library, when the points are flat or too few
        raise InputError(f"{name}: its points span no volume: {error}", Code.INVALID_SCENE) from error
