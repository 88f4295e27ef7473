"""Which of the feasible contacts comes first: one that ends a little before the path's end does not."""

from collections.abc import Sequence

import numpy as np
import pytest
from planner_fixtures import carry

from hmap_core.exceptions import ContactError
from hmap_core.planner.contact_finder import ProposeAndCheck
from hmap_core.planner.interfaces import RobotContact
from hmap_core.planner.protocols import ContactProposals, ContactQuery, ContactSearchQuery
from hmap_core.transforms import pose
from hmap_core.types import ContactKind, ContactPoint

COUNT = 21
POSES = np.array([pose((0.5, 0.01 * k, 0.04)) for k in range(COUNT)])
HOME = np.array([0.0, 0.0, 0.0, -1.6, 0.0, 1.6, 0.8])


def contact(reach: int) -> ContactPoint:
    """A contact whose opening says how far it serves."""
    T = pose((0.0, 0.0, 0.03))
    return ContactPoint(ContactKind.GRASP, T, np.zeros(3), np.array([0.0, 1.0, 0.0]), 1e-3 * reach, -T[:3])


class Given:
    """Proposes batches of contacts that are known to serve for some poses, and checks them."""

    def __init__(self, *batches: Sequence[int]):
        self.batches, self.asked = batches, 0

    def propose(self, query: ContactQuery):
        for batch in self.batches:
            self.asked += 1
            yield ContactProposals(tuple(contact(reach) for reach in batch))

    def check(self, query: ContactQuery, contacts: Sequence[ContactPoint], beyond: int = -1) -> list[RobotContact]:
        reach = [round(1e3 * one.opening) for one in contacts]
        turned = [HOME + [0.15 * far, 0, 0, 0, 0, 0, 0] for far in reach]  # farther ones are farther from the arm
        return [
            RobotContact(query.robot, one, far, np.tile(q, (far + 1, 1)))
            for one, far, q in zip(contacts, reach, turned, strict=True)
            if far > beyond
        ]


def found(tmp_path, *batches: Sequence[int], min_reach: int = 0) -> tuple[list[int], int]:
    """How far the contacts serve that are found, the first one first, and how many batches were looked at."""
    scene, given = carry(tmp_path), Given(*batches)
    state = scene.start_state()
    query = ContactSearchQuery(scene, state, "brick", POSES, ("arm",), min_reach=min_reach)
    return [one.reach for one in ProposeAndCheck([given], given).find_contacts(query)], given.asked


@pytest.mark.parametrize(
    ("batches", "first"),
    [
        ([[18], [19], [], [20]], 20),  # 2 cm and 1 cm before the end, and to the end, after an empty batch
        ([[18, 20]], 20),
        ([[2], [12]], 12),  # 2 cm from the start
        ([[18], [19]], 19),  # nothing serves farther
        ([[12], [20]], 12),  # leaves 8 cm for another contact: the first batch is enough
    ],
)
def test_an_object_is_not_let_go_just_before_its_goal(tmp_path, batches, first):
    reach, asked = found(tmp_path, *batches)
    assert reach[0] == first
    assert asked == (1 if len(batches) == 1 or batches[0] == [12] else len(batches))


def test_contacts_that_serve_for_too_few_poses_are_passed_over(tmp_path):
    assert found(tmp_path, [2], [12], [5], min_reach=8) == ([12], 2)
    assert found(tmp_path, [2], [], [8], min_reach=8) == ([8], 3)
    with pytest.raises(ContactError):
        found(tmp_path, [2], [7], min_reach=8)
