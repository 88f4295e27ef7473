"""Reads the XML of a robot description, with line numbers, and expands xacro files."""

import re
from collections.abc import Callable
from pathlib import Path
from xml.etree.ElementTree import Element, TreeBuilder
from xml.parsers import expat

from hmap_core.regular_file import regular
from hmap_core.robot_description.findings import Finding, Severity
from hmap_core.robot_description.node import LINE

ROOT = "robot"
XACRO_SUFFIX, XACRO_PREFIX = ".xacro", "xacro:"
OTHER_FORMATS = {"sdf": "SDF", "mujoco": "MJCF", "COLLADA": "COLLADA"}  # roots of other formats
CHECKED = ("link", "joint", "material")  # children of the root in which nothing may be left unexpanded
UNEXPANDED = re.compile(r"\$\{[^}]*\}?|\$\([^)]*\)?")
MAX_SIZE = 50_000_000  # bytes


def read_document(file: Path, findings: list[Finding]) -> Element | None:
    """Reads a URDF or xacro file.

    Args:
        file: the file. It is expanded as xacro if its name ends with ``.xacro`` or it has elements ``xacro:...``.
        findings: list to which findings are added.

    Returns:
        The element ``<robot>``, whose elements have their line as attribute :data:`LINE`; None, with recorded errors,
        if it cannot be read, or has expressions that are not expanded.
    """

    def refuse(text: str, remedy: str = "", line: int = 0, element: str = "") -> Element | None:
        """Records an error; returns None for the caller to return."""
        findings.append(Finding(Severity.ERROR, file, element, text, remedy, line))
        return None

    try:
        if regular(file).stat().st_size > MAX_SIZE:
            return refuse(f"is larger than {MAX_SIZE} bytes", "is this a robot description?")
        data = file.read_bytes()
    except (OSError, ValueError) as error:
        return refuse(f"cannot be read: {getattr(error, 'strerror', None) or error}")
    root = None
    if file.suffix != XACRO_SUFFIX:
        root = _root(data, refuse)
        if root is None:
            return None
    if root is None or any(element.tag.startswith(XACRO_PREFIX) for element in root.iter()):
        text, problem, remedy = _expanded(file)
        root = refuse(problem, remedy) if text is None else _root(text.encode(), refuse, lines=False)
        if root is None:
            return None
    if root.tag != ROOT:
        known = OTHER_FORMATS.get(root.tag)
        remedy = f"convert the {known} file to URDF" if known else "a URDF has the root element <robot>"
        return refuse(f"its root element is <{root.tag}>", remedy, int(root.get(LINE, 0)))
    unexpanded = [found for child in root if child.tag in CHECKED and (found := _unexpanded(child)) is not None]
    for where, problem, line in unexpanded:
        refuse(problem, "expand the file with xacro", line, where)
    return None if unexpanded else root


def _root(data: bytes, refuse: Callable[..., Element | None], lines: bool = True) -> Element | None:
    """The root element, with line numbers; None, with a recorded error, if the data are no XML."""
    start = len(data) - len(data.lstrip())  # some files have empty lines before the XML declaration
    skipped = data.count(b"\n", 0, start)
    builder = TreeBuilder()
    parser = expat.ParserCreate()  # without namespaces, as PyBullet reads: prefixes need not be declared

    def begin(tag: str, attributes: dict[str, str]) -> None:
        if lines:
            attributes[LINE] = str(parser.CurrentLineNumber + skipped)
        builder.start(tag, attributes)

    parser.StartElementHandler = begin
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(data[start:], True)
        return builder.close()
    except (expat.ExpatError, ValueError, LookupError) as error:  # LookupError: an encoding that is not known
        line = getattr(error, "lineno", -skipped) + skipped
        refuse(f"is not XML: {error}", "a URDF is an XML file with the element <robot>", line)
        return None


def _expanded(file: Path) -> tuple[str | None, str, str]:
    """The URDF of a xacro file; None with the problem and the remedy if it cannot be expanded."""
    by_hand = f"'xacro {file.name} > robot.urdf'"
    try:
        import xacro  # optional, and only for xacro files
    except ImportError:
        return None, "is a xacro file, and xacro is not installed", f"'pip install xacro', or expand it by {by_hand}"
    try:
        return xacro.process_file(str(file)).toxml(), "", ""
    except RecursionError:
        problem = "xacro cannot expand it: its macros or files include each other endlessly, or too deeply"
        return None, problem, "look for one that includes itself"
    except Exception as error:  # errors of the file's own expressions are of any type
        problem = " ".join(f"{type(error).__name__}: {error}".split())
        return None, f"xacro cannot expand it: {problem}", f"expand it by {by_hand}, with its arguments"


def _unexpanded(element: Element) -> tuple[str, str, int] | None:
    """The first attribute in an element or below it that has an unexpanded expression: element, problem and line."""
    for inner in element.iter():
        for key, value in inner.items():
            found = UNEXPANDED.search(value)
            if found:
                where = f"{element.tag} '{element.get('name', '')}'"
                where += "" if inner is element else f", <{inner.tag}>"
                return where, f"{key}=\"{value}\": '{found.group()}' is not expanded", int(inner.get(LINE, 0))
    return None
