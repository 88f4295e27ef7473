"""Mesh files as convex shapes."""

from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh

from hmap_core.exceptions import Code, InputError

MIN_HULL_FILL = 0.95  # a mesh that fills less of its convex hull than this is concave


def check_convex(path: Path, accept_hull: bool) -> None:
    """Raises InputError when the mesh is unreadable, or concave and ``accept_hull`` is not set."""
    vertices, fill = _hull(path)
    if fill < MIN_HULL_FILL and not accept_hull:
        raise InputError(
            f"the mesh is concave (it fills {100 * fill:.0f} % of its convex hull); list convex parts, as "
            f"'python -m hmap_core.scenes.decompose {path.name}' writes them, or set convex_hull: true",
            Code.INVALID_SCENE,
        )


def hull_vertices(path: Path) -> np.ndarray:
    """Vertices (V, 3) of the convex hull of a mesh file, unscaled."""
    return _hull(path)[0].copy()


@lru_cache(maxsize=64)
def _hull(path: Path) -> tuple[np.ndarray, float]:
    try:
        mesh = trimesh.load_mesh(path)
        hull = mesh.convex_hull
        # the volume of an open surface means nothing; its hull is all there is to go by
        fill = float(mesh.volume / hull.volume) if mesh.is_watertight else 0.0
        return np.asarray(hull.vertices, float), fill
    except Exception as error:  # the readers of the many formats raise errors of every kind
        raise InputError(f"{path}: not a mesh: {error}", Code.INVALID_SCENE) from error
