"""Reads bags, sound or damaged, with the definitions of the messages that are in them."""

import contextlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.rosbag2 import ReaderError
from rosbags.serde.errors import SerdeError
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.base import TypesysError
from rosbags.typesys.store import Typestore

from hmap.bags.scan import Scan
from hmap.bags.writer import METADATA
from hmap_core.exceptions import InputError
from hmap_msgs_py.definitions import typestore

TRAILING = 16  # bytes behind a message at most
OTHER_STORAGE = ".db3"  # suffix of bags that rosbags alone reads


@dataclass
class Message:
    """A message of a bag.

    Attributes:
        topic: of it.
        time: s, of the bag.
        data: with the fields of its type.
    """

    topic: str
    time: float
    data: Any


@dataclass
class Bag:
    """A bag.

    Attributes:
        path: folder or file.
        files: in order.
        problems: what is damaged; known after the bag was read.
        topics: topic -> message type.
        counts: topic -> messages.
        ends: topic -> times (s) of the first and the last message.
    """

    path: Path
    files: list[Path] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    topics: dict[str, str] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    ends: dict[str, tuple[float, float]] = field(default_factory=dict)

    def raw(self) -> Iterator[tuple[str, int, bytes]]:
        """Topic, time (ns) and serialised message of each, up to the first damage of each file."""
        self.problems, self.topics = [], {}
        self.counts, self.ends = Counter(), {}
        if not (self.path / METADATA).is_file() and self.path.is_dir():
            self.problems.append(f"{METADATA} is missing: the recorder did not come to its end")
        source = self._others() if self.files[0].suffix == OTHER_STORAGE else self._scans()
        for topic, time, data in source:
            self.counts[topic] += 1
            first, _ = self.ends.get(topic, (time * 1e-9, 0.0))
            self.ends[topic] = first, time * 1e-9
            yield topic, time, data

    def messages(self, topics: Sequence[str] | None = None) -> list[Message]:
        """The messages of some topics, or of all, by time; those that cannot be read are named in ``problems``."""
        found, bad = [], Counter[str]()
        for topic, time, data in self.raw():
            if topics is not None and topic not in topics:
                continue
            try:
                found.append(Message(topic, time * 1e-9, self._read(data, self.topics[topic])))
            except Exception:  # rosbags raises whatever its generated code meets
                bad[topic] += 1
        self.problems += [f"{count} messages of {topic} cannot be read" for topic, count in bad.items()]
        return sorted(found, key=lambda message: message.time)

    def _read(self, data: bytes, kind: str) -> Any:
        """A message; without what some serialisers leave behind it."""
        for cut in range(0, TRAILING + 4, 4):
            with contextlib.suppress(SerdeError):
                return self.types.deserialize_cdr(data[: len(data) - cut], kind)
        return self.types.deserialize_cdr(data, kind)

    @cached_property
    def types(self) -> Typestore:
        """The definitions: those of the bag where hmap and ROS know none."""
        return typestore()

    def _scans(self) -> Iterator[tuple[str, int, bytes]]:
        for file in self.files:
            scan = Scan(file)
            for topic, time, data in scan.messages():
                if topic not in self.topics:
                    self._learn(topic, scan)
                yield topic, time, data
            self.topics = scan.topics | self.topics
            self.problems += [f"{file.name}: {problem}" for problem in scan.problems]

    def _learn(self, topic: str, scan: Scan) -> None:
        kind = self.topics[topic] = scan.topics[topic]
        if kind not in self.types.fielddefs:
            try:
                new = get_types_from_msg(scan.types[kind], kind)
                self.types.register({name: one for name, one in new.items() if name not in self.types.fielddefs})
            except TypesysError as error:
                self.problems.append(f"the definition of {kind} cannot be read: {error}")

    def _others(self) -> Iterator[tuple[str, int, bytes]]:
        try:
            with AnyReader([self.path], default_typestore=self.types) as reader:
                for connection, time, data in reader.messages():
                    self.topics[connection.topic] = connection.msgtype
                    yield connection.topic, time, bytes(data)
        except (AnyReaderError, ReaderError) as error:
            self.problems.append(str(error))


def open_bag(path: Path) -> Bag:
    """A bag: a folder with MCAP files, or one such file.

    Raises:
        InputError: there is none at the path.
    """
    if path.is_file() and path.suffix == ".mcap":
        return Bag(path, [path])
    if not path.exists():
        raise InputError(f"{path}: there is no such bag")
    files = _in_order(list(path.glob("*.mcap"))) or sorted(path.glob(f"*{OTHER_STORAGE}"))
    if not path.is_dir() or not files:
        nested = [folder for folder in (path.iterdir() if path.is_dir() else ()) if any(folder.glob("*.mcap"))]
        suggestion = f"; did you mean {nested[0]}?" if nested else ""
        raise InputError(f"{path}: is no bag: a folder with an .mcap file, or such a file, is needed{suggestion}")
    return Bag(path, files)


def _in_order(files: Sequence[Path]) -> list[Path]:
    """The files of a bag: by their numbers, and at last the one that has none yet, from whose name others are made."""

    def place(file: Path) -> tuple[bool, int, str]:
        number = file.stem.rpartition("_")[2]
        unfinished = any(other.stem.startswith(f"{file.stem}_") for other in files)
        return unfinished, int(number) if number.isdigit() else 0, file.name

    return sorted(files, key=place)
