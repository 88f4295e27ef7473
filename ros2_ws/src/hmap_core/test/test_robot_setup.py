"""Guesses of ``hmap robot new``: arm, tip, gripper and home, and what is left out with a reason."""

import numpy as np
import pytest
from arm_fixtures import ARMS, new_robot, urdf_of
from gripper_fixtures import arm_urdf, box, four_bar_urdf, joint, link, mimic, shape, slide_urdf

from hmap_core.exceptions import Code, InputError
from hmap_core.kinematics.arm import load_arm
from hmap_core.kinematics.urdf import load_urdf
from hmap_core.robot_setup.guess import guess_robot
from hmap_core.robot_setup.robot_text import draft_model, with_loadable_gripper
from hmap_core.robot_setup.self_distance import SelfDistance
from hmap_core.robot_setup.structure import find_structure
from hmap_core.scenes import load_robot_model, resources
from hmap_core.transforms import apply, to_matrix

TIPS = {  # arm -> link of the end effector, and height (m) of its frame in it
    "ur5e_2f85": ("gripper_base", 0.148),
    "xarm7": ("xarm_gripper_base_link", 0.159),
    "iiwa14_wsg50": ("wsg50_base", 0.141),
    "gen3_2f85": ("gripper_base", 0.148),
    "fr3": ("fr3_hand", 0.1014),
}
OPENING = {"ur5e_2f85": 0.0845, "xarm7": 0.0873, "iiwa14_wsg50": 0.1046, "gen3_2f85": 0.0845, "fr3": 0.08}  # m


def write(folder, body: str, name: str = "robot"):
    path = folder / f"{name}.urdf"
    path.write_text(f'<robot name="{name}">{body}</robot>')
    return path


def structure_of(path, tip=None):
    return find_structure(load_urdf(path), path, tip)


@pytest.mark.parametrize("arm", ARMS)
def test_arm_tip_and_gripper_are_found(arm):
    guess = guess_robot(urdf_of(arm))
    name, height = TIPS[arm]
    assert len(guess.joint_names) == (6 if arm == "ur5e_2f85" else 7) and not guess.structure.others
    assert guess.link == name
    T = to_matrix(guess.T_link_ee)
    np.testing.assert_allclose(T[:3, 3], [0.0, 0.0, height], atol=1e-3)
    np.testing.assert_allclose(T[:3, :3], np.eye(3), atol=1e-9)
    gripper = draft_model(guess).gripper
    assert gripper.open_opening == pytest.approx(OPENING[arm], abs=2e-4) and gripper.min_opening < 2e-3
    assert gripper.max_opening == pytest.approx(gripper.open_opening - 0.004)


@pytest.mark.parametrize("name", ["panda", "xarm6"])
def test_guesses_agree_with_the_robot_files_that_come_along(name):
    known = load_robot_model(name)
    guess = guess_robot(known.urdf)
    drafted = draft_model(guess)
    assert drafted.joint_names == known.joint_names and drafted.end_effector_link == known.end_effector_link
    np.testing.assert_allclose(drafted.T_link_ee, known.T_link_ee, atol=6e-3)
    own, other = drafted.gripper, known.gripper
    assert set(own.finger_links) == set(other.finger_links)
    assert own.open_opening == pytest.approx(other.open_opening, abs=1e-3)
    assert own.pad_half_width == pytest.approx(other.pad_half_width, abs=1e-3)
    tips = [gripper.tip_offset + T[2] for gripper, T in ((own, drafted.T_link_ee), (other, known.T_link_ee))]
    assert tips[0] == pytest.approx(tips[1], abs=1e-3)


def test_an_arm_without_gripper_ends_where_its_last_link_does():
    known = load_robot_model("iiwa")
    guess = guess_robot(known.urdf)
    assert guess.gripper is None and "gripper" not in guess.notes
    assert guess.link == known.end_effector_link
    np.testing.assert_allclose(guess.T_link_ee, known.T_link_ee, atol=1e-3)


def test_a_finger_may_open_towards_its_lower_limit(tmp_path):
    guess = guess_robot(write(tmp_path, arm_urdf() + slide_urdf()))
    entry = guess.gripper.entry()
    assert entry["per_joint"] == pytest.approx([-0.5, 0.5]) and entry["at_zero"] == pytest.approx([-0.0027, 0.0027])
    assert entry["open_opening"] == pytest.approx(0.08)


