"""What a search has tried, as a tree: in the error, in the plan, and on the command line."""

import pytest
from obstacle_fixtures import corridor, heavy_slab
from planner_fixtures import carry

from hmap_core.cli.main import main
from hmap_core.exceptions import Code, ContactError, HmapError, MotionError, PlannerError
from hmap_core.planner import plan
from hmap_core.planner.contact_checker import LocalContactChecker
from hmap_core.planner.context import Record
from hmap_core.planner.search_tree import Attempt, SearchTree

TIME_LIMIT = 120.0  # s; a busy machine is slow


def test_errors_that_pass_through_become_failures():
    tree = SearchTree("task")
    with pytest.raises(MotionError), tree.attempt("outer"):
        with tree.attempt("inner") as node:
            node.fail("contacts", Code.NO_CONTACT, "none")
        raise MotionError("no way")
    (outer,) = tree.root.tried
    assert (outer.stage, outer.code, outer.reason, outer.solved) == ("motion", "NO_MOTION", "no way", False)
    assert [child.code for child in outer.tried] == ["NO_CONTACT"]


def test_the_tree_survives_json_and_is_drawn_with_branches():
    tree = SearchTree("task")
    with tree.attempt("path"):
        tree.note("contact 1", ContactError("too far"))
        with tree.attempt("contact 2") as node:
            node.succeed()
    again = Attempt.from_dict(tree.root.to_dict())
    assert again == tree.root
    assert list(again.lines()) == [
        "task",
        "└─ path",
        "   ├─ contact 1: [contacts/NO_CONTACT] too far",
        "   └─ contact 2: solved",
    ]


def test_a_tree_does_not_grow_without_end(monkeypatch):
    monkeypatch.setattr("hmap_core.planner.search_tree.MAX_NODES", 3)
    tree = SearchTree("task")
    for k in range(5):
        tree.note(f"try {k}", MotionError("no"))
    assert len(tree.root.tried) == 2


def codes(node: Attempt) -> set[str]:
    return {node.code} | {code for child in node.tried for code in codes(child)}


def test_a_plan_says_how_it_was_found(tmp_path):
    made = plan(carry(tmp_path), seed=1, time_limit=TIME_LIMIT)
    root = Attempt.from_dict(made.stats["search"])
    assert root.solved and "brick" in root.what
    (first, *_) = root.tried
    assert first.what == "round 1: 'brick' to its goal"
    assert any("waypoint 1: pose 0 of" in line for line in root.lines())


def test_a_failure_that_is_known_without_a_search_shows_its_reason(tmp_path):
    with pytest.raises(HmapError) as error:
        plan(heavy_slab(tmp_path, motion="auto"), seed=1, time_limit=TIME_LIMIT)
    (leaf,) = (line for line in Attempt.from_dict(error.value.search).lines() if "slab in the way" in line)
    assert "[planner/NO_CONTACT]" in leaf and "cannot be removed" in leaf


def test_a_failure_shows_object_path_waypoint_contacts_and_reason(tmp_path, capsys, monkeypatch):
    check = LocalContactChecker.check
    monkeypatch.setattr(LocalContactChecker, "check", lambda *a: [] if a[1].object != "brick" else check(*a))
    scene = corridor(tmp_path)
    with pytest.raises(HmapError) as error:
        plan(scene, seed=1, time_limit=TIME_LIMIT)
    root = Attempt.from_dict(error.value.search)
    assert not root.solved and "NO_CONTACT" in codes(root)
    text = "\n".join(root.lines())
    for part in ("object path", "waypoint", "contacts on 'outer'", "out of the way of 'brick'"):
        assert part in text
    options = ["--time-limit", str(TIME_LIMIT), "--out", str(tmp_path / "plan.json"), "--explain"]
    code = main(["plan", scene.task, "--seed", "1", *options])
    shown = capsys.readouterr()
    assert code == 1 and "contacts on 'outer'" in shown.out and "'inner'" in shown.err


def test_a_job_that_ends_early_within_another_one_says_what_failed_before():
    """It said that nothing was tried yet, after minutes of search."""
    record = Record(SearchTree("task"))
    assert record.last_reason() == "nothing was tried yet"
    record.failed(PlannerError("none of 470 contacts is reachable", Code.NO_CONTACT))
    for _ in range(2):  # two removals begin
        record.forget()
    assert record.reason == "nothing was tried yet"
    assert "none of 470 contacts" in record.last_reason()
    record.failed(PlannerError("no way to move on", Code.NO_MOTION))
    assert "no way to move on" in record.last_reason()
