"""Says what is missing or damaged in a bag, and writes a sound copy."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hmap.bags.reader import Bag
from hmap.bags.runs import JOINTS, STATE, missing_topics, namespace_of
from hmap.bags.writer import BagWriter
from hmap_core.exceptions import InputError

GAP = 1.0  # s of the bag without a message of a topic that is measured all the time


@dataclass
class BagReport:
    """What a bag holds, and what is wrong with it.

    Attributes:
        path: of the bag.
        duration: s.
        counts: topic -> messages.
        damaged: what cannot be read.
        missing: topics that an evaluation needs, with what cannot be said without them.
        gaps: times without measurements.
    """

    path: str
    duration: float
    counts: dict[str, int]
    damaged: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    gaps: list[str] = field(default_factory=list)

    @property
    def sound(self) -> bool:
        """Whether nothing is missing or damaged."""
        return not (self.damaged or self.missing or self.gaps)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON types."""
        return vars(self) | {"sound": self.sound}


def check_bag(bag: Bag) -> BagReport:
    """Read a whole bag."""
    bag.messages()  # names what cannot be read
    damaged = list(bag.problems)
    space = namespace_of(list(bag.topics))
    last: dict[str, int] = {}
    gaps: dict[str, tuple[int, int]] = {}
    for topic, time, _ in bag.raw():
        if topic in (space + JOINTS, space + STATE):
            before = last.get(topic, time)
            if time - before > gaps.get(topic, (0, 0))[0]:
                gaps[topic] = time - before, before
            last[topic] = time
    begin = min((first for first, _ in bag.ends.values()), default=0.0)
    end = max((until for _, until in bag.ends.values()), default=0.0)
    long = [
        f"{topic}: nothing for {gap * 1e-9:.1f} s, {at * 1e-9 - begin:.1f} s after the begin"
        for topic, (gap, at) in gaps.items()
        if gap > GAP * 1e9
    ]
    return BagReport(str(bag.path), end - begin, dict(bag.counts), damaged, missing_topics(bag), long)


def repair(bag: Bag, path: Path) -> int:
    """Write what can be read of a bag into a new one, with an index.

    Returns:
        the number of its messages.

    Raises:
        InputError: there is something at the path already.
    """
    if path.exists():
        raise InputError(f"{path} exists already; the copy needs a new folder")
    writer, connections, last, count = BagWriter(path), {}, 0, 0
    for topic, time, data in bag.raw():
        if topic not in connections:
            connections[topic] = writer.add(topic, bag.topics[topic], bag.types)
        last = max(last, time)
        writer.write(connections[topic], last, data)
        count += 1
    writer.close()
    return count
