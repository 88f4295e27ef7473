"""Retired words stay out of the code and the docs; ``docs/concepts.md`` defines the terms that replace them.

A retired word is found as an identifier, as a part of one (``old_posture``, ``POSTURES``) and in prose.
The changelog is left out: it names what was renamed.
"""

import bisect
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SKIPPED = {"CHANGELOG.md", "tests/architecture/test_words.py"}
FOLDERS = ("docs", "examples", "hmap_msgs_py", "ros2_ws/src", "tests", "tools")

# Retired words as sequences of lower-case words, with what to write instead. ``put_down``, ``putDown`` and "put down"
# are the same sequence.
RETIRED = {
    r"errands?": "subgoal",
    r"courses?": "solution sequence",
    r"segment motions?": "sub-trajectory (SubTrajectory)",
    r"pieces? of (a )?(motion|plan|solution)s?": "sub-trajectory, segment",
    r"(put|puts|putting) (down|back|aside|away)": "place, remove (an obstacle)",
    r"take up": "pick",
    r"holding": "attached object, grasp",
    r"in (the|a|its) hand": "attached (object, tool)",
    r"held paths?": "attached path",
    r"through the air": "transit",
    r"air": "transit, free motion",
    r"considerate": "predicate filter that keeps clear of other objects",
    r"reminded": "cost term that prefers known contacts",
    r"(worth|worths|worthiest|worthier)": "score, cost",
    r"strangers?": "detected objects",
    r"followers?": "plan executor; mimic joint",
    r"observers?": "scene monitor",
    r"postures?": "configuration",
    r"(felt|feels?)": "active (set)",
    r"(mend|mends|mended|mending)": "repair",
    r"activity": "detection distance",
    r"margins?": "minimum distance",
    r"hints?": "cached GJK guess",
}
# Retired identifiers, with their case, that are ordinary words otherwise.
RETIRED_NAMES = {
    r"_Piece\b": "SubTrajectory",
    r"\b(in_hand|IN_HAND|InHand)\b": "attached",
    r"\bclass Air\b": "Transit",
    r"\bWhole\b(?=[(,:)]|$)": "predicate filter for contacts that serve the whole path",
    r"\bdef _?(take|put)\(": "pick, place",
    r"\b_attempt\(": "a name that says what is attempted",
}
# What contains a retired word and means something else.
ALLOWED = (
    r"\btype hints?\b",
    r"\bof course\b",
    r"\bhint=|\.hint\b",  # tooltips of viser
    r"\bstability margins?\b",
    r"\b(STABLE|SUPPORT|ANSWER|LIMIT)_MARGIN\b",
)
# Files whose words are still being replaced. The list may only shrink: a file without retired words must not be on it.
NOT_CONVERTED: set[str] = set()

TOKEN = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")


def sources() -> list[Path]:
    """Python files and pages of the repository, without what builds and environments leave in it."""
    inside = [path for folder in FOLDERS for kind in ("*.py", "*.md") for path in (ROOT / folder).rglob(kind)]
    kept = [path for path in (*ROOT.glob("*.md"), *inside) if name_of(path) not in SKIPPED]
    built = {"build", "install", "log", "node_modules", "__pycache__"}
    return sorted(p for p in kept if not built & set(p.relative_to(ROOT).parts) and not p.is_symlink())


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def occurrences(text: str) -> list[tuple[int, str, str]]:
    """Line, retired word and replacement of every retired word in a text."""
    for allowed in ALLOWED:
        text = re.sub(allowed, lambda match: " " * len(match.group()), text)
    tokens = list(TOKEN.finditer(text))
    words = [token.group().lower() for token in tokens]
    starts = [0]
    for word in words:
        starts.append(starts[-1] + len(word) + 1)
    joined = " ".join(words)
    found = []
    for pattern, replacement in RETIRED.items():
        for match in re.finditer(rf"\b(?:{pattern})\b", joined):
            token = tokens[bisect.bisect_right(starts, match.start()) - 1]
            found.append((token.start(), match.group(), replacement))
    for pattern, replacement in RETIRED_NAMES.items():
        found += [(m.start(), m.group().strip("("), replacement) for m in re.finditer(pattern, text, re.MULTILINE)]
    return [(text.count("\n", 0, at) + 1, word, replacement) for at, word, replacement in sorted(found)]


@pytest.mark.parametrize("path", sources(), ids=name_of)
def test_no_retired_words(path):
    name = name_of(path)
    found = occurrences(path.read_text(encoding="utf-8"))
    if name in NOT_CONVERTED:
        assert found, f"{name} has no retired word any more: remove it from NOT_CONVERTED"
    else:
        wrong = [f"{name}:{line}: {word!r} is retired; write: {new}" for line, word, new in found]
        assert not wrong, "\n".join(wrong)


def test_listed_files_exist():
    assert {name for name in NOT_CONVERTED if not (ROOT / name).is_file()} == set()


def test_checker_sees_what_it_should():
    text = "put_down = Posture()\nof course the pair is airtight\n# what is put\n"
    text += "# aside: MARGINS, STABLE_MARGIN\nclass Air:\n"
    assert [(line, word) for line, word, _ in occurrences(text)] == [
        (1, "put down"),
        (1, "posture"),
        (3, "put aside"),
        (4, "margins"),
        (5, "class Air"),
        (5, "air"),
    ]
