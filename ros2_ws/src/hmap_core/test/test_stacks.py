"""Stacks: what is placed on a body that then tips is refused, or placed elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
from simulation_fixtures import box, scene

from hmap_core import planner
from hmap_core.exceptions import Code, InputError
from hmap_core.planner.placements import placements_of
from hmap_core.planner.preconditions import check_goal_support
from hmap_core.stability.stacks import stack_tips
from hmap_core.transforms import pose
from hmap_core.types import BodyKind, Goal

TOP = 0.12  # m, of the board


def seesaw(*more, x: float = 0.4, heavy: float = 0.4):
    """A cube that is wanted at x on a board; that lies across a pillar at x = 0.5 and sticks out on both sides."""
    pillar = box("pillar", (0.1, 0.1, 0.1), (0.5, 0.0, 0.05), BodyKind.FIXED)
    board = box("board", (0.3, 0.06, 0.02), (0.5, 0.0, 0.11), mass=0.2)
    cube = box("cube", (0.05, 0.05, 0.05), (0.4, 0.3, 0.025), mass=heavy)
    return scene(cube, pillar, board, *more, goal=Goal("cube", pose((x, 0.0, TOP + 0.025))))


@pytest.mark.parametrize("x, tips", [(0.4, True), (0.42, True), (0.48, False), (0.5, False), (0.6, True)])
def test_a_board_tips_under_what_is_heavier_at_its_end(x, tips):
    made = seesaw(x=x)
    assert stack_tips(made.bodies, "cube", made.goal.pose) == (("cube", "board") if tips else ())


def test_a_light_body_does_not_tip_it():
    made = seesaw(heavy=0.02)
    assert stack_tips(made.bodies, "cube", made.goal.pose) == ()


def test_what_stands_on_fixed_bodies_is_no_stack():
    made = seesaw()
    assert stack_tips(made.bodies, "cube", pose((0.3, 0.0, 0.025))) == ()
    assert stack_tips(made.bodies, "cube", pose((1.9, 0.0, 0.5))) == ()


def test_a_stack_that_hovers_a_little_is_not_judged():
    made = seesaw()
    off = made.bodies["board"]
    bodies = made.bodies | {"board": replace(off, pose=off.pose + np.array([0, 0, 0.0015, 0, 0, 0, 0]))}
    assert stack_tips(bodies, "cube", pose((0.4, 0.0, TOP + 0.0265))) == ()


def test_a_goal_on_what_tips_is_refused_with_the_names():
    made = seesaw()
    with pytest.raises(InputError, match="'cube' at its goal .* tip: 'board'; .*2 mm to spare") as error:
        planner.plan(made, seed=0, time_limit=60.0)
    assert error.value.code == Code.INVALID_POSE
    check_goal_support(seesaw(x=0.5), made.start_state(), seesaw(x=0.5).goal)


def test_a_counterweight_that_may_be_moved_makes_neither_a_refusal():
    weight = box("weight", (0.05, 0.05, 0.05), (0.6, 0.0, TOP + 0.025), mass=0.4)
    made = seesaw(weight)
    heavy = replace(made.bodies["board"], mass=2.0)
    made = replace(made, bodies=made.bodies | {"board": heavy}, removable={"weight": None})
    check_goal_support(made, made.start_state(), made.goal)


def test_an_obstacle_is_not_placed_where_a_stack_would_tip():
    made = seesaw()
    state = made.start_state()
    found = placements_of(made, state, "cube", (), frozenset({"table", "pillar"}), np.random.default_rng(0))
    places = list(found)
    assert places and all(not stack_tips(made.bodies, "cube", T) for T in places)
    assert all(abs(T[0] - 0.5) < 0.08 for T in places)
