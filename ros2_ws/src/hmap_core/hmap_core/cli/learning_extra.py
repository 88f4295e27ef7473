"""The libraries that only learning needs, as an extra of the package."""

from importlib.util import find_spec

from hmap_core.exceptions import InputError

EXTRA = "pip install 'hmap_core[learning]' --extra-index-url https://download.pytorch.org/whl/cpu"


def needs(*libraries: str) -> None:
    """Ask for libraries.

    Raises:
        InputError: one is not installed; says how to install it.
    """
    missing = [name for name in libraries if find_spec(name) is None]
    if missing:
        raise InputError(f"this needs {', '.join(missing)}, which is not here: {EXTRA}")
