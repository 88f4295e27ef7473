"""requirements.lock is installed without asking for dependencies, so it has to name all of them itself."""

import re
from importlib.metadata import requires
from pathlib import Path

import pytest
from packaging.requirements import Requirement

LOCK = Path(__file__).resolve().parents[2] / "requirements.lock"


def plain(name: str) -> str:
    """A distribution's name as indexes compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


LOCKED = {plain(line.split("==")[0]) for line in LOCK.read_text(encoding="utf-8").splitlines() if "==" in line}


@pytest.mark.parametrize("name", sorted(LOCKED))
def test_what_a_locked_distribution_requires_is_locked_too(name):
    needed = [Requirement(text) for text in requires(name) or ()]
    here = {plain(each.name) for each in needed if each.marker is None or each.marker.evaluate({"extra": ""})}
    assert here - LOCKED - {"pip"} == set()
