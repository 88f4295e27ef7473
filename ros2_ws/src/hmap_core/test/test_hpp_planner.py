"""HPP's manipulation planner as a method on the tasks; a program of a few lines stands in for its process."""

import json
import os
import sys
from xml.etree import ElementTree

import numpy as np
import pytest

from hmap_core.baselines.given_moves import given_moves
from hmap_core.baselines.restarts import new_job
from hmap_core.benchmark import hpp_planner
from hmap_core.benchmark.hpp_planner import HppManipulation, check_stated, drawn_contacts, problem, urdf
from hmap_core.cli.bench_table import planner_names
from hmap_core.exceptions import Code, InputError, PlannerError
from hmap_core.plan_file import to_dict
from hmap_core.planner import plugins
from hmap_core.scenes import load_scene
from hmap_core.validation import check

TASK = "published/puck_around"
HPP = os.environ.get(hpp_planner.PYTHON)


@pytest.fixture
def stand_in(monkeypatch, tmp_path):
    """Makes a program the process of HPP."""

    def make(program: str) -> None:
        side = tmp_path / "side.py"
        side.write_text(program)
        monkeypatch.setattr(hpp_planner, "SIDE", side)
        monkeypatch.setattr(hpp_planner, "hpp_python", lambda: sys.executable)

    return make


def job_of(task: str, seed: int = 0):
    return new_job("hpp_manipulation", load_scene(task, seed), None, seed, 60.0, None, None)


@pytest.mark.parametrize("python", ["", "/nowhere/bin/python", sys.executable])
def test_without_hpp_the_method_is_refused_and_left_out_of_a_table(monkeypatch, capsys, python):
    monkeypatch.setenv(hpp_planner.PYTHON, python)
    with pytest.raises(InputError, match="make bench-peers.*HMAP_HPP_PYTHON"):
        plugins.create(plugins.PLANNERS, "hpp_manipulation")
    assert "hpp_manipulation" not in planner_names([])
    assert "without hpp_manipulation: HPP is needed" in capsys.readouterr().err


@pytest.mark.parametrize("task, reason", [("bolt", "lifts or turns over 'bolt'"), ("bookshelf", "lifts or turns")])
def test_a_task_that_it_cannot_state_is_refused_with_the_reason(stand_in, task, reason):
    stand_in("")
    with pytest.raises(InputError, match=reason) as error:
        HppManipulation().plan(load_scene(f"published/{task}", 0))
    assert error.value.code is Code.UNKNOWN_TASK


@pytest.mark.parametrize("task", ["puck_around", "puck_move", "tunnel"])
def test_planar_tasks_are_stated(task):
    job = job_of(f"published/{task}")
    check_stated(job.scene, job.start, given_moves(job.scene))


def test_the_problem_has_the_bodies_the_contacts_and_the_goal():
    job = job_of(TASK)
    moves = given_moves(job.scene)
    contacts = drawn_contacts(job, moves)
    task = problem(job, moves, contacts, 5.0)
    assert set(task["fixed"]) == set(job.scene.bodies) - {"puck"} and list(task["objects"]) == ["puck"]
    puck = task["objects"]["puck"]
    assert puck["goal"] == moves[-1].T_end.tolist() and puck["start"] == job.start.poses["puck"].tolist()
    assert 1 <= len(puck["contacts"]) <= hpp_planner.CONTACTS
    assert len({round(contact.opening, 4) for contact in contacts["puck"]}) == 1
    assert all(np.linalg.norm(own["approach"]) == pytest.approx(1.0) for own in puck["contacts"])
    assert json.loads(json.dumps(task)) == task


def test_moved_objects_are_smaller_and_fixed_bodies_wider_but_not_higher():
    bodies = job_of(TASK).scene.bodies
    (cylinder,) = ElementTree.fromstring(urdf(bodies["puck"], -hpp_planner.SMALLER)).iter("cylinder")
    assert float(cylinder.get("radius")) == pytest.approx(0.03 - hpp_planner.SMALLER)
    assert float(cylinder.get("length")) == pytest.approx(0.02 - 2 * hpp_planner.SMALLER)
    (box,) = ElementTree.fromstring(urdf(bodies["obstacle"], hpp_planner.WIDER)).iter("box")
    assert [float(v) for v in box.get("size").split()] == pytest.approx([0.154, 0.254, 0.1])


PATH = """
import json, sys
task = json.load(sys.stdin)
puck, q = task["objects"]["puck"], task["q"]
moved = [puck["start"], [puck["start"][0] + 0.05, *puck["start"][1:]]]
touched = [v + 0.1 for v in q]
def part(a, b, poses):
    return {"q": [a, b], "poses": {"puck": poses}}
parts = [
    part(q, touched, [moved[0]] * 2),
    part(touched, touched, [moved[0]] * 2),
    part(touched, [v + 0.1 for v in touched], moved),
    part([v + 0.1 for v in touched], touched, [moved[1]] * 2),
    part(touched, q, [moved[1]] * 2),
]
print(json.dumps({"solved": True, "parts": parts}))
"""


def test_the_parts_of_a_path_become_motions_to_a_contact_with_the_object_and_away(stand_in):
    stand_in(PATH)
    job = job_of(TASK)
    method, moves = HppManipulation(), given_moves(job.scene)
    found = method._one_try(job, moves)
    kinds = [segment.kind.value for motion in found for segment in motion.segments]
    assert len(kinds) == 3 and kinds[0] == kinds[2] == "transit" and kinds[1] != "transit"
    q = job.start.q["panda"]
    assert found[0].trajectory.joints["panda"][[0, -1]] == pytest.approx(np.array([q, q + 0.1]), abs=1e-6)
    assert found[1].trajectory.joints["panda"][-1] == pytest.approx(q + 0.2, abs=1e-6)
    assert found[2].trajectory.joints["panda"][-1] == pytest.approx(q, abs=1e-6)


@pytest.mark.parametrize(
    ("program", "why"),
    [
        ("import sys; sys.exit('no library')", "last: HPP ended without an answer: no library"),
        ("""print('{"solved": false, "reason": "no path"}')""", "last: HPP: no path"),
        ("import time; time.sleep(60)", "no plan in time"),
    ],
)
def test_a_process_that_fails_or_hangs_ends_with_the_time(stand_in, program, why):
    stand_in(program)
    with pytest.raises(PlannerError, match=why) as error:
        HppManipulation().plan(load_scene(TASK, 0), time_limit=4.0)
    assert error.value.code is Code.TIME_LIMIT


@pytest.mark.slow
@pytest.mark.skipif(not HPP, reason=f"{hpp_planner.PYTHON} is not set: HPP has an environment of its own")
def test_hpp_solves_a_task():
    plan = HppManipulation().plan(load_scene(TASK, seed=0), seed=0, time_limit=120.0)
    assert check(to_dict(plan)).valid
