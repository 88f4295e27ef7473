"""Locations of scene data: the packages ``hmap_scenes`` and ``pybullet_data``, and paths relative to a file."""

from functools import cache
from importlib.util import find_spec
from pathlib import Path

from hmap_core.exceptions import Code, InputError

SCHEMES = ("hmap_scenes", "pybullet_data")  # packages that a URI "<package>://<path>" may name


def package_path(package: str) -> Path:
    """Folder of an installed data package.

    Args:
        package: its import name.

    Raises:
        InputError: the package is not installed.
    """
    folder = _package_folder(package)
    if folder is None:
        raise InputError(f"the Python package {package!r}, which holds scene data, is not installed")
    return folder


@cache
def _package_folder(package: str) -> Path | None:
    """Folder of a package, which is searched for once; None if it is not installed."""
    spec = find_spec(package)
    return None if spec is None or not spec.submodule_search_locations else Path(spec.submodule_search_locations[0])


def resolve(uri: str, base: Path) -> Path:
    """Path of the file that a URI names.

    Args:
        uri: ``<package>://<path>``, or a path relative to ``base``.
        base: a folder.

    Returns:
        The path.

    Raises:
        InputError: INVALID_SCENE; the file does not exist, or the package is unknown.
    """
    scheme, separator, rest = uri.partition("://")
    if separator and scheme not in SCHEMES:
        allowed = " or ".join(f"{name}://" for name in SCHEMES)
        raise InputError(f"unknown scheme in {uri!r}; allowed: {allowed} or a path", Code.INVALID_SCENE)
    path = package_path(scheme) / rest if separator else base / Path(uri).expanduser()
    try:
        if path.is_file():
            return path
    except (OSError, ValueError):  # the name is too long or contains a null character: no such file
        pass
    raise InputError(f"file not found: {path}", Code.INVALID_SCENE)


def portable(path: Path) -> str:
    """URI of a file that is valid on other machines if the file is part of a known package; else its path."""
    for scheme in SCHEMES:
        folder = _package_folder(scheme)
        if folder is not None and path.is_relative_to(folder):
            return f"{scheme}://{path.relative_to(folder).as_posix()}"
    return str(path)
