"""The result of ``manipulate`` says what was tried when there is no plan."""

import json
from types import SimpleNamespace

import pytest

from hmap.nodes.supervisor import Supervisor
from hmap_core.exceptions import Code, ContactError, InputError
from hmap_core.scenes import load_scene
from hmap_core.types import TaskMode
from hmap_msgs.action import Manipulate

SEARCH = {"what": "task", "solved": False, "tried": [{"what": "round 1", "solved": False, "code": "NO_CONTACT"}]}


def test_a_failed_job_carries_its_search_tree():
    def plan(*_, **__):
        error = ContactError("none", Code.NO_CONTACT)
        error.search = SEARCH
        raise error

    told = []
    node = SimpleNamespace(
        _plans=SimpleNamespace(search_ended=told.append),
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
    assert told == [SEARCH]


def supervisor_with(plan, alive: int = 0, dry_run: bool = False):
    """What a goal needs of the supervisor, which has planned, and the job."""
    scene = load_scene("tunnel", 0)
    node = SimpleNamespace(
        require_active=lambda: None,
        _others=SimpleNamespace(alive=alive),
        _time_limit=10.0,
        _state_patience=1.0,
        _goal_scene=lambda job: scene,
        _scene_monitor=SimpleNamespace(settled=lambda *_: None, changed=lambda: 0.0, scene=lambda: scene),
        _plan=lambda *_: plan,
        _operator=SimpleNamespace(dry_run=dry_run),
        _compare=lambda *_: None,
    )
    goal = SimpleNamespace(time_limit=0.0, plan_only=False)
    return node, SimpleNamespace(goal=goal, result=Manipulate.Result())


def test_a_kinematic_plan_is_refused_and_nothing_was_executed():
    plan = SimpleNamespace(scene=SimpleNamespace(mode=TaskMode.KINEMATIC, task="knob"))
    node, job = supervisor_with(plan)
    with pytest.raises(InputError, match="'knob' is kinematic"):
        Supervisor._manipulate(node, job)
    assert not job.result.executed


def test_goals_are_refused_while_two_supervisors_run():
    node, job = supervisor_with(None, alive=1)
    with pytest.raises(InputError, match="another supervisor runs on this cell already"):
        Supervisor._manipulate(node, job)
    assert not job.result.executed


def test_in_a_dry_run_a_plan_is_not_executed():
    goal = SimpleNamespace(object="box")
    scene = SimpleNamespace(mode=TaskMode.PHYSICAL, task="tunnel", goal=goal)
    plan = SimpleNamespace(scene=scene, trajectory=SimpleNamespace(objects={"box": [None]}))
    node, job = supervisor_with(plan, dry_run=True)
    Supervisor._manipulate(node, job)  # has neither controllers nor an executor
    assert not job.result.executed
