"""The environment of a process that uses ROS, so that users need not source anything.

On a native ROS installation only the defaults below are added. The ROS wheels of PyPI have their shared libraries in
the virtual environment, in ``lib`` and ``site-packages/ros_*.libs``; the loader needs these directories at the start
of the process. The wheels achieve this by starting the interpreter a second time, marked by the variable ``GUARD``.
Child processes inherit this mark: a process from *another* virtual environment would keep the first one's
directories. Both functions here check the directories themselves, so the result does not depend on the parent process,
with at most one restart.
"""

import os
import sys
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

GUARD = "_ROS_WHEELS_BOOTSTRAP_COMPLETE"  # set by the wheels' bootstrapper after its restart
LIBRARIES = "LD_LIBRARY_PATH"
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
DISCOVERY = "ROS_AUTOMATIC_DISCOVERY_RANGE"
LAUNCHER = "HMAP_LAUNCHER"  # number of the process that started this one, and ends it
PACKAGE = "hmap"


def ros_environment(base: Mapping[str, str] | None = None) -> dict[str, str]:
    """The environment for a process that runs nodes: ``base`` and what it lacks.

    Values that the user has set do not change: the discovery range (default LOCALHOST) and the Fast DDS profile
    (default ``params/fastdds.xml``, with a shared-memory segment large enough for clouds and images).

    Args:
        base: the environment to start from; default: that of this process.
    """
    environment = dict(os.environ if base is None else base)
    environment.setdefault(DISCOVERY, "LOCALHOST")
    environment.setdefault(PROFILES, str(share_path("params/fastdds.xml")))
    libraries = _library_paths()
    if libraries:
        given = [path for path in environment.get(LIBRARIES, "").split(os.pathsep) if path and path not in libraries]
        environment.setdefault("AMENT_PREFIX_PATH", sys.prefix)
        environment[LIBRARIES] = os.pathsep.join(libraries + given)
        environment[GUARD] = "1"
    return environment


def prepare_process() -> None:
    """Apply :func:`ros_environment` to this process; call it before the import of any ROS module.

    Restarts the interpreter with the same arguments if the loader does not know the libraries yet.
    """
    known = os.environ.get(LIBRARIES, "").split(os.pathsep)
    restart = any(path not in known for path in _library_paths())
    os.environ.update(ros_environment())
    if restart:
        sys.stdout.flush()
        sys.stderr.flush()
        os.execv(sys.executable, [sys.executable, *sys.orig_argv[1:]])


def share_path(relative: str) -> Path:
    """The path of a data file of this package, such as ``params/fastdds.xml``.

    Raises:
        FileNotFoundError: the file does not exist; the message lists all directories that were searched.
    """
    places = [Path(__file__).resolve().parents[1], Path(sys.prefix) / "share" / PACKAGE]
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    places += [Path(prefix) / "share" / PACKAGE for prefix in prefixes if prefix]
    for place in places:
        if (place / relative).exists():
            return place / relative
    raise FileNotFoundError(f"{relative} of package {PACKAGE} is in none of {', '.join(map(str, places))}")


def _library_paths() -> list[str]:
    """The directories of the ROS wheels' shared libraries; none on a native installation."""
    bootstrapper = find_spec("ros_wheels_bootstrapper")
    if bootstrapper is None or bootstrapper.origin is None:
        return []
    site_packages = Path(bootstrapper.origin).parents[1]
    return [str(Path(sys.prefix) / "lib"), *sorted(str(path.resolve()) for path in site_packages.glob("ros_*.libs"))]
