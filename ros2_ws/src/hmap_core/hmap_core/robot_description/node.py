"""Elements of a URDF with their place in it: reads attributes and child elements, and records what is wrong."""

import re
from collections.abc import Sequence
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from hmap_core.robot_description.findings import Finding, Severity

NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?|[+-]?inf(inity)?|nan", re.IGNORECASE | re.ASCII)
LARGEST = 1e6  # m, kg, rad: larger numbers are refused, since they are hardly meant and overflow in products
LINE = "\x00line"  # key of the line number among an element's attributes; no XML attribute can have this name


class Node:
    """An element of a robot description.

    Args:
        element: the element.
        where: the element in words, such as ``link 'hand', collision 2``.
        file: the file.
        findings: list to which findings are added.
    """

    def __init__(self, element: Element, where: str, file: Path, findings: list[Finding]):
        self.element = element
        self.where = where
        self.file = file
        self._findings = findings

    @property
    def tag(self) -> str:
        """Name of the element."""
        return self.element.tag

    def at(self, where: str) -> "Node":
        """The same element under another name."""
        return Node(self.element, where, self.file, self._findings)

    def error(self, text: str, remedy: str = "") -> None:
        """Records an error."""
        self._add(Severity.ERROR, text, remedy)

    def warn(self, text: str, remedy: str = "") -> None:
        """Records a warning."""
        self._add(Severity.WARNING, text, remedy)

    def _add(self, severity: Severity, text: str, remedy: str) -> None:
        line = int(self.element.get(LINE, 0))
        self._findings.append(Finding(severity, self.file, self.where, text, remedy, line))

    def children(self, tag: str | None = None) -> list["Node"]:
        """The child elements with a tag, or all."""
        found = list(self.element) if tag is None else self.element.findall(tag)
        return [self._child(child) for child in found]

    def child(self, tag: str) -> "Node | None":
        """The first child element with a tag; None if there is none. More than one are a warning."""
        found = self.element.findall(tag)
        if len(found) > 1:
            self.warn(f"has {len(found)} <{tag}>; the first counts", "remove the others")
        return self._child(found[0]) if found else None

    def _child(self, element: Element) -> "Node":
        return Node(element, f"{self.where}, <{element.tag}>", self.file, self._findings)

    def text(self, key: str) -> str | None:
        """An attribute that must be there; records an error and returns None if it is missing or empty."""
        value = self.element.get(key)
        if value is None or not value.strip():
            self.error(f"has no attribute '{key}'" if value is None else f"has an empty attribute '{key}'")
            return None
        return value.strip()

    def numbers(
        self, key: str, count: int, default: Sequence[float] | None = None, infinite: bool = False
    ) -> np.ndarray | None:
        """The numbers of an attribute.

        Args:
            key: name of the attribute.
            count: how many numbers there must be.
            default: returned if the attribute is missing; None if it must be there.
            infinite: whether infinity is allowed.

        Returns:
            (count,); None, with a recorded error, if they cannot be read.
        """
        value = self.element.get(key)
        if value is None and default is not None:
            return np.array(default, float)
        if value is None:
            self.error(f"has no attribute '{key}'", f"give {_counted(count)}")
            return None
        words = value.split()
        for word in words:
            if not NUMBER.fullmatch(word):
                comma = NUMBER.fullmatch(word.replace(",", ".")) or NUMBER.fullmatch(word.strip(","))
                remedy = "write decimal points, and spaces between numbers" if comma else "write a number"
                self.error(f"{key}=\"{value}\": '{word}' is not a number", remedy)
                return None
        if len(words) != count:
            self.error(f'{key}="{value}": has {_counted(len(words))}', f"{_counted(count)} needed")
            return None
        found = np.array([float(word) for word in words])
        if np.isnan(found).any() or (not infinite and np.isinf(found).any()):
            self.error(f'{key}="{value}": must be finite')
            return None
        if (np.abs(found[np.isfinite(found)]) > LARGEST).any():
            if not infinite:
                self.error(f'{key}="{value}": at most {LARGEST:g} is allowed')
                return None
            found = np.where(np.abs(found) > LARGEST, np.copysign(np.inf, found), found)
        return found

    def number(self, key: str, default: float | None = None, infinite: bool = False) -> float | None:
        """The number of an attribute; see :meth:`numbers`."""
        found = self.numbers(key, 1, None if default is None else [default], infinite)
        return None if found is None else float(found[0])


def _counted(count: int) -> str:
    return "1 number" if count == 1 else f"{count} numbers"
