"""Tools that are held otherwise than planned: the hand moves so that the tool follows the plan."""

import numpy as np
import pytest
from kinematic_world import KinematicWorld, kinematic_ports
from plan_fixtures import Writer
from simulation_fixtures import box, scene

from hmap_core import transforms
from hmap_core.execution.plan_executor import PlanExecutor
from hmap_core.execution.recovery import RecoveryPolicy
from hmap_core.execution.stretches import stretches
from hmap_core.execution.tool_offsets import blend
from hmap_core.types import BodyKind, Goal, Plan, SegmentKind

STICK = np.array([0.45, -0.1, 0.02])
GRASP = STICK + [0.02, 0.0, 0.0]
AWAY = (0.7, 0.3, 0.03)


@pytest.fixture(scope="module")
def plan() -> Plan:
    """Pick a stick, bring it to where it would push, draw it back, and place it."""
    stick = box("stick", (0.3, 0.04, 0.04), STICK, BodyKind.TOOL, mass=0.15)
    w = Writer(scene(stick, box("box", (0.06, 0.06, 0.06), AWAY), goal=Goal("box", transforms.pose(AWAY))))
    w.move(GRASP + [0, 0, 0.15])
    w.move(GRASP)
    w.grip(0.04)
    w.segment(0.0, SegmentKind.TRANSIT)
    for by in ([0, 0, 0.05], [0, 0.15, 0.05], [0, 0.1, 0.05], [0, 0, 0.05], [0, 0, 0]):
        start = w.time
        w.move(GRASP + by, "stick")
        w.segment(start, SegmentKind.GRASP, "stick")
    start = w.time
    w.grip(0.08)
    w.move(GRASP + [0, 0, 0.15])
    w.segment(start, SegmentKind.TRANSIT)
    return w.plan()


def deviations(plan: Plan, off: np.ndarray, replans: int) -> list[tuple[float, float]]:
    """m and rad of the stick off the plan after each stretch, if it stood ``off`` (7,) its place."""
    world = KinematicWorld(plan.scene)
    world.move_body("stick", transforms.multiply(plan.scene.bodies["stick"].pose, off))
    found = []

    def look(stretch) -> None:
        found.append(transforms.distance(world.now.poses["stick"], plan.trajectory.objects["stick"][stretch.last]))

    def none(request):
        raise AssertionError(request.reason)

    executor = PlanExecutor(kinematic_ports(world), on_stretch=look)
    report = executor.run(plan, none, RecoveryPolicy(replans=replans))
    assert report.solved, report.reason
    end = plan.trajectory.joints["left"][-1]
    assert world.now.q["left"] == pytest.approx(end, abs=1e-6)  # the hand returns to the plan
    return found


OFF = transforms.from_rpy((0.0027, 0.001, 0.0), (0.0, 0.0, np.deg2rad(0.7)))


def test_a_tool_that_is_held_otherwise_follows_the_plan_after_a_look(plan):
    found = deviations(plan, OFF, 1)
    looked = next(k for k, (distance, _) in enumerate(found) if distance < 1e-3)
    lift = next(k for k, stretch in enumerate(stretches(plan)) if "stick" in stretch.touched)
    assert looked == lift + 1
    assert all(distance == pytest.approx(0.0029, abs=1e-4) for distance, _ in found[:looked])
    assert all(distance < 1e-6 and angle < 1e-5 for distance, angle in found[looked:])


def test_without_looks_it_stays_as_it_is(plan):
    assert all(distance > 0.0025 for distance, _ in deviations(plan, OFF, 0))


@pytest.mark.parametrize("by", [0.0002, 0.006])
def test_noise_and_what_slips_far_is_not_corrected(plan, by):
    found = deviations(plan, transforms.pose((by, 0.0, 0.0)), 1)
    assert [distance for distance, _ in found] == pytest.approx([by] * len(found), abs=1e-6)


def test_a_correction_comes_in_without_leaving_its_range():
    share = blend(np.sort(np.r_[np.linspace(-0.1, 1.1, 1001), 1.0 - np.logspace(-16, -3, 100_000)]))
    assert share.min() == 0.0 and share.max() == 1.0 and (np.diff(share) >= -1e-12).all()
