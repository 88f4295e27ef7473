"""Stacks that the plan changes: what stands well on something that then tips."""

import pytest
from validation_fixtures import ABOVE, GRASP_Z, OPEN, SIDE, Storyboard, box, goal, table, write_gantry

from hmap_core.validation import check

BOARD_TOP, HEAVY = 0.12, 0.4  # m, kg


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    return write_gantry(tmp_path_factory.mktemp("gantry"))


def seesaw(*more: dict) -> list[dict]:
    """A cube, and a board that lies across a pillar at x = 0.3 m and sticks out by 10 cm on both sides."""
    cube = box("cube", (SIDE,) * 3, (0.0, 0.0, SIDE / 2)) | {"mass": HEAVY}
    pillar = box("pillar", (0.1, 0.1, 0.1), (0.3, 0.0, 0.05), "fixed")
    return [table(), pillar, box("board", (0.3, 0.06, 0.02), (0.3, 0.0, 0.11)), cube, *more]


def placed(urdf: str, x: float, bodies: list[dict]) -> dict:
    """A plan that carries the cube onto the board at x."""
    z = BOARD_TOP + SIDE / 2
    story = Storyboard((0.0, 0.0, ABOVE), OPEN, bodies)
    story.move("transit", (0.0, 0.0, GRASP_Z), 1.0)
    story.move("transit", (0.0, 0.0, GRASP_Z), 0.4, opening=SIDE)
    story.move("grasp", (0.0, 0.0, 0.22), 0.8, carries=("cube",))
    story.move("grasp", (x, 0.0, 0.22), 1.0, carries=("cube",))
    story.move("grasp", (x, 0.0, z), 0.6, carries=("cube",))
    story.move("transit", (x, 0.0, z), 0.4, opening=OPEN)
    story.move("transit", (x, 0.0, ABOVE), 1.0)
    return story.plan(urdf, goal("cube", (x, 0.0, z)), "physical")


def rejected(plan: dict) -> list[tuple]:
    return [(violation.kind, violation.bodies) for violation in check(plan).violations]


def test_a_board_tips_under_what_is_placed_on_its_end(urdf):
    assert rejected(placed(urdf, 0.2, seesaw())) == [("unsupported", ("board", "cube"))]


def test_a_board_does_not_tip_under_what_is_placed_over_its_support(urdf):
    assert rejected(placed(urdf, 0.3, seesaw())) == []


def test_a_counterweight_keeps_the_board(urdf):
    weight = box("weight", (SIDE,) * 3, (0.4, 0.0, BOARD_TOP + SIDE / 2)) | {"mass": HEAVY}
    bodies = seesaw(weight)
    next(body for body in bodies if body["name"] == "board")["mass"] = 2.0  # it does not tip under the weight alone
    assert rejected(placed(urdf, 0.2, bodies)) == []


def test_a_tower_may_not_lean_though_each_body_stands_on_the_next_one(urdf):
    """Every block sticks out by less than half its width, and all of them by more."""
    first = box("first", (0.06, 0.06, 0.06), (0.272, 0.0, 0.13)) | {"mass": 0.2}
    pillar = box("pillar", (0.1, 0.1, 0.1), (0.3, 0.0, 0.05), "fixed")
    cube = box("cube", (SIDE,) * 3, (0.0, 0.0, SIDE / 2)) | {"mass": 1.0}
    bodies = [table(), pillar, first, cube]
    z = 0.16 + SIDE / 2
    for x, falls in ((0.246, True), (0.28, False)):
        story = Storyboard((0.0, 0.0, ABOVE), OPEN, bodies)
        story.move("transit", (0.0, 0.0, GRASP_Z), 1.0)
        story.move("transit", (0.0, 0.0, GRASP_Z), 0.4, opening=SIDE)
        story.move("grasp", (0.0, 0.0, 0.25), 0.8, carries=("cube",))
        story.move("grasp", (x, 0.0, 0.25), 1.0, carries=("cube",))
        story.move("grasp", (x, 0.0, z), 0.6, carries=("cube",))
        story.move("transit", (x, 0.0, z), 0.4, opening=OPEN)
        story.move("transit", (x, 0.0, ABOVE), 1.0)
        found = rejected(story.plan(urdf, goal("cube", (x, 0.0, z)), "physical"))
        assert found == ([("unsupported", ("cube", "first"))] if falls else [])


def test_a_stack_that_is_measured_a_little_off_is_not_judged_by_that(urdf):
    bodies = seesaw()
    board = next(body for body in bodies if body["name"] == "board")
    board["pose"][2] += 0.0015  # it hovers
    assert ("unsupported", ("board", "cube")) not in rejected(placed(urdf, 0.3, bodies))
