"""``docs/concepts.md`` defines each term once, and the code that it names exists."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "concepts.md"
SOURCES = ROOT / "ros2_ws" / "src"
CORE = SOURCES / "hmap_core" / "hmap_core"


def rows() -> list[list[str]]:
    """Cells of the rows of all tables, without heads."""
    lines = [line for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return [row for row in cells if row[0] != "term"]


def code_of(place: str) -> str:
    """The sources of a package or module of hmap_core, or of hmap."""
    if place == "hmap":
        files = (SOURCES / "hmap" / "hmap").rglob("*.py")
    else:
        files = [*(CORE / place).rglob("*.py"), *CORE.glob(f"{place}.py")]
    return "\n".join(file.read_text(encoding="utf-8") for file in files)


def test_rows_are_complete():
    wrong = [row[0] for row in rows() if len(row) != 4 or not row[0] or not row[1]]
    assert rows() and not wrong


def test_each_term_is_defined_once():
    terms = [term for row in rows() for term in row[0].split(", ")]
    assert sorted(terms) == sorted(set(terms))


def test_named_code_exists():
    wrong = []
    for term, _, where, _ in rows():
        placed = re.findall(r"`(\w+)` in `(\w+)`", where)
        for name, place in placed:
            if not re.search(rf"^(class|def) {name}\b", code_of(place), re.MULTILINE):
                wrong.append(f"{term}: no {name} in {place}")
        if not placed:
            names = re.findall(r"`(\w+)(?:\.\w+)?`", where)
            everything = code_of("") + code_of("hmap")
            wrong += [
                f"{term}: no {n}" for n in names if not code_of(n) and not re.search(rf"^class {n}\b", everything, re.M)
            ]
    assert not wrong


def test_retired_words_have_a_defined_replacement():
    page = PAGE.read_text(encoding="utf-8").lower()
    for term in ("subgoal", "solution sequence", "sub-trajectory", "attached object", "transit", "plan repair"):
        assert f"| {term} |" in page
