"""CMGMP: contact modes, balance of forces, contact points, demonstrations, and the contract of methods."""

import numpy as np
import pytest

from hmap_core import planner
from hmap_core.baselines.cmgmp.demonstrations import box, demonstrations, pick_card, push_along_walls, solve
from hmap_core.baselines.cmgmp.forces import Balance
from hmap_core.baselines.cmgmp.modes import Enumeration
from hmap_core.baselines.cmgmp.polyhedra import polyhedron
from hmap_core.baselines.cmgmp.problem import ObjectProblem
from hmap_core.exceptions import Code, InputError, PlannerError
from hmap_core.scenes import load_scene
from hmap_core.transforms import from_rpy, pose

CUBE = 0.2  # m


def cube_problem(T: np.ndarray, *obstacles) -> ObjectProblem:
    floor = box((2, 2, 1), (0, 0, -0.5))
    return ObjectProblem("cube", [box([CUBE] * 3)], [floor, *obstacles], T, T, 0.5, 0.5, 1.0, np.zeros(3), np.ones(3))


def test_the_hull_of_a_box_has_its_planes_and_edges():
    found = polyhedron(np.random.default_rng(0).permutation(box((1, 2, 3)).vertices))
    assert (len(found.vertices), len(found.normals), len(found.edges), len(found.directions)) == (8, 6, 12, 3)


def test_a_cube_on_the_floor_touches_it_with_its_corners():
    problem = cube_problem(pose((0, 0, 0.1)))
    touching = problem.contacts(problem.start)
    assert len(touching.contacts) == 4 and touching.gap == pytest.approx(0.0, abs=1e-12)
    assert all(np.allclose(c.normal, [0, 0, 1]) and c.point[2] == pytest.approx(-0.1) for c in touching.contacts)


def test_a_cube_over_an_edge_touches_it_where_edges_cross():
    problem = cube_problem(pose((1.0, 0, 0.1)))  # the floor ends at x = 1
    points = np.array([c.point for c in problem.contacts(problem.start).contacts])
    assert sorted(points[:, 0].round(6)) == [-0.1, -0.1, 0.0, 0.0]


def test_a_cube_that_leaves_the_floor_touches_nothing():
    problem = cube_problem(pose((0, 0, 0.1)))
    assert problem.contacts(pose((0, 0, 0.11))).contacts == []
    assert problem.contacts(from_rpy((0, 0, 0.1), (0.3, 0, 0))).gap < -problem.tolerance


@pytest.mark.parametrize(
    ("wall", "modes"),
    [(False, 10), (True, 46)],  # all, 4 edges, 4 corners, none; at a wall, too
)
def test_modes_are_the_faces_of_the_cone_of_twists(wall, modes):
    around = [box((1, 2, 2), (-0.6, 0, 0))] if wall else []
    problem = cube_problem(pose((0, 0, 0.1)), *around)
    found = Enumeration(problem.size).modes(problem.contacts(problem.start).contacts)
    assert len(found) == modes


def test_friction_decides_which_pushes_balance():
    problem = cube_problem(pose((0, 0, 0.1)))
    contacts = problem.contacts(problem.start).contacts
    balance, kept = Balance(problem), np.ones(4, bool)
    sliding = balance.obstacles(contacts, kept, np.array([1.0, 0, 0, 0, 0, 0]), False)
    gravity = balance.gravity(problem.start)
    behind = balance.fingers(np.array([[-0.1, 0, -0.05]]), np.array([[-1.0, 0, 0]]))
    beside = balance.fingers(np.array([[-0.1, 0.09, -0.05]]), np.array([[-1.0, 0, 0]]))
    above = balance.fingers(np.array([[0, 0, 0.1]]), np.array([[0, 0, 1.0]]))
    pushed, turned, dragged = (np.concatenate([own, sliding], axis=1) for own in (behind, beside, above))
    assert balance.holds(pushed, gravity) and balance.forces(pushed, gravity) is not None
    assert not balance.holds(turned, gravity) and balance.forces(turned, gravity) is None
    assert not balance.holds(dragged, gravity)  # a finger from above presses as much as it drags


@pytest.mark.parametrize(("make", "seed"), [(push_along_walls, 2), (pick_card, 5)])
def test_demonstrations_are_solved(make, seed):
    assert solve(make(), seed, 20.0)[0]


def test_unknown_demonstrations_are_refused():
    with pytest.raises(InputError, match="push_along_walls"):
        demonstrations(["fly"])


@pytest.mark.parametrize(
    ("options", "code"), [({"time_limit": 1e-3}, Code.TIME_LIMIT), ({"cancel": lambda: True}, Code.CANCELED)]
)
def test_a_task_ends_with_a_reason(options, code):
    with pytest.raises(PlannerError) as failure:
        planner.plan(load_scene("published/puck_around", 0), planner="cmgmp", **options)
    assert failure.value.code is code
