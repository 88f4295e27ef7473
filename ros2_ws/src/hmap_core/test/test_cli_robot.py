"""``hmap robot check`` and ``hmap robot new``: exit codes, one line for an error, and JSON."""

import json

import pytest
from arm_fixtures import urdf_of
from gripper_fixtures import arm_urdf, slide_urdf, write_robot

from hmap_core.cli import main
from hmap_core.scenes import load_robot_model

FEW = ("--samples", "20")


@pytest.fixture
def urdf(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(f'<robot name="robot">{arm_urdf()}{slide_urdf()}</robot>')
    return path


def output(capsys) -> tuple[str, str]:
    captured = capsys.readouterr()
    return captured.out, captured.err


def test_a_robot_file_is_written_and_can_be_used(urdf, tmp_path, capsys):
    out = tmp_path / "mine.yaml"
    assert main(["robot", "new", str(urdf), "--out", str(out), *FEW]) == 0
    printed, _ = output(capsys)
    assert "end_effector: guess: between the pads" in printed and f"robot file      {out}" in printed
    assert load_robot_model(str(out)).gripper.open_opening == pytest.approx(0.08)
    assert main(["robot", "check", str(out)]) == 0
    printed, _ = output(capsys)
    assert printed.splitlines()[-1].startswith("can be used: 0 errors")
    assert "opens 0.0 to 80.0 mm" in printed and "left_slide" in printed and "1 cylinder" in printed


def test_the_same_urdf_gives_the_same_file(urdf, tmp_path):
    texts = []
    for _ in range(2):
        assert main(["robot", "new", str(urdf), "--out", str(tmp_path / "mine.yaml"), "--force", *FEW]) == 0
        texts.append((tmp_path / "mine.yaml").read_text())
    assert texts[0] == texts[1]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["missing.urdf"], "no such file"),
        (["robot.urdf", "--out", "no/such/folder/x.yaml"], "there is no folder"),
        (["robot.urdf", "--out", "x.urdf"], "a robot file ends with .yaml or .yml"),
        (["robot.urdf", "--out", "old.yaml"], "exists; --force replaces it"),
        (["robot.urdf", "--tip", "nowhere"], "--tip nowhere: no such link"),
        (["broken.urdf"], "is not XML"),
        (["loop.urdf"], "loop"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(urdf, tmp_path, capsys, monkeypatch, options, says):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old.yaml").write_text("mine\n")
    (tmp_path / "broken.urdf").write_text("<robot")
    (tmp_path / "loop.urdf").write_text(
        '<robot name="r"><link name="a"/><link name="b"/>'
        '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
        '<joint name="k" type="fixed"><parent link="b"/><child link="a"/></joint></robot>'
    )
    before = sorted(path.name for path in tmp_path.iterdir())
    assert main(["robot", "new", *options]) == 2
    _, error = output(capsys)
    problem = error.strip().splitlines()[-1]
    assert problem.startswith("hmap: [input/") and says in problem and "Traceback" not in error
    assert sorted(path.name for path in tmp_path.iterdir()) == before
    assert (tmp_path / "old.yaml").read_text() == "mine\n"


def test_a_report_is_json(urdf, capsys):
    assert main(["robot", "check", str(urdf), "--json"]) == 0
    report = json.loads(output(capsys)[0])
    assert report["usable"] is True and report["findings"] == []
    roles = {row["name"]: row["role"] for row in report["joints"]}
    assert roles["pan"] == "arm" and roles["left_slide"] == "gripper"
    assert report["mass"] == pytest.approx(sum(row["mass"] for row in report["links"]))
    assert report["links"][0] == {"name": "base", "mass": 4.0, "shapes": {"cylinder": 1}}
    assert 1.0 < report["reach"] < 1.3 and report["gripper"]["open_opening"] == pytest.approx(0.08)


def test_errors_of_a_urdf_are_findings(urdf, capsys):
    urdf.write_text(urdf.read_text().replace('axis xyz="0 0 1"', 'axis xyz="0 0 0"', 1).replace('"0.07"', '"-1"'))
    assert main(["robot", "check", str(urdf), "--json"]) == 1
    report = json.loads(output(capsys)[0])
    assert report["usable"] is False
    assert [finding["severity"] for finding in report["findings"]] == ["error", "error"]
    assert all("robot.urdf" in finding["file"] and finding["line"] for finding in report["findings"])
    assert main(["robot", "check", str(urdf)]) == 1
    printed, _ = output(capsys)
    assert "error: " in printed and printed.splitlines()[-1] == "cannot be used: 2 errors, 0 warnings"


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("joints: [pan,", "joints: [pn,", "Did you mean 'pan'?"),
        ("urdf: slide.urdf", "urdf: other.urdf", "file not found"),
        ("urdf: slide.urdf", "udf: slide.urdf", "unknown key"),
        ("per_joint: [-0.5, 0.5]", "per_joint: [-0.4, 0.4]", "per_joint"),
    ],
)
def test_errors_of_a_robot_file_are_findings(tmp_path, capsys, old, new, says):
    path = write_robot(tmp_path, "slide")
    path.write_text(path.read_text().replace(old, new, 1))
    assert main(["robot", "check", str(path)]) == 1
    printed, error = output(capsys)
    assert says in printed and "slide.yaml" in printed and "cannot be used: 1 error, 0 warnings" in printed
    assert "Traceback" not in error


def test_a_home_in_collision_is_a_warning(tmp_path, capsys):
    path = write_robot(tmp_path, "slide")
    text = path.read_text()
    bare = text[: text.index("ignored_collisions:")] + text[text.index("simulation:") :]
    path.write_text(bare.replace("-1.57, 1.8,", "-1.57, 3.09,"))
    assert main(["robot", "check", str(path), "--json"]) == 0
    warnings = [f for f in json.loads(output(capsys)[0])["findings"] if f["element"] == "home"]
    assert "overlap by" in warnings[0]["text"] and "collision_pairs" in warnings[0]["remedy"]


@pytest.mark.parametrize("robot", ["panda", "ur5e_2f85", "iiwa"])
def test_robots_that_come_along_are_checked_by_name(capsys, robot):
    assert main(["robot", "check", robot, "--json"]) == 0
    assert json.loads(output(capsys)[0])["findings"] == []


def test_an_unknown_robot_is_bad_input(capsys):
    assert main(["robot", "check", "pnda"]) == 2
    assert "Did you mean 'panda'?" in output(capsys)[1]


def test_a_robot_is_drawn(tmp_path, capsys):
    picture = tmp_path / "fr3.png"
    assert main(["robot", "check", str(urdf_of("fr3")), "--picture", str(picture)]) == 0
    assert picture.read_bytes().startswith(b"\x89PNG") and str(picture) in output(capsys)[0]
