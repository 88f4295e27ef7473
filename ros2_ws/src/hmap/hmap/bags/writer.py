"""Writes MCAP bags of which a kill costs at most what came since the last flush, in one file or several."""

from pathlib import Path
from typing import Any, Literal

from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.typesys.store import Typestore
from ruamel.yaml import YAML

BAG_VERSION: Literal[9] = 9  # version of the metadata, as in rosbag2 of Jazzy
METADATA = "metadata.yaml"
INFORMATION = "rosbag2_bagfile_information"


class BagWriter:
    """Writes one bag.

    A chunk of MCAP is on the disk once it is closed, and a reader that goes through the file from its begin finds it
    without the index, which only :meth:`close` writes. So :meth:`flush` closes the chunk that is being filled.

    Attributes:
        path: folder of the bag.
        files: how many files it has so far.
    """

    def __init__(self, path: Path, compress: bool = False, split_size: int = 0, split_duration: float = 0.0):
        """
        Args:
            path: folder of the bag, which must not exist yet.
            compress: by zstd, chunk by chunk.
            split_size: bytes after which another file is begun; 0: never.
            split_duration: s of the bag's time after which another file is begun; 0: never.

        Raises:
            OSError: it cannot be written.
        """
        self.path, self._split_size, self._split_duration = path, split_size, split_duration
        self._writer = Writer(path, version=BAG_VERSION, storage_plugin=StoragePlugin.MCAP)
        self._compression = CompressionMode.STORAGE if compress else CompressionMode.NONE
        self._writer.set_compression(self._compression, CompressionFormat.ZSTD)
        self._writer.open()
        self._open = True
        self._ended: list[dict[str, Any]] = []  # the files before the present one
        self._count, self._bytes, self._begin, self._end = 0, 0, 0, 0  # of the present file

    @property
    def files(self) -> int:
        """How many files it has so far."""
        return len(self._ended) + self._open

    def add(self, topic: str, kind: str, types: Typestore) -> Connection:
        """Add a topic with messages of a type."""
        return self._writer.add_connection(topic, kind, typestore=types)

    def write(self, connection: Connection, time: int, data: bytes) -> None:
        """Write a serialised message at a time (ns), which does not go back."""
        long = self._split_duration and self._count and time - self._begin > self._split_duration * 1e9
        if long or (self._split_size and self._bytes > self._split_size):
            self._split()
        self._writer.write(connection, time, data)
        self._begin = self._begin if self._count else time
        self._count, self._end, self._bytes = self._count + 1, time, self._bytes + len(data)

    def flush(self) -> None:
        """Bring to the disk what was written so far."""
        storage = self._storage()
        if storage.chunk.msgs:
            storage.close_chunk()
        storage.bio.flush()

    def close(self) -> None:
        """End the bag, with its index and its metadata."""
        self._writer.close()
        if not self._ended:
            return
        self._end_file()
        self._open = False
        yaml, path = YAML(typ="safe"), self.path / METADATA
        yaml.default_flow_style = False
        metadata = yaml.load(path)
        information = metadata[INFORMATION]
        information["files"] = self._ended
        information["relative_file_paths"] = [entry["path"] for entry in self._ended]
        with path.open("w") as file:
            yaml.dump(metadata, file)

    def _storage(self) -> McapWriter:
        storage = self._writer.storage
        if not isinstance(storage, McapWriter):
            raise TypeError("the bag is not open")
        return storage

    def _split(self) -> None:
        """End the file, and begin another one with the same topics."""
        self._storage().close(BAG_VERSION, "")
        self._end_file()
        storage = McapWriter(self.path, self._compression)
        self._writer.storage = storage
        kinds = set[str]()
        for connection in self._writer.connections:
            if connection.msgtype not in kinds:
                storage.add_msgtype(connection)
            kinds.add(connection.msgtype)
            storage.add_connection(connection, "")
        self._count = self._bytes = 0

    def _end_file(self) -> None:
        """Give the file that has been closed its number."""
        name = f"{self.path.name}_{len(self._ended)}.mcap"
        (self.path / f"{self.path.name}.mcap").rename(self.path / name)
        self._ended.append(
            {
                "path": name,
                "starting_time": {"nanoseconds_since_epoch": self._begin},
                "duration": {"nanoseconds": max(0, self._end - self._begin)},
                "message_count": self._count,
            }
        )
