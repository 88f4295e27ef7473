"""The result of ``manipulate`` says what was tried when there is no plan."""

import json
from types import SimpleNamespace

import pytest

from hmap.nodes.supervisor import Supervisor
from hmap_core.exceptions import Code, ContactError
from hmap_msgs.action import Manipulate

SEARCH = {"what": "task", "solved": False, "tried": [{"what": "round 1", "solved": False, "code": "NO_CONTACT"}]}


def test_a_failed_job_carries_its_search_tree():
    def plan(*_, **__):
        error = ContactError("none", Code.NO_CONTACT)
        error.search = SEARCH
        raise error

    node = SimpleNamespace(
        _scene_monitor=SimpleNamespace(clouds=dict),
        _method=lambda *_: SimpleNamespace(plan=plan),
        _canceled=lambda job: False,
    )
    job = SimpleNamespace(plans=0, goal=SimpleNamespace(seed=0), result=Manipulate.Result())
    request = SimpleNamespace(scene=None, state=None, blocked=None, tools=())
    with pytest.raises(ContactError):
        Supervisor._plan(node, job, request, 10.0)
    (entry,) = [entry for entry in job.result.statistics if entry.key == "search"]
    assert json.loads(entry.value) == SEARCH