def test_a_linkage_closes_where_its_fingers_meet(tmp_path):
    gripper = draft_model(guess_robot(write(tmp_path, arm_urdf() + four_bar_urdf()))).gripper
    assert gripper.joint_names == ("left_knuckle_joint",)
    assert gripper.min_opening == pytest.approx(0.0, abs=1e-3)


def test_a_hand_that_closes_along_its_x_axis_gets_a_turned_frame(tmp_path):
    body = fingers(2, 0.5 * np.pi)
    guess = guess_robot(write(tmp_path, arm_urdf() + body))
    T = to_matrix(guess.T_link_ee)
    np.testing.assert_allclose(np.abs(T[:3, :3]), [[0, 1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-6)


def fingers(count: int, start: float = 0.0) -> str:
    """Fingers on rails, evenly round a hand, the first one turned by ``start`` (rad) from its y axis."""
    parts = [link("hand", 0.6, shape(box(0.06, 0.06, 0.08), "0 0 0.04"))]
    for k in range(count):
        turn = f"0 0 {start + 2.0 * np.pi * k / count}"
        parts += [
            link(f"finger{k}", 0.05, shape(box(0.02, 0.01, 0.05), "0 0.02 0.025"), 5e-5),
            joint(f"slide{k}", "prismatic", "hand", f"finger{k}", "0 0 0.08", turn, "0 1 0", (0.0, 0.04),
                  mimic("slide0") if k else ""),
        ]  # fmt: skip
    return "".join(parts)


def test_three_fingers_are_left_out_with_the_reason(tmp_path):
    guess = guess_robot(write(tmp_path, arm_urdf() + fingers(3)))
    assert guess.gripper is None
    (note,) = guess.notes["gripper"]
    assert note.startswith("left out: finger joint 'slide") and "two sides" in note


def test_two_fingers_are_a_gripper(tmp_path):
    guess = guess_robot(write(tmp_path, arm_urdf() + fingers(2)))
    assert guess.gripper.gaps == pytest.approx((0.03, 0.11))
    assert guess.gripper.entry()["min_opening"] == pytest.approx(0.03)


def test_fingers_that_move_differently_are_left_out_with_the_reason(tmp_path):
    body = fingers(2).replace('multiplier="1.0"', 'multiplier="0.8"')
    (note,) = guess_robot(write(tmp_path, arm_urdf() + body)).notes["gripper"]
    assert "the middle between finger0 and finger1 moves by" in note


def test_a_linkage_without_mimic_is_left_out_with_the_reason(tmp_path):
    body = four_bar_urdf()
    while "<mimic" in body:
        start = body.index("<mimic")
        body = body[:start] + body[body.index("/>", start) + 2 :]
    (note,) = guess_robot(write(tmp_path, arm_urdf() + body)).notes["gripper"]
    assert "6 independent joints" in note and "need a <mimic>" in note


def test_a_single_jaw_is_no_joint_of_the_arm(tmp_path):
    jaw = link("hand", 0.6, shape(box(0.06, 0.06, 0.08), "0 0 0.04")) + link("jaw", 0.1, shape(box(0.02, 0.02, 0.06)))
    jaw += joint("gripper", "revolute", "hand", "jaw", "0 0.02 0.08")
    structure = structure_of(write(tmp_path, arm_urdf() + jaw))
    assert len(structure.arm) == 6 and structure.palm == "hand" and not structure.fingers
    assert any("single jaw" in note for note in structure.notes)


def two_arms() -> str:
    """A torso with two arms of two joints, each with two fingers."""
    parts = [link("torso", 5.0, shape(box(0.2, 0.4, 0.5)))]
    for side, y in (("left", 0.3), ("right", -0.3)):
        parts += [
            link(f"{side}_upper", 1.0, shape(box(0.05, 0.05, 0.3), "0 0 0.15")),
            joint(f"{side}_1", "revolute", "torso", f"{side}_upper", f"0 {y} 0.3"),
            joint(f"{side}_2", "continuous", f"{side}_upper", f"{side}_hand", "0 0 0.3"),
        ]
        parts.append(fingers(2).replace('"hand"', f'"{side}_hand"').replace("finger", f"{side}_finger")
                     .replace("slide", f"{side}_slide"))  # fmt: skip
    return "".join(parts)


def test_of_two_arms_the_first_is_taken_and_the_other_can_be_chosen(tmp_path):
    path = write(tmp_path, two_arms())
    structure = structure_of(path)
    assert [joint.name for joint in structure.arm] == ["left_1", "left_2"]
    assert any("right_hand" in note and "--tip" in note for note in structure.notes)
    assert {joint.name for joint in structure.others} == {"right_1", "right_2", "right_slide0"}
    chosen = guess_robot(path, "right_hand")
    assert chosen.joint_names == ["right_1", "right_2"] and chosen.gripper.joints == ("right_slide0",)
    np.testing.assert_allclose(chosen.limits[:, 1], [-np.pi, np.pi], atol=1e-6)
    assert any("right_2, which have no limits" in note for note in chosen.notes["position_limits"])


@pytest.mark.parametrize(
    ("body", "tip", "says"),
    [
        (link("alone", 1.0, ""), None, "no joint moves"),
        (arm_urdf() + link("hand", 1.0, ""), "hnad", "--tip hnad: no such link. Did you mean 'hand'?"),
        (arm_urdf() + link("hand", 1.0, ""), "base", "no independent joint moves link 'base'"),
    ],
)
def test_what_has_no_arm_is_refused(tmp_path, body, tip, says):
    with pytest.raises(InputError) as error:
        structure_of(write(tmp_path, body), tip)
    assert says in error.value.reason and "robot.urdf" in error.value.reason
    assert error.value.code == Code.INVALID_SCENE


def test_a_gripper_that_cannot_be_loaded_is_left_out_with_the_reason(tmp_path):
    body = fingers(2).replace('velocity="2"', 'velocity="0"')
    guess = guess_robot(write(tmp_path, arm_urdf() + body))
    assert guess.gripper is not None
    kept = with_loadable_gripper(guess)
    (note,) = kept.notes["gripper"]
    assert kept.gripper is None and note.startswith("left out: ") and str(tmp_path) not in note
    assert draft_model(kept).gripper is None


def test_a_guess_that_cannot_be_used_names_the_urdf(tmp_path):
    """A joint of the arm that another one mimics."""
    body = arm_urdf().replace("</joint>", mimic("pan") + "</joint>", 6).replace(mimic("pan"), "", 5)
    path = write(tmp_path, body + link("hand", 0.6, shape(box(0.06, 0.06, 0.08), "0 0 0.04")))
    for attempt in (draft_model, with_loadable_gripper):
        with pytest.raises(InputError, match="mimics it in the URDF") as error:
            attempt(guess_robot(path))
        assert error.value.reason.startswith(f"{path}: joints")


@pytest.mark.parametrize("arm", ["ur5e_2f85", "gen3_2f85"])
def test_home_is_free_of_collisions_with_the_hand_pointing_down(tmp_path, arm):
    path = new_robot(tmp_path, urdf_of(arm), "--samples", "300")
    model = load_robot_model(str(path))
    built = load_arm(model)
    distance, _ = SelfDistance(built).nearest(model.home)
    T = built.end_effector(model.home)
    assert distance > 0.01 and T[0] > 0.2 and T[2] > 0.1
    assert apply(T, [0.0, 0.0, 1.0])[2] - T[2] < -0.99
    text = path.read_text()
    assert "# guess: free of collisions, the hand in front of the base" in text and "ignored_collisions:" in text


def test_the_urdf_is_named_so_that_the_file_can_be_moved_with_it(tmp_path):
    urdf = tmp_path / "mine" / "robot.urdf"
    urdf.parent.mkdir()
    write(urdf.parent, arm_urdf() + slide_urdf())
    assert "\nurdf: robot.urdf\n" in new_robot(urdf.parent, urdf, "--samples", "50").read_text()
    assert "\nurdf: mine/robot.urdf\n" in new_robot(tmp_path, urdf, "--samples", "50").read_text()
    known = new_robot(tmp_path, urdf_of("fr3"), "--samples", "50").read_text()
    assert "\nurdf: hmap_scenes://urdf/fr3.urdf\n" in known
    assert resources.package_path("hmap_scenes").name == "hmap_scenes"
