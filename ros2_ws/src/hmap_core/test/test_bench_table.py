"""``hmap bench table``: statistics, a log that survives a kill, the files, Dask, and a row of one's own."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import bootstrap

from hmap_core.cli import main
from hmap_core.cli.bench_table import planner_names
from hmap_core.evaluation import cluster as clusters
from hmap_core.evaluation import isolated, trials
from hmap_core.evaluation.table import report
from hmap_core.evaluation.table.log import TRIALS, TrialLog, key_of
from hmap_core.evaluation.table.statistics import Cell, Verdict, compare, holm, success_interval
from hmap_core.evaluation.table.table import Table, build
from hmap_core.evaluation.trial import Trial, TrialResult
from hmap_core.exceptions import Code, InputError, PlannerError

EXAMPLE = Path(__file__).resolve().parents[4] / "examples" / "09_own_row"
PAGE = EXAMPLE.parents[1] / "docs" / "results.md"
LIMIT = 180.0
SESSION = {"machine": "m, 2 cores", "jobs": 1, "python": "3.11", "versions": {"scipy": "1"}, "planners": {"a": "x 1"}}


def trial(seed: int = 0, planner: str = "a", task: str = "published/t", **more) -> Trial:
    return Trial(task, seed, more.pop("time_limit", LIMIT), 0, planner=planner, **more)


def result(seed: int, valid: bool, seconds: float = 1.0, **more) -> TrialResult:
    return TrialResult(seed, valid=valid, solved=valid, claimed=valid, method_s=seconds, **more)


def cell(solved: list[bool], seconds: list[float] | None = None, planner: str = "a", first: int = 0) -> Cell:
    times = seconds or [1.0] * len(solved)
    found = [result(first + k, ok, t) for k, (ok, t) in enumerate(zip(solved, times, strict=True))]
    return Cell("t", planner, tuple(r.seed for r in found), tuple(found), False, LIMIT)


# --- statistics


def test_wilson_interval_and_holm_are_those_of_the_literature():
    assert success_interval(8, 10) == (pytest.approx(0.4902, abs=1e-4), pytest.approx(0.9433, abs=1e-4))
    assert success_interval(0, 0) == (0.0, 1.0)
    # R: p.adjust(c(0.01, 0.04, 0.03, 0.005), "holm")
    assert holm([0.01, 0.04, 0.03, 0.005]).tolist() == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.7]).tolist() == [1.0, 1.0]
    assert holm([]).tolist() == []


def test_mcnemar_counts_discordant_pairs_of_common_seeds_only():
    method = cell([True] * 9 + [False] * 3, planner="b", first=2)  # seeds 2 to 13
    reference = cell([True] * 3 + [False] * 7)  # seeds 0 to 9
    found = compare(method, reference)
    assert (found.pairs, found.only_method, found.only_reference) == (8, 7, 0)
    assert found.p == pytest.approx(2 * 0.5**7)


def compared(method: list[bool], reference: list[bool], p_holm: float | None = None):
    found = compare(cell(method, planner="b"), cell(reference))
    return found.__class__(**(found.__dict__ | {"p_holm": found.p if p_holm is None else p_holm}))


@pytest.mark.parametrize(
    "method, reference, verdict",
    [
        ([True] * 10, [True] * 9 + [False], Verdict.TOO_FEW),  # 10 of 10 against 9 of 10 says nothing
        ([True] * 3, [False] * 3, Verdict.TOO_FEW),
        ([True] * 10, [False] * 10, Verdict.BETTER),
        ([False] * 10, [True] * 10, Verdict.WORSE),
        ([True] * 10, [True] * 10, Verdict.ALL_ALIKE),
        ([True, False] * 10, [False, True] * 10, Verdict.NO_DIFFERENCE),
    ],
)
def test_a_verdict_says_where_there_are_too_few_runs(method, reference, verdict):
    assert compared(method, reference).verdict is verdict


def test_the_corrected_p_value_decides():
    assert compared([True] * 6, [False] * 6).verdict is Verdict.BETTER
    assert compared([True] * 6, [False] * 6, p_holm=0.2).verdict is Verdict.NO_DIFFERENCE


def test_times_of_failures_are_censored_and_not_dropped():
    failing = cell([True, False, False], [2.0, 5.0, 7.0], planner="b")
    assert failing.times.tolist() == [2.0, LIMIT, LIMIT]
    assert failing.median_time == (LIMIT, True)
    assert cell([True, True, False], [2.0, 5.0, 7.0]).median_time == (5.0, False)
    found = compare(failing, cell([True, True, False]))
    assert found.ratio == pytest.approx((2.0 + LIMIT) / 2)  # the pair in which both fail tells nothing
    assert (found.method_censored, found.reference_censored) == (True, False)


def test_the_interval_of_the_time_ratio_is_the_bootstrap_of_scipy():
    times = np.random.default_rng(3).lognormal(size=20).tolist()
    found = compare(cell([True] * 20, times, planner="b"), cell([True] * 20))
    rng = np.random.default_rng(0)
    expected = bootstrap((times,), np.median, n_resamples=2000, method="percentile", rng=rng).confidence_interval
    assert found.ratio == pytest.approx(np.median(times))
    assert found.ratio_interval == pytest.approx(tuple(expected))
    assert compare(cell([True] * 5, planner="b"), cell([True] * 5)).ratio_interval is None


# --- the log


def test_a_log_resumes_with_no_trial_twice(tmp_path):
    wanted = [trial(seed) for seed in range(4)]
    log = TrialLog(tmp_path)
    with log.opened(SESSION, wanted):
        log.add(wanted[0], result(0, True))
        log.add(wanted[1], result(1, False))
        with pytest.raises(ValueError, match="already"):
            log.add(wanted[0], result(0, True))
    with (tmp_path / TRIALS).open("ab") as stream:
        stream.write(b'{"trial": {"task": "published/t", "se')  # a kill in the middle of a line
    again = TrialLog(tmp_path)
    with again.opened(SESSION, wanted):
        assert [t.seed for t in wanted if key_of(t) not in again.results] == [2, 3]
        again.add(wanted[2], result(2, True))
    lines = [json.loads(line) for line in (tmp_path / TRIALS).read_text().splitlines()]
    assert [line["trial"]["seed"] for line in lines] == [0, 1, 2]
    assert len(again.sessions) == 2 and again.results[key_of(wanted[1])] == result(1, False)


KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from test_bench_table import SESSION, result, trial
from hmap_core.evaluation.table.log import TrialLog, key_of
wanted = [trial(seed) for seed in range(5)]
log = TrialLog(Path(sys.argv[1]))
with log.opened(SESSION, wanted):
    left = [t for t in wanted if key_of(t) not in log.results]
    for t in left[:2]:
        log.add(t, result(t.seed, True))
    if len(left) > 2:
        os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_process_loses_nothing_that_it_finished(tmp_path):
    command = [sys.executable, "-c", KILLED, str(tmp_path), str(Path(__file__).parent)]
    codes = [subprocess.run(command, check=False).returncode for _ in range(3)]
    assert codes == [-signal.SIGKILL, -signal.SIGKILL, 0]
    seeds = [json.loads(line)["trial"]["seed"] for line in (tmp_path / TRIALS).read_text().splitlines()]
    assert seeds == [0, 1, 2, 3, 4]


def test_a_log_is_of_one_run_and_of_one_setting(tmp_path):
    log, other = TrialLog(tmp_path), TrialLog(tmp_path)
    with log.opened(SESSION, []):
        log.add(trial(0), result(0, True))
        with pytest.raises(InputError, match="another run"), other.opened(SESSION, []):
            pass
    with pytest.raises(InputError, match=r"has time_limit 180.0, not 5.0"):
        with TrialLog(tmp_path).opened(SESSION, [trial(1, time_limit=5.0)]):
            pass


@pytest.mark.parametrize("line", ["nonsense", "[1]", "{}", '{"trial": {"task": 1}}', "3"])
def test_a_log_that_is_none_is_refused(tmp_path, line):
    (tmp_path / TRIALS).write_text(line + "\n")
    with pytest.raises(InputError, match=r"trials\.jsonl:1: no trial"), TrialLog(tmp_path).opened(SESSION, []):
        pass


# --- the files


def some_table(names: str | tuple[str, ...] = "abc") -> Table:
    """Twelve seeds of two tasks: the first method solves most of them, the last one none."""
    rng, odds = np.random.default_rng(1), dict(zip(names, (0.95, 0.3, 0.0), strict=True))
    wanted = [trial(seed, planner, task) for task in ("published/t", "u") for seed in range(12) for planner in names]
    results = {}
    for t in wanted:
        ok, refused = bool(rng.random() < odds[t.planner]), t.planner == names[2] and t.task == "u"
        code = "UNKNOWN_TASK" if refused else "" if ok else "TIME_LIMIT"
        results[key_of(t)] = result(t.seed, ok, float(rng.uniform(0.1, 9.0)), code=code, reason="" if ok else "a, b")
    return build(wanted, results, {"u"})


def test_the_ten_lines_of_the_page_give_the_numbers_of_the_table(tmp_path, monkeypatch):
    """The code of docs/results.md as it stands there, on the CSV of a table."""
    lines = re.search(r"Every statistic follows.*?```python\n(.*?)```", PAGE.read_text(), re.S).group(1)
    imports, _, statements = lines.partition("\n\n")
    assert imports.count("import") == 2 and len(statements.splitlines()) == 10
    table, told = some_table(("hmap", "komo", "other")), []
    (tmp_path / "table").mkdir()
    (tmp_path / "table" / "trials.csv").write_text(report.csv_text(table))
    monkeypatch.chdir(tmp_path)
    exec(lines, {"print": lambda *words: told.append(words)})
    document = json.loads(report.json_text(table, [], "c"))
    *by_task, (order, corrected) = told
    assert [words[0] for words in by_task] == ["t", "u"] and sorted(order) == ["t", "u"]
    for task, wilson, median, ratio, ends, p in by_task:
        cell, against = (
            next(c for c in document[kind] if (c["task"], c["method"]) == (task, "komo"))
            for kind in ("cells", "comparisons")
        )
        assert cell["success_interval"] == pytest.approx(list(wilson))
        assert (cell["median_s"], cell["median_is_bound"]) == ((LIMIT, True) if np.isinf(median) else (median, False))
        assert against["p"] == pytest.approx(p)
        assert against["p_holm"] == pytest.approx(corrected[order.index(task)])
        assert against["time_ratio"] == pytest.approx(ratio, rel=1e-5)
        assert against["time_ratio_interval"] == pytest.approx(list(ends.confidence_interval), rel=1e-5)


def test_markdown_and_latex_name_all_and_say_what_a_method_cannot_state():
    table = some_table()
    page = report.markdown(table, [SESSION | {"seconds": 9.0}], "hmap bench table --out x")
    assert page.count("cannot state the task") == 3  # of c on u, in both tables, and the heading of the reasons
    assert page.count("- `c` on `u`: a, b\n") == 1
    assert "m, 2 cores" in page and "took 9 s in 1 run." in page and "`hmap bench table --out x`" in page
    lines = page.splitlines()
    assert len([line for line in lines if line.startswith("| t |")]) == 3
    tex = report.latex(table)
    assert tex.startswith(r"\begin{tabular}{lcc}") and tex.count(r"\\") == 4 and "--" in tex


def test_the_command_writes_all_files_and_resumes(tmp_path, monkeypatch, capsys):
    asked = []

    def stand_in(wanted, jobs, dask, on_result, on_machines):
        asked.append([(t.seed, t.planner) for t in wanted])
        for k, t in enumerate(wanted):
            if len(asked) == 1 and k == 3:
                raise KeyboardInterrupt
            on_result(t, result(t.seed, True))

    monkeypatch.setattr(trials, "run_trials", stand_in)
    options = ["--tasks", "tunnel", "--planners", "hmap", "komo", "--seeds", "3", "--jobs", "1", "--out", str(tmp_path)]
    assert main(["bench", "table", *options]) != 0
    assert main(["bench", "table", *options]) == 0
    assert [len(each) for each in asked] == [6, 3] and not set(asked[0][:3]) & set(asked[1])
    assert asked[0][:2] == [(0, "hmap"), (0, "komo")]  # pairs are complete as early as they can be
    names = {"trials.jsonl", "trials.csv", "table.md", "table.tex", "table.json", "solved_by_time.png"}
    assert {path.name for path in tmp_path.iterdir()} == names
    assert "| komo | 3/3 |" in capsys.readouterr().out


def test_all_planners_are_rows_the_default_first_and_unknown_ones_are_refused():
    assert planner_names([])[0] == "hmap" and {"komo", "lgp_star"} <= set(planner_names([]))
    with pytest.raises(InputError, match="unknown planner 'kmo'; there are"):
        planner_names(["kmo"])
    with pytest.raises(InputError, match="twice"):
        planner_names(["hmap", "hmap"])


# --- Dask

SLOW = """
import json, os, sys, time
for line in sys.stdin:
    seed = json.loads(line)["seed"]
    if seed == 5:
        os.abort()
    time.sleep(0.3)
    print(json.dumps({"seed": seed, "valid": True, "solved": True}), flush=True)
