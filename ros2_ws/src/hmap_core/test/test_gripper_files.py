"""What an error says of a gripper in a robot file that does not fit together, or to the URDF."""

import pytest
from gripper_fixtures import write_robot

from hmap_core.exceptions import Code, InputError
from hmap_core.scenes import load_robot_model

CASES = [
    # kind, old, new, what the error says
    ("four_bar", "closed: 0.7", "closed: -0.05", "gripper.open = 0.0: finger_links are 0.0798 m apart here and 0.0846"),
    ("four_bar", "closed: 0.7", "closed: 1.5", "closed = 1.5: puts left_knuckle_joint at 1.5000; the URDF allows -0.1"),
    ("four_bar", "closed: 0.7", "closed: [0.7, 0.7]", "closed = [0.7, 0.7]: has 2 numbers; joints has 1"),
    ("four_bar", "  closed: 0.7\n", "", "gripper: give per_joint, or closed and open"),
    ("four_bar", "closed: 0.7", "per_joint: 0.5", "gripper: give per_joint, or closed and open"),
    ("four_bar", "closed: 0.7", "closed: x", "gripper.closed = 'x': refers to the unknown parameter 'x'"),
    ("four_bar", "closed: 0.7", "closed: {a: 1}", "gripper.closed: must be a number, or a list with one for each"),
    ("four_bar", "closed: 0.7", "closed: 0", "gripper.open = 0.0: must differ from closed: every joint has to move"),
    ("four_bar", "open: 0.0", "open: 0.0\n  at_zero: 0", "at_zero = 0: goes with per_joint, not with closed and open"),
    (
        "four_bar",
        "open: 0.0",
        "open: 0.0\n  open_opening: 0.2",
        "open_opening = 0.2: must be between 0.0000 and 0.0798",
    ),
    (
        "four_bar",
        "open: 0.0",
        "open: 0.0\n  max_opening: 0.09",
        "max_opening = 0.09: must be above min_opening, 1.999e",
    ),
    (
        "four_bar",
        "[left_knuckle_joint]",
        "[right_knuckle_joint]",
        "mimics left_knuckle_joint in the URDF; name that one",
    ),
    (
        "four_bar",
        "[left_finger, right_finger]",
        "[left_finger]",
        "have no shape on one side of the end-effector frame's",
    ),
    (
        "four_bar",
        "xyz: [0, 0, 0.1447]",
        "xyz: [0, 0.004, 0.1447]",
        "pose: the middle between finger_links is at y = -0.0040",
    ),
    ("four_bar", "xyz: [0, 0, 0.1447]", "xyz: [0, 0, 0.1747]", "finger_links end 0.0150 m behind it"),
    (
        "slide",
        "per_joint: [-0.5, 0.5]",
        "per_joint: [0.5, 0.5]",
        "puts left_slide at 0.0373; the URDF allows -0.0427 to",
    ),
    (
        "slide",
        "per_joint: [-0.5, 0.5]",
        "per_joint: [-0.5, 0]",
        "per_joint = [-0.5, 0]: must not be 0: every joint has",
    ),
    ("slide", "per_joint: [-0.5, 0.5]", "per_joint: [-0.5]", "per_joint = [-0.5]: has 1 numbers; joints has 2"),
    ("slide", "max_opening: 0.078", "max_opening: 0.09", "max_opening = 0.09: must be above min_opening, 0, and at"),
    ("slide", "  max_opening: 0.078\n", "", "gripper: with per_joint, max_opening and open_opening are needed"),
    ("slide", "[left_slide, right_slide]", "[left_slide, left_slide]", "joints[1] = 'left_slide': is named twice"),
    ("slide", "  max_opening", "  opn: 1\n  max_opening", "gripper.opn = 1: unknown key. Did you mean 'open'?"),
]


@pytest.mark.parametrize(("kind", "old", "new", "says"), CASES)
def test_a_wrong_gripper_is_named(tmp_path, kind, old, new, says):
    path = write_robot(tmp_path, kind)
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(InputError) as error:
        load_robot_model(str(path))
    assert says in error.value.reason and f"{path}:" in error.value.reason
    assert error.value.code == Code.INVALID_SCENE


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('joint="left_knuckle_joint"', 'joint="right_finger_joint"', "follows it in turn"),
        ('joint="left_knuckle_joint"', 'joint="nowhere"', "mimics 'nowhere', which is not in the URDF"),
        ('velocity="2"', 'velocity="0"', "the URDF's velocity limits do not let them move"),
    ],
)
def test_a_wrong_urdf_is_named(tmp_path, old, new, says):
    path = write_robot(tmp_path, "four_bar")
    urdf = tmp_path / "four_bar.urdf"
    urdf.write_text(urdf.read_text().replace(old, new))
    with pytest.raises(InputError, match=says) as error:
        load_robot_model(str(path))
    assert error.value.code == Code.INVALID_SCENE
