"""Shared memory of Fast DDS that processes leave behind where they are killed: 64 MiB for each, until a reboot."""

import fcntl
import re
import time
from pathlib import Path

FOLDER = Path("/dev/shm")
LOCK = re.compile(r"fastrtps_[0-9a-f]{16}_el")  # which the owner of a segment holds for as long as it lives
STARTING = 10.0  # s that a process may take between the making of the lock's file and the locking


def remove_dead_segments(folder: Path = FOLDER) -> int:
    """Remove the segments of processes that have ended; the same as ``fastdds shm clean``, but for the ports.

    Args:
        folder: with the segments.

    Returns:
        The number of bytes that are free again.
    """
    freed = 0
    for lock in folder.glob("fastrtps_*_el"):
        try:
            if not LOCK.fullmatch(lock.name) or time.time() - lock.stat().st_mtime < STARTING:
                continue
            with lock.open("ab") as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                segment = lock.with_name(lock.name.removesuffix("_el"))
                if segment.exists():
                    size = segment.stat().st_size
                    segment.unlink()
                    freed += size
                lock.unlink()
        except OSError:  # locked by its owner, of another user, or removed by somebody else
            continue
    return freed
