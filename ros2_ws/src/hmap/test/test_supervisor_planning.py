"""A plan after a body came in the way: at once, else once the bodies have moved on."""

from types import SimpleNamespace

import pytest

from hmap.nodes.supervisor import Supervisor
from hmap_core.exceptions import Code, ContactError, HmapError, PlannerError

OLD = ("an old plan", 1.0)


def supervisor(answers, moves: list[bool]):
    """Stands in for the node: plans as ``answers`` say, and bodies that move on as ``moves`` say."""
    asked = []

    def plan_once(job, scene, follower, limit, old):
        asked.append(old)
        answer = answers.pop(0)
        if isinstance(answer, HmapError):
            raise answer
        return answer

    scene_monitor = SimpleNamespace(changed=lambda: 0.0)
    node = SimpleNamespace(_scene_monitor=scene_monitor, _plan_once=plan_once, _move_on=lambda *_: moves.pop(0))
    return node, asked


def plan(node, old=OLD):
    return Supervisor._plan(node, None, None, None, 10.0, old)


def no_contact() -> ContactError:
    return ContactError("none", Code.NO_CONTACT)


def test_where_there_is_no_plan_the_bodies_have_to_move():
    node, asked = supervisor([no_contact(), no_contact(), "plan"], [True, True])
    assert plan(node) == "plan"
    assert asked == [OLD, OLD, OLD]


def test_bodies_that_do_not_move_on_leave_the_error():
    node, asked = supervisor([no_contact()], [False])
    with pytest.raises(ContactError):
        plan(node)
    assert asked == [OLD]


@pytest.mark.parametrize(
    ("error", "old"), [(PlannerError("canceled", Code.CANCELED), OLD), (no_contact(), None)], ids=["cancel", "no body"]
)
def test_other_errors_are_the_answer_at_once(error, old):
    node, asked = supervisor([error], [])
    with pytest.raises(HmapError):
        plan(node, old)
    assert asked == [old]
