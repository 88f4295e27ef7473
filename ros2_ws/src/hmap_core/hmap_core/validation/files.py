"""Files that a plan names by URI, and the points of a mesh."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np

from hmap_core.exceptions import Code, InputError

PACKAGES = ("pybullet_data", "hmap_scenes")  # data packages that a URI may name; they are not imported


def unusable(reason: str) -> InputError:
    """The error for a plan file that cannot be judged."""
    return InputError(reason, Code.INVALID_PLAN_FILE)


def _root(scheme: str, uri: str) -> Path:
    if scheme not in PACKAGES:
        allowed = ", ".join(PACKAGES)
        raise unusable(f"{uri!r}: unknown scheme {scheme!r}; allowed are {allowed}, file, or a plain path")
    spec = find_spec(scheme)
    if spec is None or not spec.submodule_search_locations:
        raise unusable(f"{uri!r}: the Python package {scheme!r} is not installed")
    return Path(next(iter(spec.submodule_search_locations)))


def locate(uri: str) -> Path:
    """The file on this machine that a URI means.

    ``pybullet_data://`` and ``hmap_scenes://`` are relative to those packages; ``file://`` or nothing is a plain path.

    Raises:
        InputError: the scheme is unknown or there is no such file.
    """
    scheme, separator, rest = uri.partition("://")
    if not separator:
        path = Path(uri)
    elif scheme == "file":
        path = Path(rest)
    else:
        path = _root(scheme, uri) / rest
    if not path.is_file():
        raise unusable(f"{uri!r}: no such file ({path})")
    return path


def mesh_points(path: Path) -> np.ndarray:
    """Vertices (V, 3) of a mesh file, in its own units.

    Raises:
        InputError: the file cannot be read or holds fewer than four points.
    """
    try:
        points = _obj_points(path) if path.suffix.lower() == ".obj" else _other_points(path)
    except Exception as error:
        raise unusable(f"mesh {path}: {error}") from error
    if len(points) < 4:
        raise unusable(f"mesh {path}: {len(points)} points; a solid needs at least 4")
    return points


def _obj_points(path: Path) -> np.ndarray:
    lines = path.read_text(errors="replace").splitlines()
    return np.array([line.split()[1:4] for line in lines if line.startswith("v ")], float).reshape(-1, 3)


def _other_points(path: Path) -> np.ndarray:
    import trimesh  # slow to import, and OBJ files do without it

    return np.asarray(trimesh.load(path, force="mesh").vertices, float)
