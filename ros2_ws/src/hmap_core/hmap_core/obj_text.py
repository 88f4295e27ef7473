"""The text of OBJ files: checked line by line, and written so that no reader has to guess.

Readers of OBJ files differ in what they make of damaged lines, of tabs, comments and negative indices. What is left
here after the check means the same to all of them.
"""

import math
from collections.abc import Iterator, Sequence

KEPT = ("o", "g", "s", "usemtl", "mtllib")  # elements that are passed on as they are
COORDINATES = 3
CORNERS = 3  # least number of vertices of a face
QUAD = 4
SHOWN = 60  # characters of a line in an error
REMEDY = "correct it, or export the mesh again"

Corner = tuple[int | None, int | None, int | None]  # numbers of a vertex, a texture coordinate and a normal, from 1


class DamagedLine(ValueError):
    """A line of an OBJ file is not as the format has it."""


def clean_obj(text: str) -> str:
    """Checks the text of an OBJ file, and writes it plainly.

    Comments, continued lines and tabs go, indices count from the first vertex, and faces of five and more corners
    become fans of triangles. Elements other than vertices, faces, groups and materials are left out.

    Args:
        text: of the file.

    Returns:
        The text of the same surface.

    Raises:
        DamagedLine: a vertex or a face is not as the format has it; names the line, and what is allowed.
    """
    lines: list[str | tuple[Corner, ...]] = []
    vertices: list[tuple[int, str]] = []  # where each is in the file
    counts = {"v": 0, "vt": 0, "vn": 0}
    faces: list[tuple[int, str, tuple[Corner, ...]]] = []
    for number, words in _elements(text):
        element = words[0]
        if element in counts:
            counts[element] += 1
        if element == "v":
            vertices.append((number, " ".join(words)))
            allowed = f"a vertex has {COORDINATES} coordinates, and only numbers"
            if len(_numbers(number, words, allowed)) < COORDINATES:
                raise _wrong(number, words, allowed)
            lines.append(" ".join(words))
        elif element == "f":
            corners = tuple(_corner(number, words, word, counts) for word in words[1:])
            if len(corners) < CORNERS:
                raise _wrong(number, words, f"a face has {CORNERS} vertices or more")
            faces.append((number, " ".join(words), corners))
            lines.append(corners)
        elif element in counts:
            _numbers(number, words, f"'{element}' is followed by numbers only")
            lines.append(" ".join(words))
        elif element in KEPT:
            lines.append(" ".join(words))
    _check_vertices(vertices, faces)
    alike = len({tuple(part is None for part in corner) for _, _, corners in faces for corner in corners}) == 1
    return "\n".join(line if isinstance(line, str) else _face_lines(line, alike) for line in lines) + "\n"


def _elements(text: str) -> Iterator[tuple[int, list[str]]]:
    """Number and words of each line that has some; a line that goes on has the number of its first one."""
    begun, first = "", 0
    for number, line in enumerate(text.splitlines(), 1):
        first = first if begun else number
        line = begun + line.partition("#")[0]
        begun = line[:-1] + " " if line.endswith("\\") else ""
        if begun:
            continue
        words = line.split()
        if words:
            yield first, words
    if begun.split():
        yield first, begun.split()


def _numbers(number: int, words: Sequence[str], allowed: str) -> list[float]:
    """The numbers after the name of an element; raises DamagedLine for anything else."""
    try:
        return [float(_plain(word)) for word in words[1:]]
    except ValueError as error:
        raise _wrong(number, words, allowed) from error


def _plain(word: str) -> str:
    """A word of which other languages than Python make the same number."""
    if "_" in word or not word.isascii():
        raise ValueError(word)
    return word


def _corner(number: int, words: Sequence[str], word: str, counts: dict[str, int]) -> Corner:
    """A corner of a face, written as v, v/vt, v//vn or v/vt/vn."""
    parts = word.split("/")
    try:
        indices = [int(_plain(part)) if part else None for part in parts]
    except ValueError:
        indices = [None]
    if indices[0] is None or 0 in indices or len(parts) > len(counts):
        raise _wrong(number, words, "a corner of a face is v, v/vt, v//vn or v/vt/vn, of whole numbers other than 0")
    found = [
        None if index is None else index if index > 0 else count + 1 + index
        for index, count in zip(indices, counts.values(), strict=False)
    ]
    vertex, texture, normal = (*found, None, None)[: len(counts)]
    return vertex, texture, normal


def _check_vertices(vertices: Sequence[tuple[int, str]], faces: Sequence[tuple[int, str, tuple[Corner, ...]]]) -> None:
    """Raises DamagedLine where a face has a vertex that does not exist, or that is not finite."""
    checked = set()
    for number, line, corners in faces:
        for vertex, _, _ in corners:
            if vertex in checked:
                continue
            if vertex is None or not 1 <= vertex <= len(vertices):
                raise _wrong(number, line.split(), f"the file has vertices 1 to {len(vertices)}")
            where, text = vertices[vertex - 1]
            if not all(math.isfinite(float(word)) for word in text.split()[1 : 1 + COORDINATES]):
                raise _wrong(where, text.split(), "a coordinate is not finite")
            checked.add(vertex)


def _face_lines(corners: Sequence[Corner], alike: bool) -> str:
    """The lines of a face; textures and normals only where all corners of the file have the same of them."""
    texts = [_corner_text(corner if alike else (corner[0], None, None)) for corner in corners]
    if len(texts) <= QUAD:
        return " ".join(["f", *texts])
    return "\n".join(f"f {texts[0]} {a} {b}" for a, b in zip(texts[1:], texts[2:], strict=False))


def _corner_text(corner: Corner) -> str:
    vertex, texture, normal = ("" if part is None else str(part) for part in corner)
    return f"{vertex}/{texture}/{normal}".rstrip("/")


def _wrong(number: int, words: Sequence[str], allowed: str) -> DamagedLine:
    line = " ".join(words)
    return DamagedLine(f"line {number} is {line[:SHOWN] + '...' * (len(line) > SHOWN)!r}; {allowed}; {REMEDY}")
