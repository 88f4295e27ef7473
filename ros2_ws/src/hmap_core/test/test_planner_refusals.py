"""What has no plan is refused before the long searches, by necessary conditions that are cheap, with the reason."""

from dataclasses import replace

import numpy as np
import pytest
from simulation_fixtures import box, scene

from hmap_core import planner
from hmap_core.exceptions import Code, HmapError
from hmap_core.planner.diagnosis import hand_fits_at_goal, why_no_contact
from hmap_core.planner.immovable import why_immovable
from hmap_core.planner.object_path import BidirectionalSearch
from hmap_core.planner.protocols import ObjectPathQuery
from hmap_core.transforms import pose
from hmap_core.types import Body, BodyKind, Goal, Scene, Shape, ShapeKind
from hmap_core.waypoints import NoObjectPath


def wall(name: str, size, xyz) -> Body:
    return box(name, size, xyz, BodyKind.FIXED)


def refused(made: Scene, code: Code, *parts: str) -> str:
    """What was tried for a task that is refused in its first round, for a reason with some parts in it."""
    with pytest.raises(HmapError) as error:
        planner.plan(made, seed=0, time_limit=120.0)
    assert error.value.code == code
    assert all(part in error.value.reason for part in parts), error.value.reason
    tried = str(error.value.search)
    assert "round 2" not in tried and "intermediate placements" not in tried
    return tried


def passage(*bodies: Body) -> Scene:
    """A cube at the end of a roofed passage of 100 mm, which opens towards the robot, with bodies in it."""
    sides = (wall(f"side_{k}", (0.24, 0.02, 0.12), (0.62, y, 0.06)) for k, y in enumerate((0.06, -0.06)))
    back, roof = wall("back", (0.02, 0.14, 0.12), (0.75, 0.0, 0.06)), wall("roof", (0.26, 0.14, 0.02), (0.62, 0, 0.13))
    cube = box("cube", (0.04, 0.04, 0.04), (0.7, 0.0, 0.02))
    made = scene(cube, *sides, back, roof, *bodies, goal=Goal("cube", pose((0.4, 0.3, 0.02))))
    return replace(made, removable={"plug": None})


def test_an_obstacle_that_no_robot_can_move_ends_the_first_round():
    heavy = passage(replace(box("plug", (0.07, 0.09, 0.11), (0.55, 0.0, 0.055)), mass=40.0))
    tried = refused(heavy, Code.NO_CONTACT, "'plug' is in the way of 'cube'", "weighs 40 kg", "29.4 N")
    assert "out of the way" not in tried
    enclosed = passage(
        box("plug", (0.096, 0.096, 0.116), (0.59, 0.0, 0.058)), box("stop", (0.08,) * 3, (0.68, 0, 0.04))
    )
    assert "96 mm wide" in why_immovable(enclosed, enclosed.start_state(), "plug")


def test_an_obstacle_that_carries_what_stays_is_told():
    vase = replace(box("vase", (0.03, 0.03, 0.05), (0.45, 0.0, 0.135)), mass=0.1)
    made = passage(box("plug", (0.09, 0.09, 0.11), (0.47, 0.0, 0.055)), vase)
    assert "'plug' carries 'vase'" in why_immovable(made, made.start_state(), "plug")
    free = passage(box("plug", (0.06, 0.09, 0.11), (0.45, 0.0, 0.055)))
    assert not why_immovable(free, free.start_state(), "plug")


def under_roof(depth: float) -> Scene:
    """A die whose goal is under a roof of 50 mm, some depth in m behind its edge."""
    roof = wall("roof", (0.26, 0.34, 0.02), (0.63, 0.25, 0.06))
    sides = (wall(f"side_{k}", (0.26, 0.02, 0.05), (0.63, y, 0.025)) for k, y in enumerate((0.41, 0.09)))
    back = wall("back", (0.02, 0.3, 0.05), (0.75, 0.25, 0.025))
    goal = Goal("die", pose((0.5 + depth, 0.25, 0.015)))
    return scene(box("die", (0.03, 0.03, 0.03), (0.4, -0.2, 0.015)), roof, *sides, back, goal=goal)


def test_a_goal_at_which_no_hand_fits_is_refused_before_placements_are_searched():
    refused(under_roof(0.2), Code.OUT_OF_REACH, "goal of 'die'", "no hand fits", "with the hand in 'roof'")
    for depth, fits in ((0.2, False), (-0.03, True)):
        made = under_roof(depth)
        assert hand_fits_at_goal(made, made.start_state(), "die", made.goal.pose) is fits


