"""``hmap bench tasks``: trials that crash or hang lose nothing, the numbers, the files, and a real task."""

import json
import os
import select
import subprocess
import sys

import numpy as np
import pytest
from planner_fixtures import carry

from hmap_core.cli import main
from hmap_core.evaluation import run, summary, trials
from hmap_core.evaluation.isolated import Worker
from hmap_core.evaluation.trial import Trial, TrialResult
from hmap_core.exceptions import InputError, MotionError
from hmap_core.scenes import list_tasks

# Answers as the worker does; the seed says what happens.
STAND_IN = """
import json, os, sys
for line in sys.stdin:
    seed = json.loads(line)["seed"]
    if seed == 1:
        print("it broke here", file=sys.stderr, flush=True)
        os.abort()
    if seed == 2:
        sys.stdin.read()  # hangs: this never comes
    if seed == 3:
        sys.exit(5)
    result = {"seed": seed, "valid": True, "solved": True, "planning_s": 0.1 * seed, "cpu_s": float(os.getpid())}
    print(json.dumps(result), flush=True)
"""
COMMAND = (sys.executable, "-c", STAND_IN)
PARENT = """
import signal, subprocess, sys
worker = "from hmap_core.evaluation.worker import end_with_parent; end_with_parent()"
code = worker + "; import signal; print(flush=True); signal.pause()"
child = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
child.stdout.readline()
print(child.pid, flush=True)
signal.pause()
"""
KEYS = {"seed", "valid", "solved", "planning_s", "replans", "reason"}


def trial(seed: int = 0, task: str = "somewhere/bar.yaml") -> Trial:
    return Trial(task, seed, time_limit=20.0, max_replans=1)


@pytest.fixture
def worker():
    worker = Worker(COMMAND)
    yield worker
    worker.close()


def test_a_worker_does_one_trial_after_another_in_one_process(worker):
    first, second = worker.run(trial(4), 20.0), worker.run(trial(5), 20.0)
    assert (first.seed, second.seed) == (4, 5) and first.solved
    assert first.cpu_s == second.cpu_s  # the stand-in tells its process there


def test_a_worker_ends_with_the_process_that_started_it_in_the_middle_of_a_trial():
    with subprocess.Popen([sys.executable, "-c", PARENT], stdout=subprocess.PIPE) as parent:
        child = os.pidfd_open(int(parent.stdout.readline()))
        assert not select.select([child], [], [], 0.0)[0]
        parent.kill()
    assert select.select([child], [], [], 20.0)[0]
    os.close(child)


def test_a_crash_is_the_reason_of_its_trial_only(worker):
    crashed = worker.run(trial(1), 20.0)
    assert not crashed.valid and not crashed.solved and crashed.seed == 1
    assert "SIGABRT" in crashed.reason and "it broke here" in crashed.reason
    assert "exit code 5" in worker.run(trial(3), 20.0).reason
    assert worker.run(trial(6), 20.0).solved


def test_a_trial_that_hangs_is_ended_and_says_so(worker):
    hung = worker.run(trial(2), 0.5)
    assert not hung.solved and "0.5 s" in hung.reason
    assert worker.run(trial(7), 20.0).solved


@pytest.mark.parametrize("jobs", [1, 2])
def test_results_come_in_the_order_of_the_trials_whatever_happens(jobs):
    told = []
    wanted = [trial(seed) for seed in (0, 1, 3, 4, 5)]
    found = trials.run_trials(wanted, jobs, on_result=lambda t, r: told.append((t.seed, r.seed)), command=COMMAND)
    assert [(r.seed, r.solved) for r in found] == [(0, True), (1, False), (3, False), (4, True), (5, True)]
    assert sorted(told) == [(seed, seed) for seed in (0, 1, 3, 4, 5)]


def test_dask_that_is_not_there_is_bad_input(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match="pip install"):
        trials.run_trials([trial()], dask="tcp://127.0.0.1:1", command=COMMAND)


def test_what_fails_while_warming_up_does_not_count(monkeypatch):
    seeds = []

    def plan(scene, seed, time_limit):
        seeds.append((scene.seed, seed))
        raise ZeroDivisionError

    monkeypatch.setattr(run.planner, "plan", plan)
    run.warm_up(trial(3, task="tunnel"))
    assert seeds == [(run.WARM_UP_SEED + 3, run.WARM_UP_SEED + 3)]


def test_tasks_are_those_of_the_set():
    ours, published = trials.task_names(), trials.task_names(published=True)
    assert sorted(ours + published) == list_tasks(unsolvable=False)
    assert set(list_tasks()) - set(ours + published) == {"published/bookshelf_unchanged"}
    assert trials.task_names(["bookshelf_unchanged"], published=True) == ["published/bookshelf_unchanged"]
    assert published and all(task.startswith("published/") for task in published)
    assert trials.task_names(["tunnel", "my/task.yaml"], published=True) == ["published/tunnel", "my/task.yaml"]
    with pytest.raises(InputError, match="unknown published task 'tunel'. Known: .*tunnel"):
        trials.task_names(["tunel"], published=True)


@pytest.mark.parametrize("task, name", [("published/tunnel", "tunnel"), ("tunnel", "tunnel"), ("a/b.yaml", "b")])
def test_the_name_of_a_task_is_without_its_set(task, name):
    assert trial(task=task).name == name


def results() -> dict[str, list[TrialResult]]:
    times = np.arange(1, 21) / 10.0
    solved = [
        TrialResult(k, valid=True, solved=k > 1, planning_s=t, cpu_s=t, waypoints=3, replans=k % 2, contact_tries=4)
        for k, t in enumerate(times)
    ]
    return {"bar": [*solved, TrialResult(20, planning_s=60.0, reason="no plan")], "none": [TrialResult(0, reason="?")]}