"""


@pytest.fixture(scope="module")
def cluster():
    """A scheduler and two workers on this machine."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as own:
        yield own


def lines_of(folder: Path) -> list[dict]:
    path = folder / TRIALS
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


@pytest.mark.slow
def test_the_command_on_a_dask_cluster_survives_the_death_of_a_worker(cluster, tmp_path, capsys):
    """Two workers, eight trials of the planner; one worker is killed in the middle, and all eight are there."""
    victim, killed_at, ended = next(iter(cluster.workers.values())).pid, [], threading.Event()

    def kill() -> None:
        while not lines_of(tmp_path) and not ended.is_set():
            time.sleep(0.01)
        os.kill(victim, signal.SIGKILL)
        killed_at.append(len(lines_of(tmp_path)))

    options = ["--tasks", "tunnel", "--planners", "hmap", "--seeds", "8", "--out", str(tmp_path)]
    on_cluster = ["bench", "table", *options, "--dask", cluster.scheduler_address]
    killer = threading.Thread(target=kill)
    killer.start()
    code = main(on_cluster)
    ended.set()
    killer.join()
    assert code == 0
    assert 1 <= killed_at[0] < 8
    done = [(line["trial"]["seed"], line["result"]["solved"]) for line in lines_of(tmp_path)]
    assert sorted(done) == [(seed, True) for seed in range(8)]
    assert "| hmap | 8/8 |" in capsys.readouterr().out
    session = lines_of(tmp_path)[-1]["session"]
    assert session["jobs"] == cluster.scheduler_address and "cores" in session["machine"]
    on_cluster[-1] = "tcp://127.0.0.1:1"  # nothing is left to do: no cluster is needed
    assert main(on_cluster) == 0 and len(lines_of(tmp_path)) == 8