@pytest.mark.parametrize("x, stays", [(0.5, True), (0.6, False)])
def test_a_goal_at_which_the_object_tips_is_refused_before_anything_is_planned(x, stays):
    pole, plank = (
        wall("pole", (0.05, 0.05, 0.2), (0.5, 0.25, 0.1)),
        box("plank", (0.3, 0.05, 0.03), (0.45, -0.2, 0.015)),
    )
    made = scene(plank, pole, goal=Goal("plank", pose((x, 0.25, 0.215))))
    if stays:
        planner.plan(made, seed=0, time_limit=120.0)
    else:
        assert not refused_at_once(made, "'plank' would not stay", "'pole'")


def test_a_ball_on_a_bare_table_is_refused():
    ball = Body("ball", BodyKind.MOVABLE, (Shape(ShapeKind.SPHERE, (0.03,)),), pose((0.45, -0.2, 0.03)), 0.1)
    assert not refused_at_once(scene(ball, goal=Goal("ball", pose((0.45, 0.2, 0.03)))), "'ball' would not stay", "roll")


def refused_at_once(made: Scene, *parts: str) -> list:
    """What was tried for a task whose goal is refused."""
    with pytest.raises(HmapError) as error:
        planner.plan(made, seed=0, time_limit=120.0)
    assert error.value.code == Code.INVALID_POSE and all(part in error.value.reason for part in parts)
    return error.value.search.get("tried", [])


def test_planar_motion_does_not_turn_an_object_over():
    over = Goal("plate", pose((0.5, 0.0, 0.045), (1.0, 0.0, 0.0, 0.0)))
    made = scene(box("plate", (0.2, 0.2, 0.09), (0.5, 0.0, 0.045)), goal=over)
    query = ObjectPathQuery(replace(made, motion="planar"), made.start_state(), over, 0, 10.0)
    with pytest.raises(NoObjectPath, match=r"tilted by 180\.0 deg") as error:
        BidirectionalSearch().plan_path(query)
    assert error.value.proven
    with pytest.raises(HmapError, match="no gripper holds 'plate', which is 90 mm wide"):
        planner.plan(made, seed=0, time_limit=120.0)
    turned = replace(over, pose=pose((0.5, 0.1, 0.045), (0.0, 0.0, np.sin(0.5), np.cos(0.5))))
    assert len(BidirectionalSearch().plan_path(replace(query, goal=turned)).poses) > 1


def test_what_no_gripper_holds_is_not_lifted_out_of_a_pen():
    fence = [wall(f"side_{k}", (0.32, 0.02, 0.08), (0.5, y, 0.04)) for k, y in enumerate((0.14, -0.14))]
    fence += [wall(f"end_{k}", (0.02, 0.26, 0.08), (x, 0.0, 0.04)) for k, x in enumerate((0.35, 0.65))]
    made = scene(
        box("crate", (0.09, 0.09, 0.09), (0.5, 0.0, 0.045)), *fence, goal=Goal("crate", pose((0.5, 0.3, 0.045)))
    )
    parts = ("no planar path of 'crate'", "proven", "cannot be lifted over that", "90 mm wide", "opens 78 mm")
    refused(made, Code.NO_OBJECT_PATH, *parts)


def test_what_stands_in_a_narrow_pipe_is_refused_for_the_hand():
    sides = [wall(f"x_{k}", (0.02, 0.1, 0.2), (x, 0.0, 0.1)) for k, x in enumerate((0.45, 0.55))]
    sides += [wall(f"y_{k}", (0.08, 0.02, 0.2), (0.5, y, 0.1)) for k, y in enumerate((0.04, -0.04))]
    made = scene(box("die", (0.03, 0.03, 0.03), (0.5, 0.0, 0.015)), *sides, goal=Goal("die", pose((0.4, 0.3, 0.015))))
    refused(made, Code.NO_CONTACT, "no contact can move 'die' from its start", "with the hand in '")


def test_what_slips_out_of_the_pads_is_told():
    block = box("block", (0.05, 0.05, 0.1), (0.5, 0.0, 0.05), mass=1.0, friction=0.05)
    made = scene(block, goal=Goal("block", pose((0.5, 0.2, 0.05))))
    assert "friction of its pads does not carry" in why_no_contact(made, made.start_state(), "block", made.goal.pose)
    rough = replace(made, bodies=made.bodies | {"block": replace(block, friction=0.6)})
    assert "friction of its pads" not in why_no_contact(rough, rough.start_state(), "block", made.goal.pose)
