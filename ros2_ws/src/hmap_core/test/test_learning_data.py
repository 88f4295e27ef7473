"""Data sets of contacts: made, checked, loaded with other libraries, trained on."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from hmap_core.cli import main
from hmap_core.contacts.feasibility import reach_bounds
from hmap_core.exceptions import InputError
from hmap_core.learning.families import BUILDS, FAMILIES, make_scene
from hmap_core.learning.labels import Stage, label_contacts
from hmap_core.planner.contact_checker import LocalContactChecker, cleared
from hmap_core.planner.protocols import ContactQuery
from hmap_core.planner.sampled_contacts import SampledContacts
from hmap_core.scenes import SceneBuilder

pq = pytest.importorskip("pyarrow.parquet")
from hmap_core.learning.baselines import BASELINES  # noqa: E402
from hmap_core.learning.dataset import Recipe, _prepare, make  # noqa: E402
from hmap_core.learning.dataset_check import check  # noqa: E402
from hmap_core.learning.evaluation import LEARNED  # noqa: E402
from hmap_core.learning.examples import load_all, load_contacts, load_holds, thinned  # noqa: E402
from hmap_core.learning.metrics import average_precision, first_hits  # noqa: E402
from hmap_core.learning.rows import scene_rows  # noqa: E402

SAMPLE = Path(__file__).resolve().parents[4] / "examples" / "contacts_sample"
pytestmark = pytest.mark.skipif(not SAMPLE.is_dir(), reason="the sample is in the repository only")


@pytest.fixture
def copied(tmp_path):
    return Path(shutil.copytree(SAMPLE, tmp_path / "data"))


def test_the_sample_is_small_and_sound():
    assert sum(path.stat().st_size for path in SAMPLE.rglob("*") if path.is_file()) <= 5_000_000
    assert check(SAMPLE) == []
    assert "license: cc-by-4.0" in (SAMPLE / "README.md").read_text(encoding="utf-8")


def test_the_sample_loads_with_other_libraries(tmp_path, monkeypatch):
    datasets = pytest.importorskip("datasets")
    croissant = pytest.importorskip("mlcroissant")
    loaded = datasets.load_dataset(str(SAMPLE), "contacts", cache_dir=str(tmp_path))
    assert set(loaded) == {"train", "validation", "test"}
    assert len(loaded["test"]) == len(load_contacts(SAMPLE, "test"))
    assert len(loaded["test"][0]["T_obj_ee"]) == 7
    document = croissant.Dataset(jsonld=str(SAMPLE / "croissant.json"))
    assert not document.metadata.issues.errors
    assert {record.id for record in document.metadata.record_sets} == {"contacts", "queries", "scenes"}


def test_a_truncated_or_missing_shard_is_named(copied):
    shard = next((copied / "contacts").glob("test-*.parquet"))
    content = shard.read_bytes()
    shard.write_bytes(content[: len(content) // 2])
    assert check(copied) == [
        f"contacts/{shard.name} has another SHA-256 than SHA256SUMS says: it is truncated or changed"
    ]
    with pytest.raises(InputError, match=f"{shard.name} is truncated"):
        load_contacts(copied, "test")
    shard.unlink()
    assert check(copied) == [f"contacts/{shard.name} is missing"]
    with pytest.raises(InputError, match="no contacts of the split test"):
        load_contacts(copied, "test")


def test_a_changed_shard_and_a_folder_without_a_data_set_are_refused(copied, tmp_path, capfd):
    (copied / "recipe.json").unlink()
    assert check(copied) == ["recipe.json is missing"]
    with pytest.raises(InputError, match="no data set"):
        check(tmp_path)
    assert main(["dataset", "check", str(tmp_path)]) != 0
    with pytest.raises(InputError, match="not empty"):
        make(copied, Recipe(1))


def test_the_same_recipe_makes_the_same_files_and_resumes(tmp_path):
    recipe = Recipe(1, seed=3, families=("clutter",))
    for name in ("one", "two"):
        make(tmp_path / name, recipe)
    sums = [(tmp_path / name / "SHA256SUMS").read_text() for name in ("one", "two")]
    assert sums[0] == sums[1] and check(tmp_path / "one") == []
    with pytest.raises(InputError, match="--resume"):
        make(tmp_path / "one", recipe)
    with pytest.raises(InputError, match="another data set"):
        make(tmp_path / "one", Recipe(2), resume=True)
    with pytest.raises(InputError, match="unknown family 'nothing'"):
        make(tmp_path / "three", Recipe(1, families=("nothing",)))


@pytest.mark.parametrize("family", FAMILIES)
def test_scenes_depend_on_family_and_seed_only(family):
    made = [make_scene(family, 4) for _ in range(2)]
    assert (made[0] is None) == (made[1] is None)
    if made[0] is not None:
        assert made[0][1] == made[1][1]
    assert len(BUILDS) == 7


def test_labels_are_those_of_the_planner():
    scene = SceneBuilder("block")
    scene.add_box("table", [2, 2, 0.1], pose=[0, 0, -0.05])
    scene.add_box("wall", [0.02, 0.3, 0.1], pose=[0.4, 0.1, 0.05])
    scene.add_box("block", [0.05, 0.05, 0.06], pose=[0.45, 0.1, 0.03], movable=True, mass=0.2)
    scene.add_robot("arm", "panda", base_pose=[0, 0, 0])
    scene.set_goal("block", pose=[0.56, 0.1, 0.03])
    scene = scene.build()
    poses = np.array([[0.45 + 0.01 * k, 0.1, 0.03, 0, 0, 0, 1.0] for k in range(12)])

    def query():
        return ContactQuery(scene, scene.start_state(), "block", poses, "arm", np.random.default_rng(0))

    contacts = list(next(iter(SampledContacts().propose(query()))).contacts)[:60]
    labels = label_contacts(query(), contacts, 3)
    manipulation, _ = cleared(scene, scene.start_state(), "block", "arm")
    assert np.array_equal(labels.bound, reach_bounds(manipulation, contacts, poses))
    assert np.array_equal(labels.stage == Stage.HAND_COLLIDES, labels.bound < 0)
    assert (labels.stage == Stage.FEASIBLE).any() and (labels.stage == Stage.HAND_SERVES).any()
    feasible = [contacts[k] for k in np.flatnonzero(labels.stage == Stage.FEASIBLE)]
    found = LocalContactChecker(len(feasible)).check(query(), feasible)
    assert len(found) == len(feasible)


def test_training_for_some_seconds_on_the_sample_beats_chance():
    pytest.importorskip("torch")
    from hmap_core.learning.training import TrainingConfig, train

    config = TrainingConfig(epochs=6, hold_epochs=20)
    trained = train([SAMPLE], config, time_limit=20.0)
    test = load_contacts(SAMPLE, "test")
    test = test[test.known]
    p, _ = trained.model.feasible(test.features)
    rng = np.random.default_rng(0)
    learned = np.mean(list(first_hits(test.query, test.feasible, p).values()))
    chance = np.mean(
        [np.mean(list(first_hits(test.query, test.feasible, rng.random(len(test))).values())) for _ in range(20)]
    )
    assert learned < 0.6 * chance
    assert average_precision(test.feasible, p) > 2.0 * test.feasible.mean()
    assert len(load_holds(SAMPLE, "train")) > 50


def test_a_training_without_a_family_is_measured_on_that_family_beside_all_baselines(tmp_path):
    for package in ("torch", "lightgbm"):
        pytest.importorskip(package)
    (tmp_path / "few.toml").write_text("epochs = 2\nkept = 0.5\n")
    options = [
        "--leave-one-out",
        "tray",
        "--config",
        str(tmp_path / "few.toml"),
        "--json",
        str(tmp_path / "found.json"),
    ]
    assert main(["evaluate-proposer", str(SAMPLE), *options]) == 0
    scores = {score["scorer"]: score for score in json.loads((tmp_path / "found.json").read_text())["contacts"]}
    assert set(scores) == {LEARNED, *BASELINES} and {score["family"] for score in scores.values()} == {"tray"}
    for score in scores.values():
        value, low, high = score["precision"]
        assert low <= value <= high
    assert scores[LEARNED]["precision"][0] > 2.0 * scores["uniform"]["precision"][0]


def test_a_thinned_training_set_keeps_all_contacts_where_the_hand_serves():
    contacts = load_contacts(SAMPLE, "train")
    kept = thinned(contacts, 0.25, 0)
    assert thinned(contacts, 1.0, 0) is contacts
    assert kept.hand.sum() == contacts.hand.sum()
    assert (~kept.hand).mean() > 0.0 and abs((~kept.hand).sum() / (~contacts.hand).sum() - 0.25) < 0.03


def test_a_relaxed_data_set_has_no_body_that_may_be_removed(tmp_path):
    make(tmp_path / "set", Recipe(1, 0, ("clutter",)))
    make(tmp_path / "relaxed", Recipe(1, 0, ("clutter",), relaxed=True))
    around = {}
    for name in ("set", "relaxed"):
        (file,) = (tmp_path / name / "queries").glob("*.parquet")
        around[name] = len(pq.read_table(file).column("around")[0])
    assert around["relaxed"] < around["set"]
    assert "--relaxed" in (tmp_path / "relaxed" / "README.md").read_text()
    assert scene_rows(0, 0, ("tray",), leave_out=True).scene["status"] == "nothing to remove"
    recipe = tmp_path / "set" / "recipe.json"
    old = json.loads(recipe.read_text())
    del old["relaxed"]  # as it was written before there was that choice
    recipe.write_text(json.dumps(old))
    _prepare(tmp_path / "set", Recipe(1, 0, ("clutter",)), True)
    with pytest.raises(InputError, match="another data set"):
        _prepare(tmp_path / "set", Recipe(1, 0, ("clutter",), relaxed=True), True)


def test_queries_of_several_data_sets_stay_apart():
    once, held = load_all([SAMPLE], "test")
    contacts, holds = load_all([SAMPLE, SAMPLE], "test")
    assert len(contacts) == 2 * len(once) and len(np.unique(contacts.query)) == 2 * len(np.unique(once.query))
    assert len(holds) == 2 * len(held) and len(np.unique(holds.place)) == 2 * len(np.unique(held.place))


@pytest.mark.parametrize(
    "text, reason",
    [
        ("epochs = 0", "epochs is 0"),
        ("kept = 1.5", "kept is 1.5"),
        ("pochs = 1", "unknown key 'pochs'"),
        ("hidden = []", "hidden is"),
        ("=", "no TOML"),
    ],
)
def test_wrong_settings_are_named(tmp_path, text, reason):
    pytest.importorskip("torch")
    from hmap_core.learning.training import TrainingConfig

    path = tmp_path / "config.toml"
    path.write_text(text)
    with pytest.raises(InputError, match=reason):
        TrainingConfig.read(path)


def test_the_recipe_of_the_sample_is_its_command():
    recipe = json.loads((SAMPLE / "recipe.json").read_text(encoding="utf-8"))
    own = Recipe(recipe["scenes"], recipe["seed"], tuple(recipe["families"]), recipe["version"])
    assert own.command in (SAMPLE / "README.md").read_text(encoding="utf-8")