@pytest.mark.slow
def test_a_trial_that_crashes_on_a_dask_worker_is_a_failure_of_itself_alone(cluster):
    wanted, command = [trial(seed, "hmap") for seed in range(4, 8)], (sys.executable, "-c", SLOW)
    found = trials.run_trials(wanted, dask=cluster.scheduler_address, command=command)
    assert [(r.seed, r.solved) for r in found] == [(4, True), (5, False), (6, True), (7, True)]
    assert "SIGABRT" in found[1].reason


@pytest.mark.slow
def test_a_cluster_without_the_method_or_without_workers_is_refused_before_the_first_trial(cluster, monkeypatch):
    from distributed import LocalCluster

    with pytest.raises(InputError, match="worker tcp://.*unknown planner 'mine'.*on all hosts"):
        trials.run_trials([trial(0, "mine")], dask=cluster.scheduler_address)
    monkeypatch.setattr(clusters, "__version__", "0.0.0")
    with pytest.raises(InputError, match=r"has hmap_core .*, not 0\.0\.0; install the same version"):
        trials.run_trials([trial(0, "hmap")], dask=cluster.scheduler_address)
    monkeypatch.setattr(clusters, "WORKER_TIMEOUT", 0.5)
    with LocalCluster(n_workers=0, dashboard_address=None) as empty:
        with pytest.raises(InputError, match="has no workers; start some"):
            trials.run_trials([trial(0, "hmap")], dask=empty.scheduler_address)


