"""Scenes of hundreds of bodies: what is left out is out of reach or out of sight."""

from dataclasses import replace

import numpy as np
import pytest
from geometry_fixtures import box
from many_parts_fixtures import ends_within, parts, random_pose
from simulation_fixtures import HOME
from simulation_fixtures import scene as scene_of

from hmap_core import planner
from hmap_core.benchmark import many_parts
from hmap_core.collision.boxes import near_path
from hmap_core.collision.convex import convex_set, from_hulls, hull_vertices, set_distance
from hmap_core.exceptions import Code, MotionError
from hmap_core.komo import clearances, surroundings
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.shapes import posed_links
from hmap_core.komo.workspace import Workspace
from hmap_core.planner import sampled_contacts
from hmap_core.planner.nearby_shapes import box_of, shapes_in_box
from hmap_core.scenes import load_scene
from hmap_core.transforms import IDENTITY, apply, from_rpy, interpolate, pose
from hmap_core.types import Body, BodyKind, ContactKind, ContactPoint, Shape, ShapeKind

FAR = tuple(box(f"far{k}", (0.3, 0.3, 0.3), (4.0 + 0.4 * k, -3.0, 0.5)) for k in range(60))


def with_bodies(scene, bodies):
    return replace(scene, bodies=scene.bodies | {body.name: body for body in bodies})


def pairs_of(scene, robot):
    """Names of link and body of each pair of a moving arm with what stands around."""
    model = Workspace(scene, robots=[robot]).surroundings(frozenset(), ((robot, ((0.0, 1),)),)).model
    names = [(model.names[a], model.names[b]) for a, b, *_ in model.pairs]
    return [(link, body) for link, body in names if body in scene.bodies]


@pytest.mark.parametrize("task", ["tunnel", "bookshelf"])
def test_an_arm_has_a_pair_with_everything_that_a_link_can_touch(task):
    """Wherever its joints are."""
    scene = load_scene(task, 0)
    name, robot = next(iter(scene.robots.items()))
    rng = np.random.default_rng(0)
    lower, upper = robot.model.position_limits
    touched, bodies = set(), []
    for _ in range(5):
        for link, vertices, *_ in posed_links(robot, rng.uniform(lower, upper), 0.0):
            bodies.append(box(f"b{len(bodies)}", (0.02, 0.02, 0.02), vertices[0]))
            touched.add((f"{name}/{link}", bodies[-1].name))
    found = set(pairs_of(with_bodies(scene, bodies), name))
    fixed = {link for link, _ in touched} - {link for link, _ in found}
    assert len(fixed) <= 1  # the base, which does not move
    assert {pair for pair in touched if pair[0] not in fixed} <= found


def test_what_no_arm_can_reach_is_no_pair():
    scene = load_scene("tunnel", 0)
    name = next(iter(scene.robots))
    assert pairs_of(with_bodies(scene, FAR), name) == pairs_of(scene, name)


def test_shapes_that_reach_into_a_box_are_kept():
    rng = np.random.default_rng(0)
    scene = [(parts(f"p{k}", 20, rng, 0.5), random_pose(rng, 0.5)) for k in range(10)]
    corners = np.array([[-0.2, -0.1, -0.3], [0.3, 0.2, 0.1]])
    kept = {body.name: body.shapes for body, _ in shapes_in_box(scene, corners)}
    left_out = 0
    for body, T in scene:
        for shape in body.shapes:
            vertices, radius = hull_vertices(shape)
            points = apply(T, vertices)
            inside = np.any(np.all((points > corners[0] - radius) & (points < corners[1] + radius), axis=1))
            present = any(shape is other for other in kept.get(body.name, ()))
            assert present or not inside
            left_out += not present
        low, high = box_of(body, T)
        assert np.all(points > low - radius) and np.all(points < high + radius)
    assert left_out > 50


def test_the_plan_is_the_same_as_with_all_of_them(monkeypatch):
    scene = with_bodies(load_scene("published/bolt", 0), FAR)
    plan = planner.plan(scene, seed=0, time_limit=120.0)
    monkeypatch.setattr(surroundings, "BEYOND_REACH", 1e9)
    monkeypatch.setattr(sampled_contacts, "shapes_in_box", lambda bodies, corners: list(bodies))
    every = planner.plan(scene, seed=0, time_limit=120.0)
    for robot, joints in every.trajectory.joints.items():
        np.testing.assert_array_equal(plan.trajectory.joints[robot], joints)


