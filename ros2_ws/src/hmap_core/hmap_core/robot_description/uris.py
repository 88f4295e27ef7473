"""Finds the files that a robot description names."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from urllib.parse import unquote

REMEDIES = {
    "model": "Gazebo's model:// needs its model path; use package:// or a relative path",
    "http": "download the file, and name it by a path",
    "https": "download the file, and name it by a path",
}


def find_file(name: str, file: Path, packages: Sequence[Path] = ()) -> tuple[Path | None, str]:
    """Path of a file that a robot description names.

    ``package://NAME/REST`` is looked for in ``packages``, in the folders above the description, and in ROS' index
    (``AMENT_PREFIX_PATH``, ``ROS_PACKAGE_PATH``), in this order. As in PyBullet, a name without scheme is relative to
    the description's folder or one above it.

    Args:
        name: as the description has it.
        file: the description.
        packages: folders of packages, or folders that contain them.

    Returns:
        The path and ""; or None and the remedy.
    """
    scheme, separator, rest = name.partition("://")
    if not separator:
        scheme, rest = "", name
    if scheme not in ("", "file", "package"):
        return None, REMEDIES.get(scheme, "use package://, file:// or a path")
    folders = (file.parent, *file.parents)
    for each in dict.fromkeys((rest, unquote(rest), rest.replace("\\", "/"))):
        if scheme == "package":
            candidates = _in_packages(each, folders, packages)
        else:
            candidates = iter([Path(each)] if Path(each).is_absolute() else [folder / each for folder in folders])
        for candidate in candidates:
            if _is_file(candidate):
                return candidate, ""
    return None, _remedy(scheme, rest, file)


def _in_packages(rest: str, folders: Sequence[Path], packages: Sequence[Path]) -> Iterator[Path]:
    package, _, inside = rest.partition("/")
    for folder in packages:
        yield from [folder / rest] + ([folder / inside] if folder.name == package and inside else [])
    yield from (folder / rest for folder in folders)
    for prefix in _entries("AMENT_PREFIX_PATH"):
        yield prefix / "share" / rest
    for folder in _entries("ROS_PACKAGE_PATH"):
        yield from [folder / rest] + ([folder / inside] if folder.name == package and inside else [])
    if inside:  # the package's folder has another name here
        yield from (folder / inside for folder in folders)


def _entries(variable: str) -> list[Path]:
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # the name is too long or contains a null character
        return False


def _remedy(scheme: str, rest: str, file: Path) -> str:
    """What to do about a missing file; a name that differs only by upper and lower case is named."""
    for folder in (file.parent, *file.parents):
        try:
            here = (folder / rest).parent
            if (folder / rest).is_dir():
                return f"{folder / rest} is a folder"
            names = [entry.name for entry in here.iterdir()] if here.is_dir() else []
        except (OSError, ValueError):
            continue
        similar = [name for name in names if name.lower() == Path(rest).name.lower()]
        if similar:
            return f"there is '{similar[0]}' in {here}"
    if scheme == "package":
        package = rest.partition("/")[0]
        return f"put the package '{package}' above {file.name}, or its workspace into AMENT_PREFIX_PATH"
    return f"paths are relative to the folder of {file.name}, or to one above it"
