"""YAML files as plain data with the line number of every key, so that errors can refer to it."""

import re
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.error import MarkedYAMLError
from ruamel.yaml.scalarbool import ScalarBoolean
from ruamel.yaml.scalarfloat import ScalarFloat
from ruamel.yaml.scalarint import ScalarInt
from ruamel.yaml.scalarstring import ScalarString

from hmap_core.exceptions import Code, InputError
from hmap_core.regular_file import regular

MAX_FILE_SIZE = 1_000_000  # bytes; a scene has a few kB
MAX_NODES = 100_000  # values after aliases are expanded
MAX_DIGITS = 300  # consecutive digits of a number
MAX_SHOWN = 60  # characters of a wrong value that an error message repeats

Location = tuple[str | int, ...]


@dataclass
class Document:
    """The data of a scene file, with the line number of every key.

    Attributes:
        path: the file; relative paths in the data are relative to its folder.
        data: its content; must not be modified if it was read from a file.
        lines: location of a key -> line number, from 1.
        origin: name of the data in error messages, instead of path and line, for scenes built in code.
    """

    path: Path
    data: dict[str, Any]
    lines: dict[Location, int] = field(default_factory=dict)
    origin: str = ""

    def line(self, location: Location) -> int:
        """Line number, from 1, of the key at ``location``, or of the nearest enclosing key."""
        while location and location not in self.lines:
            location = location[:-1]
        return self.lines.get(location, 1)

    def value(self, location: Location) -> Any:
        """The value at ``location`` as written in the file; None if there is none."""
        value: Any = self.data
        for step in location:
            try:
                value = value[step]
            except (KeyError, IndexError, TypeError):
                return None
        return value

    def error(self, location: Location, problem: str, code: Code = Code.INVALID_SCENE) -> InputError:
        """Builds an exception that names the file, the line, the key, its value and the problem.

        Args:
            location: of the key.
            problem: what is wrong, and what is allowed.
            code: error code.

        Returns:
            The exception, for the caller to raise.
        """
        value = self.value(location)
        shown = "" if value is None or isinstance(value, dict) or not location else f" = {_shorten(value)}"
        where = self.origin or f"{self.path}:{self.line(location)}"
        return InputError(f"{where}: {key_text(location)}{shown}: {problem}", code)


def key_text(location: Location) -> str:
    """Formats a location: ``("movable", "bar", "size", 1)`` becomes ``movable.bar.size[1]``."""
    text = ""
    for step in location:
        text += f"[{step}]" if isinstance(step, int) else f".{step}"
    return text.removeprefix(".") or "the file"


def read(path: Path) -> Document:
    """Reads a YAML file whose top level is a mapping.

    Args:
        path: the file.

    Returns:
        Its content, from a cache.

    Raises:
        InputError: INVALID_SCENE; the file cannot be read, is no YAML, or its top level is no mapping.
    """
    return _parse(path, _read_text(path))


def read_key(path: Path, key: str) -> Any:
    """The value of one key at the top level of a YAML file; None where it is missing.

    Only the key's own lines are parsed, as the parser takes long for a whole file. They must not refer to other lines
    by an alias.

    Raises:
        InputError: INVALID_SCENE when the file cannot be read, or these lines are not valid.
    """
    text = _read_text(path)
    own = re.search(rf"^{re.escape(key)}:.*(?:\n(?:[ \t].*)?)*", text, re.MULTILINE)
    if own is None:
        return None
    lines_before = "\n" * text.count("\n", 0, own.start())  # so that an error names the right line
    return _parse(path, lines_before + own.group()).data[key]


