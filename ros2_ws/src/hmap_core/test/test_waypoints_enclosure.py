"""The proof that obstacles enclose the start or the goal of a body."""

import numpy as np
import pytest
from geometry_fixtures import TABLE, box

from hmap_core.collision.convex import convex_set
from hmap_core.komo.shapes import body_set
from hmap_core.transforms import from_rpy, pose
from hmap_core.types import Body, BodyKind, Shape, ShapeKind
from hmap_core.waypoints import NoObjectPath, ObjectPathProblem, plan_waypoints
from hmap_core.waypoints.checker import ObstacleShapes
from hmap_core.waypoints.enclosure import Enclosure, enclosure, inner_ball

GROUND = 0.05  # m, top of the table
SIDE = 0.05  # m, of the cube
INSIDE, OUTSIDE = pose((0.0, 0.0, GROUND + 0.026)), pose((0.4, 0.0, GROUND + 0.026))


def room(door: float, height: float = 0.1) -> tuple[Body, ...]:
    """A room of 200 mm with a roof round the origin, whose door of a width (m) faces the x axis."""
    z, jamb = GROUND + height / 2, 0.1 - door / 2
    return (
        TABLE,
        box("back", (0.02, 0.24, height), (-0.11, 0, z)),
        *(box(f"side{s}", (0.2, 0.02, height), (0, s * 0.11, z)) for s in (-1, 1)),
        *(box(f"jamb{s}", (0.02, jamb + 0.02, height), (0.11, s * (door + jamb + 0.02) / 2, z)) for s in (-1, 1)),
        box("roof", (0.24, 0.24, 0.02), (0, 0, GROUND + height + 0.01)),
    )


def cube(*size: float) -> Body:
    return box("cube", size or (SIDE,) * 3, (0, 0, 0), kind=BodyKind.MOVABLE)


def proof(body: Body, around: tuple[Body, ...], start=INSIDE, goal=OUTSIDE) -> Enclosure | None:
    return enclosure(body.name, body_set(body), ObstacleShapes.of(around), start, goal)


@pytest.mark.parametrize("ends", [(INSIDE, OUTSIDE), (OUTSIDE, INSIDE)])
@pytest.mark.parametrize("door", [0.02, 0.035, 0.0425])
def test_a_door_that_is_too_narrow_is_proven_and_measured(door, ends):
    found = proof(cube(), room(door), *ends)
    assert found is not None
    assert found.ball == pytest.approx(SIDE, abs=1e-6)
    assert found.widest == pytest.approx(door, abs=0.002)
    assert set(found.between) == {"jamb-1", "jamb1"}
    assert "'cube' is 50 mm thick" in str(found) and "`removable`" in str(found)


@pytest.mark.parametrize("door", [0.0491, 0.051, 0.06, 0.15])
def test_a_door_that_lets_the_body_through_is_no_enclosure(door):
    assert proof(cube(), room(door)) is None


def test_what_is_thin_in_one_direction_passes():
    plate, ends = cube(0.02, 0.05, 0.08), [pose((x, 0.0, GROUND + 0.041)) for x in (0.0, 0.4)]
    assert proof(plate, room(0.022), *ends) is None
    assert proof(plate, room(0.012), *ends) is not None


def test_a_way_over_the_wall_is_no_enclosure():
    assert proof(cube(), room(0.02)[:-1]) is None  # without the roof
    assert proof(cube(), room(0.02)[2:]) is None  # neither back nor table


def test_a_room_without_a_gap_names_its_walls():
    found = proof(cube(), room(0.0))
    assert found is not None and found.widest == 0.0
    assert {"table", "roof", "back"} & set(found.between) and "leave no gap" in str(found)


def test_a_path_is_refused_after_few_motions_with_the_width():
    problem = ObjectPathProblem(cube(), INSIDE, OUTSIDE, room(0.035))
    with pytest.raises(NoObjectPath, match="proven.*about 3[3-7] mm wide, between 'jamb.*50 mm thick") as error:
        plan_waypoints(problem, np.random.default_rng(0), 60.0, 200_000)
    assert error.value.proven


def test_a_removable_body_in_the_door_is_the_answer_and_not_the_proof():
    plug = box("plug", (0.02, 0.06, 0.08), (0.135, 0, GROUND + 0.04), kind=BodyKind.MOVABLE)
    around = (*room(0.07), plug, box("lid", (0.06, 0.1, 0.02), (0.15, 0, GROUND + 0.11)))
    problem = ObjectPathProblem(cube(), INSIDE, OUTSIDE, around, removable=frozenset({"plug"}))
    with pytest.raises(NoObjectPath) as error:
        plan_waypoints(problem, np.random.default_rng(0), 60.0, 200_000)
    assert error.value.free_without == ("plug",) and not error.value.proven


@pytest.mark.parametrize(
    "shape, radius",
    [
        (Shape(ShapeKind.BOX, (0.2, 0.05, 0.3), from_rpy((0.1, 0, 0), (0.3, 0.2, 0.1))), 0.025),
        (Shape(ShapeKind.CYLINDER, (0.03, 0.2)), 0.03),
        (Shape(ShapeKind.SPHERE, (0.03,), pose((0.1, 0.2, 0.3))), 0.03),
        (Shape(ShapeKind.CAPSULE, (0.02, 0.2)), 0.02),
    ],
)
def test_the_ball_inside_a_shape(shape, radius):
    small = Shape(ShapeKind.BOX, (0.01, 0.01, 0.01))
    centre, found = inner_ball(convex_set((small, shape)))
    assert 0.95 * radius < found <= radius + 1e-9
    assert np.abs(centre - shape.pose[:3]).max() < 0.16  # inside
