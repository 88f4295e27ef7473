"""What is said of an object that no hand can take in some place."""

import re

import pytest
from simulation_fixtures import box, scene

from hmap_core.planner.diagnosis import why_no_contact
from hmap_core.transforms import pose
from hmap_core.types import BodyKind, Goal

HERE = pose((0.5, 0.0, 0.02))


def why(*around, at=HERE, size=(0.04, 0.04, 0.04)) -> str:
    brick = box("brick", size, at[:3])
    made = scene(brick, *around, goal=Goal("brick", at))
    return why_no_contact(made, made.start_state(), "brick", at)


def counts(text: str) -> dict[str, int]:
    """How many contacts share a fate."""
    return {fate: int(n) for n, fate in re.findall(r"(\d+) are ([^,;]+)", text)}


def test_all_contacts_are_accounted_for():
    text = why()
    total = int(re.match(r"of (\d+) contacts of 'left'", text)[1])
    assert total > 50 and sum(counts(text).values()) == total


def test_too_far_is_told():
    assert list(counts(why(at=pose((1.6, 0.0, 0.02))))) == ["too far for the arm"]


def test_what_the_hand_would_be_in_is_named():
    roof = box("roof", (0.3, 0.3, 0.02), (0.5, 0.0, 0.1), BodyKind.FIXED)
    fates = counts(why(roof))
    assert fates["with the hand in 'roof'"] > 0.5 * sum(fates.values())
    assert "with the hand in 'roof'" not in counts(why())


def test_an_object_without_support_does_not_stand_there():
    assert why(at=pose((0.5, 0.0, 0.3))).startswith("it does not stand there by itself; of ")


@pytest.mark.parametrize("seed", range(2))
def test_the_same_seed_gives_the_same_words(seed):
    made = scene(box("brick", (0.04, 0.04, 0.04), HERE[:3]), goal=Goal("brick", HERE))
    first, second = (why_no_contact(made, made.start_state(), "brick", HERE, seed) for _ in range(2))
    assert first == second
