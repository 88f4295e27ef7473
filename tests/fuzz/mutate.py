"""Random faults in documents: values, keys and entries as people, editors and networks damage them."""

import copy
import random
from collections.abc import MutableMapping, MutableSequence
from typing import Any

WORDS = (
    "",
    " ",
    "0,5",
    "${gap}",
    "nan",
    "NaN",
    "panda",
    "box",
    "table",
    "gap",
    "../..",
    "\x00",
    "é" * 40,
    "1e999",
    "-1",
)
NUMBERS = (0, -1, 1, 3, 1e-12, -1e-3, 1e9, -1e300, 10**30, float("nan"), float("inf"), float("-inf"))
PIECES = (
    *(
        b"",
        b" ",
        b"\n",
        b"\\\n",
        b"\t",
        b"#",
        b"/",
        b"//",
        b"f ",
        b"v ",
        b"-",
        b".",
        b"e",
        b"e9",
        b"_",
        b"1",
        b"9",
        b"-1",
    ),
    *(b"-1", b"0,5", b"nan", b"inf", b"1e400", b"0 0 0", b"\x00", b"\x0c", b"\xff", b"\xe2\x80\xa8", b"\xd9\xa3"),
)
OTHERS = (None, True, False, [], {}, [0], [[]], {"": 0}, [1, 2, 3], {"x": None})


def mutated(document: Any, rng: random.Random) -> Any:
    """A copy of a document of mappings, lists and scalars, with one to three faults."""
    document = copy.deepcopy(document)
    for _ in range(rng.randint(1, 3)):
        _damage(document, rng)
    return document


def damaged_bytes(content: bytes, rng: random.Random) -> bytes:
    """A copy of a file with one to three places cut out, overwritten, or filled with something of it."""
    for _ in range(rng.randint(1, 3)):
        start = rng.randrange(len(content) + 1)
        end = start + rng.choice((0, 1, 1, 2, rng.randint(0, 40)))
        other = rng.randrange(len(content) + 1)
        piece = rng.choice((*PIECES, content[other : other + 40]))
        content = content[:start] + piece + content[end:]
    return content


def _damage(document: Any, rng: random.Random) -> None:
    places = list(_places(document))
    if not places:
        return
    parent, key = rng.choice(places)
    what = rng.randrange(6)
    if what == 0:
        del parent[key]
    elif what == 1 and isinstance(parent, MutableSequence):
        parent.insert(key, copy.deepcopy(parent[key]))
    elif what == 1:
        parent[rng.choice(WORDS)] = parent.pop(key)
    elif what == 2:
        other, there = rng.choice(places)
        parent[key] = copy.deepcopy(other[there])
    elif what == 3 and isinstance(parent[key], int | float) and not isinstance(parent[key], bool):
        parent[key] = parent[key] * rng.choice((-1, 0, 1e-6, 0.5, 2, 1e3, 1e6))
    else:
        parent[key] = copy.deepcopy(rng.choice((*WORDS, *NUMBERS, *NUMBERS, *OTHERS)))


def _places(node: Any):
    """All (container, key) of a document; of long lists of numbers only some."""
    if isinstance(node, MutableMapping):
        keys = list(node)
    elif isinstance(node, MutableSequence):
        keys = list(range(len(node)))
        if len(keys) > 20:
            keys = keys[:3] + keys[-3:]
    else:
        return
    for key in keys:
        yield node, key
        yield from _places(node[key])
