"""Parts of the planner that others bring: found by entry points, chosen by name, used on the command line."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from planner_fixtures import carry
from plugin_fixtures import MODULE, install

from hmap_core import planner
from hmap_core.exceptions import InputError
from hmap_core.plan_file import to_dict
from hmap_core.planner import HmapPlanner, plugins
from hmap_core.planner.object_path import BidirectionalSearch
from hmap_core.planner.protocols import ContactProposer, ManipulationPlanner, ObjectPathPlanner
from hmap_core.planner.sampled_contacts import SampledContacts
from hmap_core.scenes import load_scene
from hmap_core.validation import check

TIME_LIMIT = 120.0  # s; a busy machine is slow


@pytest.fixture
def foreign(tmp_path, monkeypatch):
    """The other package can be imported, and its entry points are found."""
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(str(install(folder)))
    yield folder
    sys.modules.pop("foreign_parts", None)


def hmap(folder, *arguments):
    path = os.pathsep.join([str(folder), *sys.path])
    command = [sys.executable, "-m", "hmap_core", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": path})


@pytest.mark.parametrize(
    ("group", "name", "kind"),
    [
        (plugins.OBJECT_PATH_PLANNERS, "hmap", BidirectionalSearch),
        (plugins.CONTACT_PROPOSERS, "sampled", SampledContacts),
        (plugins.PLANNERS, "hmap", HmapPlanner),
    ],
)
def test_the_parts_of_hmap_are_found_by_name(group, name, kind):
    assert isinstance(plugins.create(group, name), kind)


OF_PEERS = ("rai_komo", "rai_lgp_star", "hpp_manipulation")  # need RAI or HPP, which have environments of their own


def test_every_listed_part_implements_its_protocol(foreign):
    protocols = {
        plugins.OBJECT_PATH_PLANNERS: ObjectPathPlanner,
        plugins.CONTACT_PROPOSERS: ContactProposer,
        plugins.PLANNERS: ManipulationPlanner,
    }
    for group, protocol in protocols.items():
        for name in plugins.plugins(group).keys() - {"broken", "missing", "ompl", *OF_PEERS}:
            assert isinstance(plugins.create(group, name), protocol), name


def test_an_unknown_name_is_refused_with_those_that_there_are(foreign):
    with pytest.raises(
        InputError, match="unknown contact proposer 'learnt'; there are auto, last_first, learned, sampled"
    ):
        plugins.create(plugins.CONTACT_PROPOSERS, "learnt")
    with pytest.raises(InputError, match="unknown group 'hmap.robots'"):
        plugins.plugins("hmap.robots")


@pytest.mark.parametrize(
    ("name", "why"), [("broken", "has no method 'plan'"), ("missing", "cannot be loaded: AttributeError")]
)
def test_a_part_that_is_none_is_refused_by_name(foreign, name, why):
    with pytest.raises(InputError, match=f"the planner '{name}' of foreign-parts {why}"):
        plugins.create(plugins.PLANNERS, name)


def test_a_name_carries_an_argument(foreign):
    assert plugins.create(plugins.OBJECT_PATH_PLANNERS, "detour").label == "detour"
    assert plugins.create(plugins.OBJECT_PATH_PLANNERS, "detour:far").label == "far"


def test_a_part_registered_in_python_takes_precedence(monkeypatch):
    monkeypatch.setattr(plugins, "_registered", {group: {} for group in plugins.KINDS})
    own = SampledContacts()
    plugins.register(plugins.CONTACT_PROPOSERS, "sampled", lambda: own)
    assert plugins.create(plugins.CONTACT_PROPOSERS, "sampled") is own
    assert plugins.plugins(plugins.CONTACT_PROPOSERS)["sampled"].origin == __name__


def test_each_part_takes_less_than_forty_lines():
    classes = MODULE.split("\nclass ")[1:]
    assert len(classes) == 4 and all(text.count("\n") < 40 for text in classes)


def test_options_of_hmap_are_refused_for_other_methods(foreign, tmp_path):
    with pytest.raises(InputError, match="the planner 'twice' has no option proposer"):
        planner.plan(carry(tmp_path), planner="twice", proposer="sampled")


def test_h_map_takes_a_contact_proposer_after_a_colon(tmp_path):
    scene = load_scene("tunnel_tool", 1)
    plans = {name: planner.plan(scene, seed=1, planner=name) for name in ("hmap", "hmap:learned", "hmap:sampled")}
    learned = {name: plan.stats["learned_contacts"] for name, plan in plans.items()}
    assert learned["hmap"] == learned["hmap:learned"] > 0 == learned["hmap:sampled"]
    with pytest.raises(InputError, match="unknown contact proposer 'guessed'"):
        planner.plan(carry(tmp_path), planner="hmap:guessed")
    with pytest.raises(InputError, match="'hmap:learned' names a contact proposer, so it has no further parts"):
        planner.plan(carry(tmp_path), planner="hmap:learned", transit="ompl")


def test_a_proposer_is_used_first_and_success_does_not_fall(foreign, tmp_path):
    scene = carry(tmp_path)
    sampled = planner.plan(scene, seed=1, time_limit=TIME_LIMIT)
    foreign_first = planner.plan(scene, seed=1, time_limit=TIME_LIMIT, proposer="last_first")
    poses = [[s.contact_pose for s in p.segments if s.contact_pose is not None] for p in (sampled, foreign_first)]
    assert len(poses[0]) and len(poses[1])
    assert not np.allclose(poses[0][0], poses[1][0])


@pytest.mark.slow
def test_the_command_line_uses_them(foreign, tmp_path):
    scene = carry(tmp_path)
    out = tmp_path / "plan.json"
    common = scene.task, "--seed", 1, "--out", out, "--time-limit", TIME_LIMIT
    ran = hmap(foreign, "plan", *common, "--object-path", "detour:mine", "--proposer", "last_first")
    assert ran.returncode == 0 and "mine plans brick" in ran.stdout, ran.stderr
    ran = hmap(foreign, "plan", *common, "--planner", "twice")
    assert ran.returncode == 0 and "twice plans" in ran.stdout, ran.stderr
    assert hmap(foreign, "check", out).returncode == 0
    ran = hmap(foreign, "plan", *common, "--planner", "thrice")
    assert ran.returncode == 2 and "unknown planner 'thrice'; there are" in ran.stderr


def test_plugins_are_listed_with_origin_and_version(foreign):
    ran = hmap(foreign, "plugins", "--json")
    rows = {(row["group"], row["name"]): (row["origin"], row["version"]) for row in json.loads(ran.stdout)}
    assert rows["hmap.contact_proposers", "last_first"] == ("foreign-parts", "1.2")
    assert rows["hmap.planners", "hmap"][0] == "hmap_core"


@pytest.mark.parametrize("transit", ["hmap", "ompl:RRTConnect"])
def test_transits_are_searched_by_the_planner_that_is_named(tmp_path, transit):
    made = planner.plan(carry(tmp_path), seed=1, time_limit=TIME_LIMIT, transit=transit)
    assert check(to_dict(made)).valid


def test_an_unknown_planner_of_ompl_is_refused(tmp_path):
    with pytest.raises(InputError, match="'ompl:Dijkstra' is unknown; allowed: .*RRTConnect"):
        planner.plan(carry(tmp_path), transit="ompl:Dijkstra")
