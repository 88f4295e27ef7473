"""Libraries that are loaded when they are first used, not when they are imported.

Some libraries take long to load, and most processes use nothing of them: few robots have meshes that are not in the
cache. Others are imported by a library that we need, for parts that we do not use. A finder at the front of
``sys.meta_path`` answers the import of a name in :data:`DEFERRED` with a placeholder; the first access to what it does
not have imports the library, and from then on the placeholder passes every access on.

The standard library's ``importlib.util.LazyLoader`` does not do: ``import name`` already loads a module of it that is
in ``sys.modules``, and it is not safe with threads before Python 3.12.
"""

import sys
from collections.abc import Iterable
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any

DEFERRED = (
    "casadi",  # derives symbolic features
    "matplotlib",  # draws pictures
    "open3d",  # handles point clouds
    "scipy.sparse",  # scipy.spatial accepts its matrices
    "trimesh",  # reads meshes, whose hulls are kept
    # SciPy copies every public name of numpy; these load slowly
    "numpy.ctypeslib",
    "numpy.f2py",
    "numpy.ma",
    "numpy.testing",
)


class Placeholder(ModuleType):
    """Stands for a module that is imported at the first access to an attribute."""

    def __getattr__(self, name: str) -> Any:
        return getattr(_load(self), name)

    def __dir__(self) -> Iterable[str]:
        return dir(_load(self))


def _load(placeholder: Placeholder) -> ModuleType:
    """The module for which a placeholder stands. Python's own locks keep threads apart."""
    name = placeholder.__name__
    if sys.modules.get(name) is placeholder:
        del sys.modules[name]
    return import_module(name)


class _PlaceholderLoader(Loader):
    def create_module(self, spec: ModuleSpec) -> None:
        """An empty module, as usual."""

    def exec_module(self, module: ModuleType) -> None:
        """Makes the module a placeholder."""
        module.__class__ = Placeholder  # only now: the import system has looked for attributes before


class _KnownLoader(Loader):
    """Hands out a module that is known already."""

    def __init__(self, module: ModuleType):
        self._module, self._spec = module, module.__spec__

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """The known module."""
        return self._module

    def exec_module(self, module: ModuleType) -> None:
        """Undoes what the import has changed."""
        module.__spec__ = self._spec


class _Finder(MetaPathFinder):
    def __init__(self, names: Iterable[str]):
        self._waiting = set(names)

    def find_spec(self, fullname: str, path=None, target: ModuleType | None = None) -> ModuleSpec | None:
        """Makes a deferred module a placeholder at its first import; leaves all others to the other finders."""
        if fullname in self._waiting:
            self._waiting.remove(fullname)
            found = PathFinder.find_spec(fullname, path, target)
            return found and ModuleSpec(fullname, _PlaceholderLoader(), origin=found.origin)
        # Importing a.b asks the placeholder of a for its path, and so imports a, which may have imported a.b.
        known = sys.modules.get(fullname)
        return ModuleSpec(fullname, _KnownLoader(known)) if known is not None and target is None else None


def defer_imports(names: Iterable[str] = DEFERRED) -> None:
    """Defers modules that are imported from now on. A module that is not installed fails at its import, as ever.

    Args:
        names: of the modules; those that are imported already stay as they are.
    """
    sys.meta_path.insert(0, _Finder(names))
