"""Execute a plan with simulated robots under dynamics, and say whether it solved its task.

Nothing but the joints and the fingers is ever commanded, through the same controllers that a robot would have.
"""

from collections.abc import Callable
from contextlib import closing

import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.execution.drift import DriftTolerance
from hmap_core.execution.plan_executor import PlanExecutor, Progress
from hmap_core.execution.recovery import RecoveryPolicy, Replanner
from hmap_core.execution.report import ClosedLoopReport, ExecutionReport
from hmap_core.execution.stretches import Stretch, check_executable, plan_error
from hmap_core.simulation.engines import MUJOCO, PYBULLET, open_world
from hmap_core.simulation.physics_world import PhysicsWorld
from hmap_core.simulation.ports import SimulatedControllers, simulated_ports
from hmap_core.simulation.trajectory_controller import START_TOLERANCE
from hmap_core.types import Plan, Scene, SegmentKind

START_SETTLE = 0.2  # s for the bodies to come to rest before anything moves

Between = Callable[[PhysicsWorld, Stretch], None]


def execute(plan: Plan, on_progress: Progress | None = None) -> ExecutionReport:
    """Execute a plan from its scene's start to its end, whatever happens, in a simulation of its own.

    The same plan gives the same report.

    Args:
        plan: what is executed.
        on_progress: called at the begin of every stretch: planned time now and at the end (s), what is being done.

    Raises:
        InputError: the plan is kinematic, or inconsistent with its scene.
    """
    return execute_closed_loop(plan, None, 0, on_progress=on_progress).last


def execute_closed_loop(
    plan: Plan,
    replan: Replanner | None,
    max_replans: int,
    tolerance: DriftTolerance | None = None,
    on_progress: Progress | None = None,
    between: Between | None = None,
    engine: str = PYBULLET,
    actual: Scene | None = None,
) -> ClosedLoopReport:
    """Execute a plan in a simulation of its own, and new plans where the world is not as planned.

    Args:
        plan: to begin with.
        replan: plans the rest from a measured state; None: nothing is planned anew.
        max_replans: how often it is called after something went wrong, and as often again because a body came in the
            way; 0 follows the plan to its end, whatever happens.
        tolerance: of bodies between contacts; at the end it is the scene's execution tolerance for the goal's object.
        on_progress: as in :func:`execute`, of the plan that is being executed.
        between: called after every stretch, to disturb the world.
        engine: one of :data:`hmap_core.simulation.engines.ENGINES`.
        actual: the scene as it is, if that differs from what the plan knows; only the world has it.

    Raises:
        InputError: the plan is kinematic, or inconsistent with its scene; the engine is not installed, or it cannot
            execute a contact of the plan.
    """
    check_executable(plan)
    _check_start(plan)
    _check_presses(plan, engine)
    policy = RecoveryPolicy(max_replans, max_replans, drift=tolerance or DriftTolerance())
    with closing(open_world(plan.scene, engine, actual)) as world:
        controllers = SimulatedControllers(world)
        controllers.pass_time(START_SETTLE)
        ports = simulated_ports(world, controllers)
        on_stretch = None if between is None else lambda stretch: between(world, stretch)
        return PlanExecutor(ports, on_progress=on_progress, on_stretch=on_stretch).run(plan, replan, policy)


def _check_start(plan: Plan) -> None:
    """Raises InputError where the trajectory does not start where its scene has the robots."""
    for name, q in plan.scene.start_state().q.items():
        off = np.abs(plan.trajectory.joints[name][0] - q)
        if off.max() > START_TOLERANCE:
            joint = plan.scene.robots[name].model.joint_names[int(off.argmax())]
            raise plan_error(
                f"it starts {off.max():.3f} rad from where joint '{joint}' of '{name}' is in its scene; "
                f"{START_TOLERANCE:g} is allowed"
            )


def _check_presses(plan: Plan, engine: str) -> None:
    """Raises InputError where an engine has no hands that press with a force, and the plan needs them."""
    press = next((segment for segment in plan.segments if segment.kind is SegmentKind.PRESS), None)
    if engine == MUJOCO and press is not None:
        raise InputError(
            f"the plan presses on '{press.object}' at {press.start:.2f} s, and engine '{MUJOCO}' has no hands that "
            f"press with a force; use engine '{PYBULLET}'"
        )
