"""What is wrong with a robot description, or was assumed in reading it."""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path


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