@pytest.mark.slow
def test_a_cluster_that_is_lost_ends_the_command_with_what_to_do(cluster):
    from distributed.comm import CommClosedError

    with pytest.raises(PlannerError, match="was lost.*the same command resumes") as error:
        with clusters.backend(cluster.scheduler_address):
            raise CommClosedError("the scheduler is gone")
    assert error.value.code is Code.SERVICE_UNAVAILABLE


# --- a row of one's own


@pytest.mark.slow
def test_a_method_of_ones_own_is_another_row(tmp_path, monkeypatch, capsys):
    """The example as pip installs it: its module and its entry points."""
    assert len((EXAMPLE / "straight_line.py").read_text().splitlines()) < 30
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]
    site = tmp_path / "site"
    info = site / f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    info.mkdir(parents=True)
    (site / "straight_line.py").write_text((EXAMPLE / "straight_line.py").read_text())
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n")
    groups = [
        f"[{group}]\n" + "\n".join(f"{name} = {value}" for name, value in entries.items())
        for group, entries in project["entry-points"].items()
    ]
    (info / "entry_points.txt").write_text("\n".join(groups) + "\n")
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.setattr(isolated, "_workers", threading.local())  # a worker of another test does not know the package
    out = tmp_path / "out"
    options = ["--tasks", "tunnel", "--planners", "hmap", "straight_line", "--seeds", "1", "--jobs", "1"]
    assert main(["bench", "table", *options, "--time-limit", "60", "--out", str(out)]) == 0
    assert "| straight_line | 1/1 |" in capsys.readouterr().out
    assert "straight_line of straight-line 0.1" in (out / "table.md").read_text()
