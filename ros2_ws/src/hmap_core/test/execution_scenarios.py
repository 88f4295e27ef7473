"""Small scripted executions that have to end alike over all implementations of the ports."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from plan_fixtures import drag_plan
from simulation_fixtures import box, scene

from hmap_core import transforms
from hmap_core.exceptions import Code, PlannerError
from hmap_core.execution.pace import Pace
from hmap_core.execution.plan_executor import PlanExecutor
from hmap_core.execution.ports import Ports
from hmap_core.execution.recovery import RecoveryPolicy
from hmap_core.kinematics.arm import load_arm
from hmap_core.planner.assembly import scene_at
from hmap_core.simulation.dynamic import sphere
from hmap_core.types import Goal, Plan

ROBOT = "left"
SIZE = (0.06, 0.06, 0.06)
START = np.array([0.5, -0.05, 0.03])
BY = np.array([0.0, 0.1, 0.0])
SCENE = scene(box("box", SIZE, START), goal=Goal("box", transforms.pose(START + BY)))
DISPLACED = 0.05  # rad from its start at which an arm is on its way
STILL = 2e-3  # rad; an arm that moves less stands


@dataclass
class Stage:
    """A world, and ports to it.

    Attributes:
        ports: of a plan executor.
        world: with ``add_body``, ``remove_body`` and ``move_body``.
        q: the joints (n,) of the robot.
        wait: lets a moment pass.
    """

    ports: Ports
    world: Any
    q: Callable[[], np.ndarray]
    wait: Callable[[], None]

    def under_way(self) -> bool:
        """Whether the arm has left its start."""
        return bool(np.abs(self.q() - SCENE.robots[ROBOT].q).max() > DISPLACED)

    def stands(self) -> bool:
        before = self.q().copy()
        self.wait()
        return bool(np.abs(self.q() - before).max() < STILL)


StageOf = Callable[[Plan], AbstractContextManager[Stage]]


def dragging() -> Plan:
    """A box is dragged by 10 cm."""
    return drag_plan(SCENE, "box", 0.06, BY)


def follow_to_the_end(stage_of: StageOf) -> None:
    plan, told = dragging(), []
    with stage_of(plan) as stage:
        report = PlanExecutor(stage.ports, on_progress=lambda *what: told.append(what)).run(plan)
        assert report.solved, report.reason
        assert report.code is Code.SUCCESS and report.reason == "" and report.error is None
        assert report.goal_error.position_m < 0.005 and report.plans == (plan,) and report.replans == ()
        assert stage.ports.observation.settled().poses["box"][:3] == pytest.approx(START + BY, abs=5e-3)
        assert any("grasp box" in text for _, _, text in told) and stage.stands()


def grip_on_nothing(stage_of: StageOf) -> None:
    """Somebody takes the box away; without new plans that ends the execution, and a new plan makes up for it."""
    plan, asked = dragging(), []
    aside = transforms.pose(START + [0.1, 0.0, 0.0])

    def replan(request) -> Plan:
        asked.append(request)
        return drag_plan(scene_at(SCENE, request.state), "box", 0.06, START + BY - request.state.poses["box"][:3])

    with stage_of(plan) as stage:
        executor = PlanExecutor(stage.ports, on_progress=away_once(stage, aside))
        report = executor.run(plan)
        assert not report.solved and report.code is Code.OBJECT_DROPPED
        assert f"gripper of '{ROBOT}'" in report.reason and "without 'box' between its fingers" in report.reason
    with stage_of(plan) as stage:
        # after the last look before the grasp: while the arm is on its way, bodies are not compared with the plan
        executor = PlanExecutor(stage.ports, on_progress=away_once(stage, aside, "grasp"))
        report = executor.run(plan, replan, RecoveryPolicy(replans=1, strict=False))
        assert report.solved, report.reason
        (request,) = asked
        assert "between its fingers" in request.reason and request.attempt == 1 and request.blocked is None
        assert request.state.gripper[ROBOT] > 0.079 and len(report.plans) == 2
        assert request.state.poses["box"][:3] == pytest.approx(aside[:3], abs=2e-3)


def away_once(stage: Stage, pose: np.ndarray, when: str = ""):
    """Moves the box, once, when a stretch begins whose label has a word."""
    done = []

    def on_progress(now: float, end: float, label: str) -> None:
        if when in label and not done:
            done.append(True)
            stage.world.move_body("box", pose)
            stage.wait()

    return on_progress


def cancel(stage_of: StageOf) -> None:
    plan = dragging()
    with stage_of(plan) as stage:
        with pytest.raises(PlannerError) as caught:
            PlanExecutor(stage.ports, canceled=stage.under_way).run(plan)
        assert caught.value.code is Code.CANCELED
        assert stage.stands() and stage.under_way()
        end = plan.trajectory.joints[ROBOT][-1]
        assert np.abs(stage.q() - end).max() > DISPLACED
        assert stage.ports.observation.settled().poses["box"][:3] == pytest.approx(START, abs=2e-3)


def blocked_ahead(stage_of: StageOf) -> None:
    """A ball appears where the hand soon comes by: everything stops, and a new plan solves the task without it."""
    plan, asked, stops, added = dragging(), [], [], []
    arm = load_arm(plan.scene.robots[ROBOT].model)
    # somewhat above the place over the box, on the way of the hand
    rows = plan.trajectory.joints[ROBOT]
    tips = arm.end_effectors(rows)[:, :3]
    k = int(np.flatnonzero(np.linalg.norm(tips - tips[0], axis=1) > 0.7 * np.linalg.norm(tips[0] - START))[0])
    ball = sphere("ball", 0.02, tips[k])

    def appear() -> bool:
        if not added and stage.under_way():
            added.append(True)
            stage.world.add_body(ball)
        return False

    def replan(request) -> Plan:
        asked.append((request, stage.stands(), stage.q().copy()))
        stage.world.remove_body("ball")
        stage.wait()
        return drag_plan(scene_at(SCENE, request.state), "box", 0.06, START + BY - request.state.poses["box"][:3])

    with stage_of(plan) as stage:
        executor = PlanExecutor(stage.ports, canceled=appear, on_stop=stops.append)
        report = executor.run(plan, replan, RecoveryPolicy(obstacle_replans=1, strict=False))
        assert report.solved, report.reason
        ((request, stood, q),) = asked
        assert stood and "ball" in request.scene.bodies and request.blocked[0] is plan
        assert request.state.q[ROBOT] == pytest.approx(q, abs=0.01)
        assert len(stops) == 1 and "'ball'" in stops[0] and "'ball' is in the way" in request.reason
    added.clear()
    with stage_of(plan) as stage:
        report = PlanExecutor(stage.ports, canceled=appear).run(plan)
        assert not report.solved and report.code is Code.WAY_BLOCKED and stage.stands()


def pause(stage_of: StageOf) -> None:
    """Paused on the way, where nothing moves for a second, and resumed; once with and once without the box."""
    for carried in (False, True):
        plan, pace, stood = dragging(), Pace(), []

        def look(carried=carried, pace=pace, stood=stood) -> bool:
            if pace.paused:
                stood.append((stage.ports.clock.now(), stage.q().copy()))
                if stood[-1][0] - stood[0][0] > 2.0:
                    pace.resume()
            elif not stood and stage.under_way():
                shift = np.abs(stage.ports.observation.state().poses["box"][:3] - START).max()
                if not carried or shift > 0.02:
                    pace.pause()
            return False

        with stage_of(plan) as stage:
            report = PlanExecutor(stage.ports, canceled=look, pace=pace).run(plan)
            assert report.solved, report.reason
            late = [q for at, q in stood if at - stood[0][0] > 1.0]
            assert len(late) > 10 and np.ptp(late, axis=0).max() < STILL
            assert np.abs(late[0] - plan.trajectory.joints[ROBOT]).max(axis=1).min() < 0.02  # on the path


def slow(stage_of: StageOf) -> None:
    """Slower from the start, and slower on the way: it takes longer, and ends alike."""
    plan, speeds = dragging(), []

    def duration(pace: Pace, look) -> float:
        with stage_of(plan) as stage:
            looked, last = look(stage, pace), [(0.0, stage.q().copy())]

            def watch() -> bool:
                now = stage.ports.clock.now()
                if now - last[0][0] > 0.1:
                    speeds[-1].append(np.abs(stage.q() - last[0][1]).max() / (now - last[0][0]))
                    last[0] = now, stage.q().copy()
                return looked()

            speeds.append([])
            began = stage.ports.clock.now()
            report = PlanExecutor(stage.ports, canceled=watch, pace=pace).run(plan)
            assert report.solved, report.reason
            return stage.ports.clock.now() - began

    def nothing(stage, pace):
        return lambda: False

    def later(stage, pace):
        def look() -> bool:
            if pace.speed == 1.0 and stage.under_way():
                pace.set_speed(0.3)
            return False

        return look

    full, half = duration(Pace(), nothing), duration(Pace(0.5), nothing)
    assert half > full + 0.5 * plan.trajectory.time[-1]
    assert max(speeds[1]) < 0.6 * max(speeds[0])
    gentle = duration(Pace(acceleration=0.25), nothing)
    assert gentle == pytest.approx(half, rel=0.02)
    assert duration(Pace(), later) > half
    assert max(speeds[-1][len(speeds[-1]) // 2 :]) < 0.4 * max(speeds[0])


def cancel_a_pause(stage_of: StageOf) -> None:
    plan, pace, looks = dragging(), Pace(), []

    def look() -> bool:
        if stage.under_way():
            pace.pause()
            looks.append(stage.ports.clock.now())
        return bool(looks) and looks[-1] - looks[0] > 2.0

    with stage_of(plan) as stage:
        with pytest.raises(PlannerError) as caught:
            PlanExecutor(stage.ports, canceled=look, pace=pace).run(plan)
        assert caught.value.code is Code.CANCELED and stage.stands() and stage.under_way()


SCENARIOS = (follow_to_the_end, grip_on_nothing, cancel, blocked_ahead, pause, cancel_a_pause)
TIMED = (slow,)  # need a clock that runs with the world
