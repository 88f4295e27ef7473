"""The measurement of object paths among many parts; how long they take depends on the machine."""

import json

from hmap_core.benchmark import many_parts
from hmap_core.cli import bench_parts, main


def test_the_problems_have_as_many_parts_as_asked():
    problem = many_parts.window(40, 70, 0)
    assert len(problem.body.shapes) == 40
    assert sum(len(body.shapes) for body in problem.obstacles if body.name in ("wall", "boxes")) == 70
    assert many_parts.window(40, 70, 0, lid=True).obstacles[-1].name == "lid"


def test_a_path_is_found_and_clear_and_a_lid_closes_the_window():
    trial = many_parts.run(many_parts.window(40, 200, 0))
    assert trial.poses > 50 and trial.clear and trial.cpu < many_parts.LIMIT
    assert many_parts.run(many_parts.window(40, 200, 0, lid=True), 0.3).poses == 0


def test_a_brick_of_many_parts_is_carried_over_a_barrier_of_many_parts():
    """Pairs of parts are searched in boxes, by the planner and by the judge; without that it takes 20 s."""
    scene = many_parts.carried(300, 300, 0)
    assert all(250 <= len(scene.bodies[name].shapes) <= 350 for name in ("brick", "barrier"))
    trial = many_parts.run_plan(scene)
    assert trial.poses > 100 and trial.cpu < 10.0


def test_the_table_has_every_search(tmp_path, capsys, monkeypatch):
    trial = many_parts.Trial(0.5, 1.0, 2.0, 100, True)
    monkeypatch.setattr(many_parts, "run", lambda problem, limit=2.0: trial)
    monkeypatch.setattr(many_parts, "run_plan", lambda scene, limit=2.0: trial)
    monkeypatch.setattr(many_parts, "run_transit", lambda scene, state, ends, limit=2.0: trial)
    monkeypatch.setattr("hmap_core.compile_cache.ensure_compiled", lambda: None)
    out = tmp_path / "out.json"
    arguments = ["bench", "parts", "--parts", "30", "--obstacle-parts", "60", "--repeats", "2", "--json", str(out)]
    assert main(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 1 + 2 * (3 + len(bench_parts.LIMITS)) == 1 + len(json.loads(out.read_text()))
    assert lines[1].split() == ["window", "0", "60", "0.50", "1.00", "0.02", "100", "poses"]
