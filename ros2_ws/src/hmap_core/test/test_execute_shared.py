"""Two arms that carry one object are stopped on their way: they bring it back together, and begin anew."""

from pathlib import Path

import numpy as np
import pytest

from hmap_core import planner
from hmap_core.execution.plan_executor import PlanExecutor
from hmap_core.execution.recovery import RecoveryPolicy
from hmap_core.planner.interruption import back_to, grasps_at
from hmap_core.planner.segments.attached import end_effector_poses
from hmap_core.scenes import load_scene
from hmap_core.simulation.dynamic import sphere
from hmap_core.simulation.ports import simulated_ports
from hmap_core.simulation.world import SimulatedWorld
from hmap_core.transforms import distance, inverse, multiply
from hmap_core.types import SegmentKind

EXAMPLE = Path(__file__).parents[4] / "docs" / "examples" / "two_arms.yaml"
RADIUS = 0.02  # m of a ball that comes in the way
APART = 5e-4  # m that one hand may move against the other


@pytest.fixture(scope="module")
def plan():
    return planner.plan(load_scene(str(EXAMPLE)), seed=0)


@pytest.fixture(scope="module")
def carried(plan):
    """The segment of one of the hands while both carry the bar."""
    grasps = [s for s in plan.segments if s.kind == SegmentKind.GRASP]
    return next(s for s in grasps if sum((o.start, o.end) == (s.start, s.end) for o in grasps) == 2)


def test_both_hands_hold_the_bar_half_way(plan, carried):
    at = 0.5 * (carried.start + carried.end)
    held = grasps_at(plan, at, ("right", "left"), "bar")
    assert [contact.segment.robot for contact in held] == ["right", "left"]
    assert all(contact.segment.start == carried.start for contact in held)


def test_two_arms_go_back_together(plan, carried):
    time, names = plan.trajectory.time, ("left", "right")
    first, at = int(np.searchsorted(time, carried.start)), 0.6 * carried.end + 0.4 * carried.start
    here = int(np.searchsorted(time, at))
    motions = back_to(
        plan, names, first, {name: plan.trajectory.joints[name][here] for name in names}, float(time[here])
    )
    hands = []
    for name in names:
        assert motions[name].positions[-1] == pytest.approx(plan.trajectory.joints[name][first])
        np.testing.assert_array_equal(motions[name].times, motions["left"].times)
        hands.append(end_effector_poses(plan.scene, name, motions[name].positions))
    relative = [multiply(inverse(a), b) for a, b in zip(*hands, strict=True)]
    assert max(distance(T, relative[-1])[0] for T in relative) < APART


def test_a_bar_that_is_blocked_on_its_way_is_placed_where_it_stood_and_carried_anew(plan, carried):
    bar = plan.trajectory.objects["bar"]
    ball = sphere("ball", RADIUS, bar[-1, :3] + [0.0, 0.05, 0.0])  # where the bar has to go, away from the hands
    began, asked = [], []

    with SimulatedWorld(plan.scene) as world:

        def appear() -> bool:
            half = 0.5 * (carried.end - carried.start)
            if began and not asked and "ball" not in world.state().poses and world.time > began[0] + half:
                world.add_body(ball)
            return False

        def note(now: float, end: float, label: str) -> None:
            if now == pytest.approx(carried.start) and not began:
                began.append(world.time)

        def replan(request):
            asked.append(request)
            world.remove_body("ball")
            return planner.plan(plan.scene, request.state, seed=1)

        executor = PlanExecutor(simulated_ports(world), canceled=appear, on_progress=note)
        report = executor.run(plan, replan, RecoveryPolicy(obstacle_replans=1))
    assert report.solved, report.reason
    (request,) = asked
    assert "'ball' is in the way" in request.reason
    assert request.state.poses["bar"][:3] == pytest.approx(bar[0][:3], abs=0.01)  # back on the table
    assert min(request.state.gripper.values()) > 0.05  # both hands are free
