"""Goes through an MCAP file from its begin, without its index, as far as it is sound.

Source of the format: https://mcap.dev/spec, version 0.
"""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from zlib import crc32

from backports import zstd
from lz4.frame import decompress as lz4_decompress

MAGIC = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F  # opcodes
DECOMPRESS = {"": bytes, "lz4": lz4_decompress, "zstd": zstd.decompress}
LARGEST = 2**40  # bytes of a record; a larger length is damage


@dataclass
class Scan:
    """What was found in a file.

    Attributes:
        path: of the file.
        types: name of a message type -> its definition.
        topics: topic -> name of its message type.
        indexed: whether the file has its end, with the index.
        problems: what is damaged, in words.
    """

    path: Path
    types: dict[str, str] = field(default_factory=dict)
    topics: dict[str, str] = field(default_factory=dict)
    indexed: bool = False
    problems: list[str] = field(default_factory=list)
    _schemas: dict[int, str] = field(default_factory=dict)
    _channels: dict[int, str] = field(default_factory=dict)

    def messages(self) -> Iterator[tuple[str, int, bytes]]:
        """Topic, time (ns) and serialised message of each, in the order of the file, up to the first damage."""
        with self.path.open("rb") as file:
            size = self.path.stat().st_size
            if not size:
                self.problems.append("it is empty: the recorder was killed as it began the file, or has just begun it")
                return
            if file.read(len(MAGIC)) != MAGIC:
                self.problems.append("it does not begin as an MCAP file")
                return
            while True:
                at = file.tell()
                head = file.read(9)
                if len(head) < 9:
                    self._ends(at, size)
                    return
                length = struct.unpack_from("<Q", head, 1)[0]
                if head[0] == 0 or length > LARGEST or at + 9 + length > size:
                    self._ends(at, size)
                    return
                body = file.read(length)
                if head[0] == FOOTER:
                    self.indexed = file.read(len(MAGIC)) == MAGIC
                    if not self.indexed:
                        self.problems.append("its end is cut off")
                    return
                try:
                    yield from self._record(head[0], body)
                except (struct.error, ValueError, IndexError, KeyError, RuntimeError, zstd.ZstdError) as error:
                    self.problems.append(f"damaged at byte {at}: {error}")

    def _ends(self, at: int, size: int) -> None:
        cut = f"; the last {size - at} bytes are part of a record that is cut off" if size > at else ""
        self.problems.append(f"it has no end and no index: the recorder was killed, or still writes{cut}")

    def _record(self, code: int, body: bytes) -> Iterator[tuple[str, int, bytes]]:
        if code == CHUNK:
            yield from self._chunk(body)
        elif code == MESSAGE:
            channel, _, time, _ = struct.unpack_from("<HIQQ", body)
            yield self._channels[channel], time, body[22:]
        elif code == SCHEMA:
            (number,) = struct.unpack_from("<H", body)
            name, at = _string(body, 2)
            _, at = _string(body, at)
            text, _ = _string(body, at)
            self._schemas[number] = name
            self.types[name] = text
        elif code == CHANNEL:
            number, schema = struct.unpack_from("<HH", body)
            topic, _ = _string(body, 4)
            self._channels[number] = topic
            self.topics[topic] = self._schemas[schema]

    def _chunk(self, body: bytes) -> Iterator[tuple[str, int, bytes]]:
        size, crc = struct.unpack_from("<QI", body, 16)
        compression, at = _string(body, 28)
        (length,) = struct.unpack_from("<Q", body, at)
        records = DECOMPRESS[compression](body[at + 8 : at + 8 + length])
        if len(records) != size or (crc and crc32(records) != crc):
            raise ValueError("the checksum of a chunk is wrong")
        place = 0
        while place + 9 <= len(records):
            length = struct.unpack_from("<Q", records, place + 1)[0]
            if records[place] == 0 or place + 9 + length > len(records):
                raise ValueError("a record of a chunk is damaged")
            yield from self._record(records[place], records[place + 9 : place + 9 + length])
            place += 9 + length


def _string(body: bytes, at: int) -> tuple[str, int]:
    """A text at a place, and the place after it."""
    (length,) = struct.unpack_from("<I", body, at)
    return body[at + 4 : at + 4 + length].decode(), at + 4 + length
