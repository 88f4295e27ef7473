"""The convex parts of a concave mesh, decomposed once and kept in the user's cache."""

import hashlib
import logging
import os
import shutil
import tempfile
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path

from hmap_core.exceptions import InputError
from hmap_core.mesh_files import read_hull
from hmap_core.scenes.meshes import MIN_HULL_FILL, cache_folder

LOGGER = logging.getLogger(__name__)


def convex_parts(path: Path) -> tuple[Path, ...]:
    """Files with the convex parts of a mesh; the mesh itself if it is convex.

    If the parts are not in the user's cache, the mesh is decomposed and they are put there, under the hash of its
    content. That takes seconds to minutes; a warning says so.

    Args:
        path: the mesh file.

    Raises:
        InputError: INVALID_SCENE; the mesh cannot be read or decomposed, or the cache cannot be written.
    """
    if read_hull(path).fill >= MIN_HULL_FILL:
        return (path,)
    return _kept(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=1024)
def _kept(path: Path, _changed: int) -> tuple[Path, ...]:
    from hmap_core.scenes import decompose  # its libraries take long to import, and are needed once for each mesh

    method = f"{decompose.CONCAVITY} {decompose.SEED} {decompose.FINE} {decompose.COARSE} {version('coacd')}"
    content = f"{method} {path.suffix.lower()} ".encode() + path.read_bytes()
    folder = cache_folder() / f"{hashlib.sha256(content).hexdigest()[:16]}_parts"
    if not folder.is_dir():
        LOGGER.warning("mesh '%s' is split into convex parts, once; they are kept in %s", path, folder)
        try:
            folder.parent.mkdir(parents=True, exist_ok=True)
            draft = Path(tempfile.mkdtemp(dir=folder.parent))
        except OSError as error:
            raise InputError(f"{folder}: cannot be written: {error}") from error
        try:
            decompose.decompose(path, folder=draft)
            os.replace(draft, folder)  # at once: another process never sees half of it
        except OSError as error:
            if not folder.is_dir():  # another process was not faster either
                raise InputError(f"{folder}: cannot be written: {error}") from error
        finally:
            shutil.rmtree(draft, ignore_errors=True)
    return tuple(sorted(folder.glob("*.obj"), key=_number))


def _number(part: Path) -> int:
    return int(part.stem.rpartition("part")[2])
