"""Files that are read whole: a pipe or a device in place of one would be waited for, or never end."""

from pathlib import Path


def regular(path: Path | str) -> Path:
    """The path, unless something else than a regular file is there.

    Raises:
        OSError: it is a folder, a pipe or a device.
    """
    found = Path(path)
    if found.exists() and not found.is_file():
        raise OSError(None, "it is a folder, a pipe or a device, and no regular file")
    return found
