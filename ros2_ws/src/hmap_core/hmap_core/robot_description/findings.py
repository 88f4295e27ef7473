"""What is wrong with a robot description, or was assumed in reading it."""

from collections.abc import Collection
from dataclasses import dataclass
from enum import StrEnum
from itertools import islice
from pathlib import Path

MOST_NAMED = 20  # names that a finding lists


class Severity(StrEnum):
    """How serious a finding is."""

    ERROR = "error"  # the description is refused
    WARNING = "warning"  # the description is used; the text says what is assumed


@dataclass(frozen=True)
class Finding:
    """One finding.

    Attributes:
        severity: error or warning.
        file: the file that it is about.
        element: the element of the file, such as ``joint 'elbow', <axis>``; empty if it is the whole file.
        text: what is wrong, with the value, or what is assumed.
        remedy: what to change.
        line: line number in the file, from 1; 0 if it is not known.
    """

    severity: Severity
    file: Path
    element: str
    text: str
    remedy: str = ""
    line: int = 0

    def __str__(self) -> str:
        where = f"{self.file}:{self.line}" if self.line else str(self.file)
        element = f"{self.element}: " if self.element else ""
        remedy = f"; {self.remedy}" if self.remedy else ""
        return f"{where}: {element}{self.text}{remedy}"


def listed(names: Collection[str]) -> str:
    """Names in a row, for a finding; of many the first MOST_NAMED, and how many there are beside them."""
    more = len(names) - MOST_NAMED
    return ", ".join(islice(names, MOST_NAMED)) + (f" and {more} more" if more > 0 else "")
