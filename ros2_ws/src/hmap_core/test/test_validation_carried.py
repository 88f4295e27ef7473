"""The judge's bound on how a body moves against a link: never too small, and small where the link carries the body."""

import numpy as np
import pytest
from replan_fixtures import brick_plan

from hmap_core.plan_file import to_dict
from hmap_core.planner.interruption import contacts
from hmap_core.validation import document, rigid
from hmap_core.validation.world import World

FINE = 32  # pieces of a step
STRIDE = 40  # samples between the steps that are looked at


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    return brick_plan(tmp_path_factory)


@pytest.fixture(scope="module")
def world(plan):
    return World(document.read(to_dict(plan)))


def travelled(world, link, body, step):
    """How far (m) the points of a body's part move in a step, as seen from a link, in many small pieces."""
    state = world.between(np.full(FINE + 1, step), np.arange(FINE + 1) / FINE)
    R, p = rigid.relative(*state.links[link.holder][link.link], *state.bodies[body.holder])
    points = body.solid.points @ body.R.T + body.p
    seen = np.einsum("nij,vj->nvi", R, points) + p[:, None]
    return np.linalg.norm(np.diff(seen, axis=0), axis=2).sum(axis=0).max()


@pytest.mark.parametrize("name", ["panda_hand", "panda_leftfinger", "panda_link3", "panda_link0"])
def test_no_point_moves_farther_than_the_bound(world, name):
    (body,) = world.parts_of("brick")
    link = world.parts_of("arm", (name,))[0]
    bound = world.relative_motion(link, body).speed
    for step in range(0, world.samples - 1, STRIDE):
        assert travelled(world, link, body, step) <= bound[step] + 1e-12


def test_what_is_carried_hardly_moves_against_the_hand(plan, world):
    made = contacts(plan)[0]
    (body,) = world.parts_of("brick")
    hand = world.parts_of("arm", ("panda_hand",))[0]
    rows = slice(made.begin, made.end)
    apart = (world.motion(body).speed(body.reach) + world.motion(hand).speed(hand.reach))[rows]
    assert world.relative_motion(hand, body).speed[rows].max() < 0.25 * apart.max()
