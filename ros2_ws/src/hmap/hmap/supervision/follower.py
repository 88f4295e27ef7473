"""Executes a plan through the controllers, stretch by stretch, and watches the objects between the stretches."""

from collections.abc import Callable

import numpy as np

from hmap.supervision.controllers import Controllers
from hmap.supervision.observer import Observer
from hmap_core import transforms
from hmap_core.exceptions import Code, ExecutionError
from hmap_core.execution.stretches import Stretch, check_executable, joint_trajectory, stretches
from hmap_core.types import BodyKind, Plan, SceneState

MOVING = 1e-6  # rad; a joint that moves less in a stretch stands still
OPENING_CHANGE = 1e-4  # m; a smaller change of the opening needs no command
EMPTY = 0.005  # m that the fingers may close beyond the planned opening when they hold something
LOST_POSITION, LOST_ANGLE = 0.05, np.deg2rad(30.0)  # m, rad off the plan at which a body counts as lost
HANG = 120.0  # s of real time for one stretch, beyond its planned duration
GRIP_LIMIT = 30.0  # s of real time for a gripper
STATE_PATIENCE = 5.0  # s for a world state

OnProgress = Callable[[float, float, str], None]  # planned time now and at the end (s), what is done


class Follower:
    """Follows plans; one at a time."""

    def __init__(self, controllers: Controllers, observer: Observer, canceled: Callable[[], bool]):
        self._controllers, self._observer, self._canceled = controllers, observer, canceled

    def follow(self, plan: Plan, on_progress: OnProgress) -> None:
        """Execute a plan from its start to its end.

        Raises:
            InputError: the plan cannot be executed at all.
            ExecutionError: TRACKING_LOST, OBJECT_DROPPED.
            PlannerError: CANCELED; the motion was stopped.
        """
        check_executable(plan)
        time = plan.trajectory.time
        self._openings: dict[str, float] = {}
        self._held: dict[str, str] = {}
        for stretch in stretches(plan):
            on_progress(float(time[stretch.first]), float(time[-1]), stretch.label)
            self._grip(plan, stretch)
            self._move(plan, stretch)
            self._watch(plan, stretch.last)

    def _grip(self, plan: Plan, stretch: Stretch) -> None:
        """Close on what is held from here, open what is let go, and wait until the fingers stand."""
        commands = {}
        for robot, placed in plan.scene.robots.items():
            gripper = placed.model.gripper
            if gripper is None:
                continue
            if robot in stretch.held:
                if self._held.get(robot) != stretch.held[robot]:
                    commands[robot] = self._controllers.grip(robot, gripper.min_opening, gripper.force)
                    self._openings.pop(robot, None)
                continue
            opening = float(plan.trajectory.gripper[robot][stretch.last])
            if abs(self._openings.get(robot, np.inf) - opening) > OPENING_CHANGE:
                commands[robot] = self._controllers.grip(robot, opening, gripper.force)
                self._openings[robot] = opening
        self._controllers.wait(list(commands.values()), self._canceled, GRIP_LIMIT)
        self._held = dict(stretch.held)
        for robot, command in commands.items():
            if robot in stretch.held:
                self._check_grip(plan, stretch, robot, command.result.position)

    def _check_grip(self, plan: Plan, stretch: Stretch, robot: str, opening: float) -> None:
        planned = float(plan.trajectory.gripper[robot][stretch.first])
        if opening < planned - EMPTY:
            raise ExecutionError(
                f"the gripper of {robot!r} closed to {opening:.3f} m without {stretch.held[robot]!r} between its "
                f"fingers; {planned:.3f} m were planned",
                Code.OBJECT_DROPPED,
            )

    def _move(self, plan: Plan, stretch: Stretch) -> None:
        commands, duration = [], 0.0
        for robot in plan.scene.robots:
            motion = joint_trajectory(plan, robot, stretch)
            if np.ptp(motion.positions, axis=0).max() > MOVING:
                duration = float(motion.times[-1])
                commands.append(
                    self._controllers.move(plan.scene, robot, motion.times, motion.positions, motion.velocities)
                )
        self._controllers.wait(commands, self._canceled, duration + HANG)

    def _watch(self, plan: Plan, sample: int) -> None:
        _, state = self._observer.state(STATE_PATIENCE)
        if _lost(plan, sample, state):  # or the state is of before the end of the stretch
            state = self._observer.settled(STATE_PATIENCE)
        for reason in _lost(plan, sample, state):
            raise ExecutionError(reason, Code.OBJECT_DROPPED)


def _lost(plan: Plan, sample: int, state: SceneState) -> list[str]:
    """What has become of the bodies that are far from where the plan has them."""
    reasons = []
    for name, body in plan.scene.bodies.items():
        if body.kind is BodyKind.FIXED:
            continue
        distance, angle = transforms.distance(plan.trajectory.objects[name][sample], state.poses[name])
        if distance > LOST_POSITION or angle > LOST_ANGLE:
            reasons.append(
                f"{name!r} is {distance:.3f} m and {np.rad2deg(angle):.0f} deg off the plan at "
                f"{plan.trajectory.time[sample]:.2f} s; {LOST_POSITION} m, {np.rad2deg(LOST_ANGLE):.0f} deg allowed"
            )
    return reasons