def test_numbers_are_of_the_valid_plans():
    tasks = summary.to_dict(results())["tasks"]
    assert list(tasks) == ["bar", "none"]
    bar = tasks["bar"]
    assert (bar["n"], bar["valid"], bar["solved"]) == (21, 20, 18)
    assert bar["planning_s"] == {"median": pytest.approx(1.05), "p95": pytest.approx(1.905)}
    assert tasks["none"]["planning_s"] == {"median": None, "p95": None}
    assert KEYS <= set(bar["trials"][0]) and bar["trials"][20]["reason"] == "no plan"
    json.dumps(tasks)


def test_table_lines_up():
    lines = summary.table(results())
    assert len({len(line) for line in lines}) == 1
    assert lines[1].split() == ["bar", "21", "20", "18", "1.05", "1.91", "1.05", "3", "4", "-", "10"]
    assert summary.markdown(results())[2].count("|") == summary.markdown(results())[0].count("|")


def test_whatever_goes_wrong_in_a_trial_becomes_its_reason(monkeypatch):
    assert "no task file" in run.run_trial(trial()).reason

    def broken(error):
        def plan(*_, **__):
            raise error

        return plan

    monkeypatch.setattr(run.planner, "plan", broken(MotionError("blocked")))
    given_up = run.run_trial(trial(task="tunnel"))
    assert given_up.reason == "[motion/NO_MOTION] blocked" and given_up.planning_s >= 0.0 and not given_up.valid
    monkeypatch.setattr(run.planner, "plan", broken(ZeroDivisionError("by 0")))
    assert run.run_trial(trial(task="tunnel")).reason == "[internal/INTERNAL] ZeroDivisionError: by 0"


def test_the_command_writes_its_files(monkeypatch, tmp_path, capsys):
    done = {"tunnel": lambda t: TrialResult(t.seed, t.seed < 7, t.seed < 6, "" if t.seed < 6 else "no", 0.5)}

    def stand_in(wanted, jobs, dask, on_result):
        assert (jobs, dask) == (3, "tcp://x:1")
        found = [done[t.task](t) for t in wanted]
        for t, result in zip(wanted, found, strict=True):
            on_result(t, result)
        return found

    monkeypatch.setattr(trials, "run_trials", stand_in)
    out, file = tmp_path / "new" / "out", tmp_path / "r.json"
    options = "--tasks tunnel --seeds 4 --first-seed 5 --jobs 3 --dask tcp://x:1 --json".split()
    assert main(["bench", "tasks", *options, str(file), "--out", str(out)]) == 1
    printed = capsys.readouterr()
    assert "4 of 4  tunnel, seed 8, planning 0.50 s: not solved: no" in printed.err
    assert printed.out.splitlines()[1].split()[:4] == ["tunnel", "4", "2", "1"]
    written = json.loads(file.read_text())
    assert written == json.loads((out / "tasks.json").read_text())
    assert [t["seed"] for t in written["tasks"]["tunnel"]["trials"]] == [5, 6, 7, 8]
    assert (out / "tasks.png").stat().st_size > 1000 and "| tunnel |" in (out / "tasks.md").read_text()


def test_the_proposer_is_that_of_every_trial(monkeypatch):
    asked, planned = [], []
    monkeypatch.setattr(trials, "run_trials", lambda wanted, *a: asked.extend(wanted) or [TrialResult(0, solved=True)])
    assert main(["bench", "tasks", "--tasks", "tunnel", "--seeds", "1", "--proposer", "learned"]) == 0
    assert [t.proposer for t in asked] == ["learned"]

    def stand_in(scene, **options):
        planned.append(options)
        raise MotionError("no motion")

    monkeypatch.setattr(run.planner, "plan", stand_in)
    for proposer in ("learned", ""):
        run.run_trial(Trial("tunnel", 0, 20.0, 1, proposer=proposer))
    assert planned[0]["proposer"] == "learned" and "proposer" not in planned[1]


@pytest.mark.parametrize(
    "arguments, text",
    [
        ("--tasks tunel", "unknown task 'tunel'"),
        ("--json /no/such/x.json", "no folder"),
        ("--out /dev/null/x", "folder"),
        ("--proposer learnt", "unknown contact proposer 'learnt'; there are"),
    ],
)
def test_bad_input(arguments, text, capsys):
    assert main(["bench", "tasks", *arguments.split()]) == 2
    assert text in capsys.readouterr().err


@pytest.mark.slow
def test_a_task_file_is_planned_judged_and_executed(tmp_path):
    """A physical task with one grasp, by the real worker; and its trial again, with the same outcome."""
    task = carry(tmp_path, motion="spatial").task
    wanted = Trial(task, 1, time_limit=120.0, max_replans=1)
    first, second = trials.run_trials([wanted, wanted], jobs=1)
    assert first.valid and first.solved and first.executed and first.reason == ""
    assert first.planning_s > 0.0 and first.waypoints == 1 and first.segments == 3 and first.replans == 0
    assert first.goal_error == second.goal_error and first.duration_s == second.duration_s


@pytest.mark.slow
def test_a_kinematic_task_is_solved_when_its_plan_is_valid(tmp_path):
    task = carry(tmp_path, mode="kinematic", motion="planar").task
    (found,) = trials.run_trials([Trial(task, 1, time_limit=120.0, max_replans=1)], jobs=1)
    assert found.valid and found.solved and not found.executed
