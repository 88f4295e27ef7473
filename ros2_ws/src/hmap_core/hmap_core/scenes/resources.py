"""Where scene data is: the hmap_scenes package, pybullet_data, or beside the file that names it."""

from importlib.util import find_spec
from pathlib import Path

from hmap_core.exceptions import Code, InputError

SCHEMES = ("hmap_scenes", "pybullet_data")  # importable packages that a URI "<package>://<path>" may name


def package_path(package: str) -> Path:
    """Folder of an installed data package.

    Raises:
        InputError: when it is not installed.
    """
    spec = find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise InputError(f"the Python package {package!r}, which holds scene data, is not installed")
    return Path(next(iter(spec.submodule_search_locations)))


def resolve(uri: str, base: Path) -> Path:
    """The file that ``uri`` names: ``<package>://<path>``, or a path relative to the folder ``base``.

    Raises:
        InputError: INVALID_SCENE when there is no such file, or the package is unknown.
    """
    scheme, separator, rest = uri.partition("://")
    if separator and scheme not in SCHEMES:
        allowed = " or ".join(f"{name}://" for name in SCHEMES)
        raise InputError(f"unknown scheme in {uri!r}; allowed: {allowed} or a path", Code.INVALID_SCENE)
    path = package_path(scheme) / rest if separator else base / Path(uri).expanduser()
    try:
        if path.is_file():
            return path
    except (OSError, ValueError):  # a name that is too long, or with a null character: no such file
        pass
    raise InputError(f"file not found: {path}", Code.INVALID_SCENE)


def portable(path: Path) -> str:
    """``path`` as a URI that means the same on another machine, where it lies in a known package."""
    for scheme in SCHEMES:
        if find_spec(scheme) is not None and path.is_relative_to(package_path(scheme)):
            return f"{scheme}://{path.relative_to(package_path(scheme)).as_posix()}"
    return str(path)
