"""Low objects: the fingertips grip them, off what they stand on."""

from dataclasses import replace

import numpy as np
import pytest
from simulation_fixtures import box, scene

from hmap_core.contacts.hand import hand_of
from hmap_core.planner.diagnosis import hand_fits
from hmap_core.planner.protocols import ContactQuery
from hmap_core.planner.sampled_contacts import SampledContacts
from hmap_core.scenes import load_robot_model
from hmap_core.transforms import apply, rotation_matrix
from hmap_core.types import ContactKind

FLOOR_ROOM = 0.003  # m that robots keep from what stands around


def low(model: str, height: float, width: float = 0.016):
    made = scene(box("die", (width, width, height), (0.45, 0.0, height / 2), mass=0.05))
    robot = load_robot_model(model)
    return replace(made, robots={"left": replace(made.robots["left"], model=robot, q=robot.home.copy())})


def grasps(made) -> list:
    state = made.start_state()
    query = ContactQuery(made, state, "die", state.poses["die"][None], "left", np.random.default_rng(0))
    return [c for batch in SampledContacts().propose(query) for c in batch.contacts if c.kind == ContactKind.GRASP]


@pytest.mark.parametrize(
    "model, height",
    [("panda", 0.01), ("fr3", 0.017), ("xarm7", 0.017), ("ur5e_2f85", 0.017), ("gen3_2f85", 0.017),
     ("iiwa14_wsg50", 0.017), ("xarm6", 0.022)],
)  # fmt: skip
def test_a_hand_grips_low_objects(model, height):
    made = low(model, height)
    assert hand_fits(made, made.start_state(), "die")


@pytest.mark.parametrize("model, height", [("panda", 0.003), ("ur5e_2f85", 0.006)])
def test_what_is_lower_than_the_room_below_the_fingers_is_not_gripped(model, height):
    made = low(model, height)
    assert not hand_fits(made, made.start_state(), "die")


def test_fingers_that_are_drawn_back_still_cover_the_object():
    made = low("panda", 0.01)
    gripper, T = made.robots["left"].model.gripper, made.start_state().poses["die"]
    off = []
    for contact in grasps(made):
        tip = apply(T, contact.T_obj_ee[:3] + gripper.tip_offset * rotation_matrix(contact.T_obj_ee)[:, 2])
        upright = -rotation_matrix(contact.T_obj_ee)[2, 2]
        if upright > 0.99 and tip[2] > FLOOR_ROOM:
            assert tip[2] <= 0.01 - 0.002  # 2 mm of the object are between the pads at least
            off.append(tip[2])
    assert off


def test_high_objects_are_gripped_as_before():
    made = low("panda", 0.08, 0.04)
    hand, body = hand_of(made.robots["left"]), made.bodies["die"]
    assert body.shapes and hand.gripper is not None
    depths = {round(float(c.T_obj_ee[:3] @ [0, 0, 1]) - float(c.point[2]), 6) for c in grasps(made) if _level(c)}
    assert depths == {0.0}


def _level(contact) -> bool:
    """Whether the hand is horizontal, and its fingertips far above the floor."""
    return abs(rotation_matrix(contact.T_obj_ee)[2, 2]) < 1e-6 and contact.point[2] > -0.02
