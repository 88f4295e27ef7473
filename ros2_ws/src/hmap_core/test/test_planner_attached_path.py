"""Paths sought for an object and the hand that holds it: past a bar under which the object fits, but not the hand."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from planner_fixtures import carry

from hmap_core.exceptions import Code, ContactError
from hmap_core.komo.shapes import body_set
from hmap_core.planner import ContactSearchQuery, ObjectPathQuery, local_components
from hmap_core.planner.attached_path import attached_paths, with_hand
from hmap_core.planner.conflicts import object_clearances
from hmap_core.planner.contact_filters import AttachedPathContact, NoToolGrasps
from hmap_core.planner.end_contacts import EndContacts
from hmap_core.planner.interfaces import AttachedPath
from hmap_core.planner.protocols import ContactProposals
from hmap_core.planner.sampled_contacts import SampledContacts
from hmap_core.transforms import multiply, pose
from hmap_core.types import Body, BodyKind, ContactKind, Shape, ShapeKind
from hmap_core.waypoints import NoObjectPath

PARTS = local_components()
UNDER_BAR = 0.19  # m, height of the bar's lower side


def box(name: str, size, position, kind=BodyKind.FIXED) -> Body:
    return Body(name, kind, (Shape(ShapeKind.BOX, size),), pose(position))


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A brick to be carried over a low wall, and a bar over that: between them is room for the brick."""
    scene = carry(tmp_path_factory.mktemp("bar"), motion="spatial")
    bar = box("bar", (0.3, 0.03, 0.03), (0.5, 0.0, UNDER_BAR + 0.015))
    return replace(scene, bodies=scene.bodies | {"bar": bar})


@pytest.fixture(scope="module")
def hands(scene):
    found = PARTS.end_contacts.find(scene, scene.start_state(), "brick", scene.goal.pose, "arm", count=3, seed=0)
    return [("arm", contact) for contact in found]


class Late:
    """Proposes what is sampled after an empty batch."""

    def propose(self, query):
        yield ContactProposals(())
        yield from SampledContacts().propose(query)


def test_what_comes_after_an_empty_batch_is_looked_at_to_the_end_only(scene):
    ends = EndContacts(Late())
    search = scene, scene.start_state(), "brick", scene.goal.pose, "arm", 1, 0
    assert len(ends.find(*search)) == 1 and ends.find(*search, to_the_end=False) == []


def paths(scene, hands, **changes):
    scene = replace(scene, **changes)
    rng = np.random.default_rng(0)
    return list(attached_paths(PARTS.object_path, scene, scene.start_state(), scene.goal, hands, rng, 10.0))


def test_the_hand_goes_with_the_object_past_what_stands_around(scene, hands):
    alone = PARTS.object_path.plan_path(ObjectPathQuery(scene, scene.start_state(), scene.goal, 0, 10.0)).poses
    found = paths(scene, hands)
    assert found and alone[:, 2].max() < UNDER_BAR
    for path in found:
        np.testing.assert_allclose(path.poses[[0, -1]], alone[[0, -1]], atol=1e-9)
        joined = body_set(with_hand(scene.bodies["brick"], scene.robots["arm"], path.contact))
        for name in ("bar", "wall", "table"):
            assert object_clearances(joined, path.poses, scene.bodies[name]).min() > -1e-3
        assert object_clearances(joined, alone, scene.bodies["bar"]).min() < -0.01


def returned(scene, path, poses):
    query = ContactSearchQuery(scene, scene.start_state(), "brick", poses)
    return AttachedPathContact(PARTS.checker, path).find_contacts(query)


def test_an_arm_follows_one_of_them_to_the_end(scene, hands):
    reached = []
    for path in paths(scene, hands):
        try:
            reached += [contact.reach - len(path.poses) + 1 for contact in returned(scene, path, path.poses)]
        except ContactError:
            continue
    assert reached and not any(reached)


def test_a_contact_that_does_not_cover_the_path_is_not_returned(scene, hands):
    path = paths(scene, hands)[0]
    far = np.concatenate([path.poses, path.poses[-1:] + np.array([[3.0, 0, 0, 0, 0, 0, 0]])])
    with pytest.raises(ContactError, match="does not carry 'brick' all the way") as error:
        returned(scene, path, far)
    assert error.value.code == Code.NO_CONTACT


def test_a_contact_is_returned_once_for_a_path(scene, hands):
    contact = hands[0][1]
    checker = SimpleNamespace(check=lambda *_: [SimpleNamespace(reach=1)])
    query = ContactSearchQuery(scene, scene.start_state(), "brick", np.tile(pose(), (2, 1)))
    poses = np.tile(pose(), (2, 1))
    finder = AttachedPathContact(checker, AttachedPath("brick", poses, "arm", contact))
    assert finder.find_contacts(query)
    with pytest.raises(ContactError):
        finder.find_contacts(query)
    assert finder.find_contacts(replace(query, object_poses=poses + 1e-3))
    assert NoToolGrasps().tool_grasps(scene, scene.start_state(), "brick", poses, 0, 1.0) == []


def test_contacts_at_both_ends_hold(scene, hands):
    assert hands
    assert all(contact.kind is ContactKind.GRASP for _, contact in hands)
    away = pose((3.0, 0.0, 0.5))
    assert PARTS.end_contacts.find(scene, scene.start_state(), "brick", away, "arm", 3, 0) == []


def test_removable_bodies_are_told_apart_from_others(scene, hands):
    free = np.tile(pose(), (2, 1))
    answers = [("lid",), SimpleNamespace(poses=free)], [None, None], [("lid",), None]

    def blocked(*request):
        raise NoObjectPath("closed", ("lid",), *answers[next(calls)])

    calls = iter(range(3))
    planner, rng = SimpleNamespace(plan_path=blocked), np.random.default_rng(0)
    found = list(attached_paths(planner, scene, scene.start_state(), scene.goal, hands[:1] * 3, rng, 10.0))
    assert [path.blockers for path in found] == [("lid",)]
    assert found[0].poses is free


def test_a_removable_body_where_the_hand_begins_blocks_the_path_and_ends_nothing(scene, hands):
    """The path leads as without the body, which is named."""
    robot, contact = hands[0]
    palm = multiply(multiply(scene.bodies["brick"].pose, contact.T_obj_ee), pose((0.0, 0.0, -0.06)))
    lamp = box("lamp", (0.01, 0.01, 0.01), palm[:3], BodyKind.MOVABLE)
    with_lamp = {"bodies": scene.bodies | {"lamp": lamp}, "removable": {"lamp": None}}
    (path,), (free,) = paths(scene, [(robot, contact)], **with_lamp), paths(scene, [(robot, contact)])
    assert path.blockers == ("lamp",) and free.blockers == ()
    np.testing.assert_array_equal(path.poses, free.poses)