def test_pairs_along_a_path_are_all_that_come_near():
    rng = np.random.default_rng(3)
    body, around = (
        convex_set(parts(name, count, rng, room).shapes) for name, count, room in (("a", 12, 0.1), ("b", 80, 1))
    )
    ends = [random_pose(rng, 0.8) for _ in range(6)]
    path = np.concatenate([interpolate(a, b, np.linspace(0, 1, 30)) for a, b in zip(ends, ends[1:], strict=False)])
    reach, kept = 0.03, {tuple(pair) for pair in near_path(body, path, around, 0.03).tolist()}
    near = 0
    for i, j in np.ndindex(len(body), len(around)):
        A, B = from_hulls([(body.hull(i), body.radius[i])]), from_hulls([(around.hull(j), around.radius[j])])
        if min(set_distance(A, T, B, IDENTITY, reach) for T in path[::3]) < reach:
            assert (i, j) in kept
            near += 1
    assert 8 < near <= len(kept) < 0.7 * len(body) * len(around)


@pytest.mark.parametrize("verified", [True, False])
def test_carried_bodies_of_many_parts_keep_from_what_is_near_their_path(verified, monkeypatch):
    scene = many_parts.carried(30, 60, 0)
    start, goal = scene.bodies["brick"].pose, scene.goal.pose
    up = np.array([0, 0, 0.2, 0, 0, 0, 0])
    corners = (start, start + up, goal + up, goal)
    path = np.concatenate(
        [interpolate(a, b, np.linspace(0, 1, 12)) for a, b in zip(corners, corners[1:], strict=False)]
    )
    down, up_axis = pose((0, 0, 0.05), (1, 0, 0, 0)), np.array([0.0, 0.0, 1.0])
    contact = ContactPoint(ContactKind.GRASP, down, np.zeros(3), np.array([1.0, 0.0, 0.0]), 0.05, up_axis)
    task = Manipulation(scene, scene.start_state(), "arm", "brick")
    every = set(task.collisions(contact, start, goal).pairs)
    monkeypatch.setattr(clearances, "MANY_PAIRS", 0 if verified else 1e9)
    some = set(task.collisions(contact, start, goal, path).pairs)
    assert some <= every and {pair for pair in every - some if pair[3] != clearances.VERIFIED_ONLY} == set()
    assert (len(some) < len(every)) == verified


def divided(count: int, rng):
    """An arm among ``count`` small boxes, none of them where it stands and where it is to go, and a wall between."""
    home, goal = HOME, HOME + np.array([2.0, 0, 0, 0, 0, 0, 0])
    robot = scene_of().robots["left"]
    kept = np.concatenate([vertices for q in (home, goal) for _, vertices, *_ in posed_links(robot, q, 0.08)])
    shapes = []
    while len(shapes) < count:
        at = rng.uniform([-0.9, -0.9, 0.02], [0.9, 0.9, 1.1])
        if np.linalg.norm(at[:2]) > 0.25 and np.linalg.norm(kept - at, axis=1).min() > 0.08:
            shapes.append(Shape(ShapeKind.BOX, tuple(rng.uniform(0.005, 0.02, 3)), pose(at, rng.standard_normal(4))))
    walls = []
    for near, low in ((0.16, 0.0), (0.12, 0.45), (0.0, 0.8)):
        middle, extent = 0.5 * (near + 2.0), (2.0 - near, 0.02, 2.0 - low)
        at = (middle * np.cos(1.0), middle * np.sin(1.0), 0.5 * (low + 2.0))
        walls.append(replace(box(f"wall{len(walls)}", extent, (0, 0, 0)), pose=from_rpy(at, (0.0, 0.0, 1.0))))
    return scene_of(Body("clutter", BodyKind.FIXED, tuple(shapes), pose()), *walls), goal


@pytest.mark.parametrize("limit", [0.5, 1.5])
def test_motions_of_an_arm_among_many_parts_keep_their_time_limit(limit):
    rng = np.random.default_rng(0)
    world, goal = divided(1000, rng)

    def search():
        with pytest.raises(MotionError) as error:
            planner.plan_motion(world, "left", q=goal, time_limit=limit)
        assert error.value.code == Code.NO_MOTION

    assert ends_within(1.1 * limit, search)
