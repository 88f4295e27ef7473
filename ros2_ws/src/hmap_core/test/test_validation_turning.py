"""The judge rejects grasps in which the object turns between the pads by its weight: a book tilts, and slips."""

import numpy as np
import pytest
import validation_fixtures as plans

from hmap_core.validation import Kind, check

LENGTH = 0.3  # m, of the book along x
MASS = 0.8  # kg
FRICTION = 0.5
FORCE = 20.0  # N of the gripper
RADIUS = 0.5 * np.hypot(0.02, 0.04)  # m, from the middle of a pad's patch to its corners: 2 cm wide, 4 cm deep


@pytest.fixture(scope="module")
def urdf(tmp_path_factory):
    return plans.write_gantry(tmp_path_factory.mktemp("gantry"))


def book(urdf: str, aside: float, mass: float = MASS, force: float = FORCE, mode: str = "physical") -> dict:
    """A plan that lifts, carries and places a book, gripped some distance in m beside its middle."""
    plan = plans.carry(urdf)
    plan["mode"], plan["robots"]["gantry"]["gripper"]["force"] = mode, force
    body = next(body for body in plan["scene"]["bodies"] if body["name"] == "cube")
    body["size"], body["mass"], body["friction"] = [LENGTH, *body["size"][1:]], mass, FRICTION
    body["pose"][0] += aside
    plan["goal"]["pose"][0] += aside
    for pose in plan["trajectory"]["objects"]["cube"]:
        pose[0] += aside
    for segment in plan["segments"]:
        if segment.get("contact_pose"):
            segment["contact_pose"][0] -= aside
    return plan


def test_a_book_is_held_near_its_middle(urdf):
    report = check(book(urdf, 0.01))
    assert report.valid, report.violations


def test_a_book_held_at_its_end_tilts_and_slips(urdf):
    report = check(book(urdf, 0.13))
    assert plans.kinds(report) == {"grasp_turns"}
    found = plans.worst(report, Kind.GRASP_TURNS)
    assert set(found.bodies) == {"gantry/hand", "cube"}
    assert found.amount == pytest.approx(0.13 * MASS * 9.81, rel=1e-3)
    assert found.limit == pytest.approx(1.02 * 2.0 * FRICTION * FORCE * RADIUS, rel=1e-3)


def test_weight_and_force_decide(urdf):
    assert check(book(urdf, 0.13, mass=0.1)).valid
    assert check(book(urdf, 0.13, force=200.0)).valid
    assert "grasp_turns" in plans.kinds(check(book(urdf, 0.06, force=8.5)))


def test_kinematic_plans_are_not_asked(urdf):
    assert check(book(urdf, 0.13, mode="kinematic")).valid
