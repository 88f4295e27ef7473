"""Where Numba finds compiled code of this package; Numba imports this module, see :mod:`hmap_core.compile_cache`."""

from pathlib import Path
from types import FunctionType
from typing import Self

from numba.core.caching import _CacheLocator

from hmap_core.compile_cache import cache_root, is_own, module_hash


class ContentLocator(_CacheLocator):
    """A folder for each content of a module and of what it imports."""

    def __init__(self, function: FunctionType, file: Path):
        self._line = function.__code__.co_firstlineno
        self._hash = module_hash(file)

    @classmethod
    def from_function(cls, py_func: FunctionType, py_file: str) -> Self | None:
        """The locator of a function; None for one of another package, or if the folder cannot be written."""
        file = Path(py_file).absolute()
        if not is_own(file):
            return None
        locator = cls(py_func, file)
        try:
            locator.ensure_cache_path()
        except OSError:
            return None
        return locator

    def get_cache_path(self) -> str:
        """The folder."""
        return str(cache_root() / self._hash)

    def get_source_stamp(self) -> str:
        """What the code was compiled from."""
        return self._hash

    def get_disambiguator(self) -> str:
        """Distinguishes functions of the same name."""
        return str(self._line)