@lru_cache(maxsize=64)
def _parse(path: Path, text: str) -> Document:
    """Parses a file. Results are cached, since the parser is slow and scenes name the same files several times."""
    long = re.search(rf"\d{{{MAX_DIGITS + 1}}}", text)
    if long is not None:
        line = text.count("\n", 0, long.start()) + 1
        raise InputError(
            f"{path}:{line}: more than {MAX_DIGITS} digits in a row; is this a number?", Code.INVALID_SCENE
        )
    try:
        node = YAML(typ="rt", pure=True).load(text)
    except MarkedYAMLError as error:
        line = error.problem_mark.line + 1 if error.problem_mark else 1
        problem = " ".join(str(error.problem or error.context).split(" with value ")[0].split())
        raise InputError(f"{path}:{line}: not valid YAML: {problem}", Code.INVALID_SCENE) from error
    except Exception as error:  # the parser raises exceptions of other types as well
        raise InputError(f"{path}:1: not valid YAML: {' '.join(str(error).split())}", Code.INVALID_SCENE) from error
    if node is None:
        raise InputError(f"{path}:1: the file is empty; it must start with schema: 1", Code.INVALID_SCENE)
    if not isinstance(node, CommentedMap):
        raise InputError(f"{path}:1: the top level must be a mapping of keys to values", Code.INVALID_SCENE)
    document = Document(path, {})
    document.data = _Converter(document).convert(node, ())
    return document


def _read_text(path: Path) -> str:
    try:
        if regular(path).stat().st_size > MAX_FILE_SIZE:
            raise InputError(f"{path}: larger than {MAX_FILE_SIZE} bytes; is this a scene?", Code.INVALID_SCENE)
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        byte = f"{error.object[error.start]:#04x}"
        raise InputError(
            f"{path}:{line}: not text in UTF-8: the byte {byte} has no meaning here", Code.INVALID_SCENE
        ) from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}", Code.INVALID_SCENE) from error
    except ValueError as error:  # the path contains a null character
        raise InputError(f"{path}: cannot be read: {error}", Code.INVALID_SCENE) from error


def _shorten(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= MAX_SHOWN else text[: MAX_SHOWN - 3] + "..."


def _encodable(text: str) -> bool:
    """Whether a text is valid Unicode. Escapes in a file can create unpaired surrogates, which cannot be printed."""
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        return False
    return True


class _Converter:
    """Converts the nodes of the parser to plain values and records their line numbers."""

    def __init__(self, document: Document):
        self._document = document
        self._nodes = 0

    def convert(self, node: Any, location: Location) -> Any:
        self._nodes += 1
        if self._nodes > MAX_NODES:
            raise self._document.error((), f"more than {MAX_NODES} values once its aliases are expanded")
        if isinstance(node, CommentedMap):
            return self._mapping(node, location)
        if isinstance(node, CommentedSeq):
            return self._sequence(node, location)
        return self._scalar(node, location)

    def _mapping(self, node: CommentedMap, location: Location) -> dict:
        result = {}
        for key, value in node.items():
            if not isinstance(key, str) or not _encodable(key):
                raise self._document.error(location, f"the key {key!r} must be text")
            here = (*location, str(key))
            try:
                self._document.lines[here] = node.lc.key(key)[0] + 1
            except (KeyError, AttributeError, TypeError):  # merged from another mapping, so without a line number
                pass
            result[str(key)] = self.convert(value, here)
        return result

    def _sequence(self, node: CommentedSeq, location: Location) -> list:
        result = []
        for i, value in enumerate(node):
            here = (*location, i)
            try:
                self._document.lines[here] = node.lc.item(i)[0] + 1
            except (KeyError, AttributeError, TypeError):
                pass
            result.append(self.convert(value, here))
        return result

    def _scalar(self, node: Any, location: Location) -> Any:
        if isinstance(node, ScalarBoolean):
            return bool(node)
        for plain, wrapped in ((float, ScalarFloat), (int, ScalarInt), (str, ScalarString)):
            if isinstance(node, wrapped):
                node = plain(node)
        if isinstance(node, str) and not _encodable(node):
            raise self._document.error(location, f"{node!r} is not Unicode text")
        if node is None or isinstance(node, bool | int | float | str):
            return node
        raise self._document.error(location, f"a value of the kind {type(node).__name__} has no meaning here")
