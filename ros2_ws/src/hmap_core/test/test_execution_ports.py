"""The same scripted executions over the simulation and over a world that is seen late, as in a graph."""

from contextlib import contextmanager

import pytest
from execution_scenarios import ROBOT, SCENARIOS, TIMED, Stage, dragging
from kinematic_world import KinematicWorld, kinematic_ports

from hmap_core.execution.plan_executor import PlanExecutor
from hmap_core.simulation.ports import simulated_ports
from hmap_core.simulation.world import SimulatedWorld


@contextmanager
def simulated(plan):
    with SimulatedWorld(plan.scene) as world:
        ports = simulated_ports(world)
        yield Stage(ports, world, lambda: world.state().q[ROBOT], lambda: ports.controllers.pass_time(0.1))


@contextmanager
def kinematic(plan):
    world = KinematicWorld(plan.scene)
    yield Stage(kinematic_ports(world), world, lambda: world.now.q[ROBOT], lambda: world.advance(0.1))


@pytest.mark.parametrize("scenario", SCENARIOS + TIMED, ids=lambda scenario: scenario.__name__)
@pytest.mark.parametrize("stage_of", [simulated, kinematic], ids=lambda stage_of: stage_of.__name__)
def test_executions_end_alike(stage_of, scenario):
    scenario(stage_of)


@pytest.mark.parametrize("stage_of", [simulated, kinematic], ids=lambda stage_of: stage_of.__name__)
def test_the_same_plan_gives_the_same_report(stage_of):
    reports = []
    for _ in range(2):
        with stage_of(dragging()) as stage:
            reports.append(PlanExecutor(stage.ports).run(dragging()).last)
    assert reports[0] == reports[1]
