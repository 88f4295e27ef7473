"""What is said of an object that no hand can take in some place."""

import re
from dataclasses import replace

import numpy as np
import pytest
from planner_fixtures import disc
from simulation_fixtures import box, scene

from hmap_core import planner
from hmap_core.contacts.grip_width import grip_problem, narrowest
from hmap_core.exceptions import Code, ContactError, HmapError
from hmap_core.planner.diagnosis import hand_fits, hand_fits_at_goal, why_no_contact, why_not_moved
from hmap_core.planner.hmap_planner import HmapPlanner, PlanningJob
from hmap_core.planner.immovable import why_immovable
from hmap_core.planner.preconditions import check_grip
from hmap_core.planner.reachability import check_start
from hmap_core.planner.solution_sequence import SolutionSequence, Subgoal
from hmap_core.planner.tasks import PathTask
from hmap_core.transforms import pose
from hmap_core.types import Body, BodyKind, Goal, Shape, ShapeKind

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


WIDE = (0.09, 0.09, 0.09)  # m, wider than a Panda's gripper opens


def niche(*sides: str) -> list[Body]:
    """Walls around a cube of WIDE at (0.5, 0), 3 mm off it, and the table."""
    walls = {
        "wall_back": box("wall_back", (0.02, 0.13, 0.1), (0.558, 0.0, 0.05), BodyKind.FIXED),
        "wall_left": box("wall_left", (0.1, 0.02, 0.1), (0.5, 0.058, 0.05), BodyKind.FIXED),
        "wall_right": box("wall_right", (0.1, 0.02, 0.1), (0.5, -0.058, 0.05), BodyKind.FIXED),
    }
    return [walls[f"wall_{side}"] for side in sides]


def in_niche(*sides: str, size=WIDE):
    cube, goal = box("cube", size, (0.5, 0.0, size[2] / 2)), Goal("cube", pose((0.38, 0.0, size[2] / 2)))
    return scene(cube, *niche(*sides), goal=goal)


def test_what_is_too_wide_and_enclosed_is_told_with_numbers_and_names():
    made = in_niche("back", "left", "right")
    text = why_not_moved(made, made.start_state(), "cube")
    assert "'cube'" in text and "90 mm" in text and "opens 78 mm" in text
    assert text.endswith("'wall_back' and 'wall_left' and 'wall_right'")
    for walls in (("back",), ("left", "right")):  # along the wall, and out between two of them
        made = in_niche(*walls)
        assert "pushed away" not in why_not_moved(made, made.start_state(), "cube")


def test_an_object_that_no_hand_can_move_from_its_start_is_refused_in_the_first_round():
    with pytest.raises(HmapError) as error:
        planner.plan(in_niche("back", "left", "right"), seed=0, time_limit=60.0)
    assert error.value.code == Code.NO_CONTACT
    assert "from its start" in error.value.reason and "opens 78 mm" in error.value.reason
    rounds = [attempt["what"] for attempt in error.value.search["tried"]]
    assert [what for what in rounds if what.startswith("round")] == rounds[:1]


def test_obstacles_that_no_gripper_holds_are_told_too():
    made = in_niche("back", "left", "right")
    plug = box("plug", WIDE, (0.39, 0.0, 0.045))
    made = replace(made, bodies=made.bodies | {"plug": plug}, removable={"plug": None})
    job = PlanningJob(HmapPlanner(), replace(made, goal=Goal("cube", pose((0.4, 0.3, 0.045)))))
    job.context.record.failed(ContactError("none"))
    with pytest.raises(ContactError, match="even without 'plug': .*; no gripper holds 'plug', which is 90 mm wide"):
        check_start(job.context, PathTask(Subgoal(job.scene.goal), SolutionSequence(job.start), 0, False))


def test_the_hand_fits_on_what_stands_free_only():
    narrow = in_niche("back", "left", "right", size=(0.04, 0.04, 0.13))
    assert hand_fits(narrow, narrow.start_state(), "cube")
    beside_wall = in_niche("back")  # it can be pushed along the wall
    assert hand_fits(beside_wall, beside_wall.start_state(), "cube")
    enclosed = in_niche("back", "left", "right")
    assert not hand_fits(enclosed, enclosed.start_state(), "cube")


@pytest.mark.parametrize(
    "kind, size, width",
    [
        (ShapeKind.BOX, (0.2, 0.05, 0.3), 0.05),
        (ShapeKind.CYLINDER, (0.03, 0.2), 0.06),
        (ShapeKind.CYLINDER, (0.2, 0.02), 0.02),
        (ShapeKind.SPHERE, (0.03,), 0.06),
        (ShapeKind.CAPSULE, (0.03, 0.2), 0.06),
        (ShapeKind.MESH, (1.0, 1.0, 1.0), None),
    ],
)
def test_the_narrowest_width_of_shapes(kind, size, width):
    shapes = (Shape(kind, size), Shape(ShapeKind.BOX, (1.0, 1.0, 1.0)))
    assert narrowest(Body("thing", BodyKind.MOVABLE, shapes, HERE)) == width


def test_grips_are_limited_by_the_opening_or_the_lack_of_a_gripper():
    wide, narrow = in_niche(), in_niche(size=(0.05, 0.09, 0.09))
    assert "no gripper holds 'cube', which is 90 mm wide" in grip_problem(wide, "cube", wide.robots)
    assert grip_problem(narrow, "cube", narrow.robots) == ""


def on_step(size=WIDE, height=0.05, turn=(0.0, 0.0, 0.0, 1.0)):
    """The cube is wanted on a step."""
    cube = box("cube", size, (0.5, 0.0, size[2] / 2))
    step = box("step", (0.2, 0.2, height), (0.5, 0.3, height / 2), BodyKind.FIXED)
    return scene(cube, step, goal=Goal("cube", np.array([0.5, 0.3, height + size[2] / 2, *turn])))


def test_a_lift_of_what_no_gripper_holds_is_refused_before_anything_is_planned():
    with pytest.raises(HmapError, match="'cube' has to be lifted.*90 mm wide.*opens 78 mm") as error:
        planner.plan(on_step(), seed=0, time_limit=60.0)
    assert error.value.code == Code.NO_CONTACT
    assert "tried" not in error.value.search


def test_a_push_and_a_turn_over_need_no_grip():
    for made in (in_niche(), on_step(turn=(np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))), on_step(size=(0.05, 0.09, 0.09))):
        check_grip(made, made.start_state(), made.goal)


def test_a_hand_fits_on_a_disc_that_it_can_only_drag(tmp_path):
    """A disc has no side to push; that a hand drags it from above was not looked at, for obstacles neither."""
    made = disc(tmp_path)
    assert hand_fits(made, made.start_state(), "disc")
    assert hand_fits_at_goal(made, made.start_state(), "disc", made.goal.pose)
    assert not why_immovable(made, made.start_state(), "disc")
