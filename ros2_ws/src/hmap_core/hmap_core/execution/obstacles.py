"""Bodies that come in the way of a plan: how far it is followed on, how everything stops, how hands come free.

The stop is along the path (:mod:`hmap_core.execution.moving`); where a hand lets go and how it leaves the object is
computed by :mod:`hmap_core.planner.interruption`.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from hmap_core.execution.failures import Blocked
from hmap_core.execution.hands import Hands
from hmap_core.execution.ports import Ports
from hmap_core.execution.stretch_clock import StretchClock
from hmap_core.execution.stretches import Stretch
from hmap_core.planner.conflicts import Conflict, first_conflict, unknown_bodies
from hmap_core.planner.interruption import (
    back_to,
    clear_sample,
    contact_at,
    good_until,
    grasps_at,
    release,
    stable_sample,
)
from hmap_core.planner.planned_contacts import PlannedContact
from hmap_core.trajectory.samples import index_at
from hmap_core.types import Body, Plan, Robot

BACK_OFF = 0.2  # s of the plan before a place too near to a new body to which a hand goes back
MOVING = 1e-6  # rad; a joint that moves less in a stretch stands still
SAME_TIME = 1e-6  # s


class StopNow(Exception):
    """The plan cannot be followed to the next place where the hands are free."""

    def __init__(self, conflict: Conflict):
        self.conflict = conflict


class ObstacleMonitor:
    """Watches for bodies in the way of one plan, and gets the robots out of a stretch that they block."""

    def __init__(self, plan: Plan, ports: Ports, hands: Hands, free_tools: Callable[[int], bool]):
        """
        Args:
            plan: that is followed.
            ports: to the world.
            hands: the arms and grippers.
            free_tools: frees the hands that hold tools at a sample of the plan; whether there were any.
        """
        self._plan, self._ports, self._hands, self._free_tools = plan, ports, hands, free_tools
        self._watched: Mapping[str, Body] | None = None
        self._until: tuple[float, Conflict] | None = None

    def look(self, clock: StretchClock) -> None:
        """Where the scene has changed: check the rest of the plan.

        Raises:
            StopNow: it cannot be followed to the next place where the hands are free.
        """
        scene = self._ports.observation.scene()
        if scene is None or scene.bodies is self._watched:
            return
        self._watched = scene.bodies
        now = clock.now()
        conflict = first_conflict(self._plan, unknown_bodies(self._plan, scene.bodies), now)
        if conflict is None:
            self._until = None
            return
        until = good_until(self._plan, now, conflict)
        if until is None:
            raise StopNow(conflict)
        self._until = (until, conflict)

    def check(self, stretch: Stretch) -> None:
        """At the begin of a stretch: whether the plan is still good in it.

        Raises:
            Blocked: a body is in the way, and the hands are free.
        """
        start = float(self._plan.trajectory.time[stretch.first])
        if self._until is not None and start >= self._until[0] - SAME_TIME:
            conflict = self._until[1]
            self._free_tools(stretch.first)
            self._hands.let_go(self._plan)
            raise Blocked(conflict, start)

    def leave(self, at: float) -> float:
        """Free the hands where everything stopped.

        Args:
            at: planned time (s) of the place.

        Returns:
            the planned time (s) up to which the object followed the plan.

        Raises:
            PlannerError: CANCELED.
            ExecutionError: TRACKING_LOST.
        """
        plan, time = self._plan, self._plan.trajectory.time
        if self._free_tools(index_at(time, at)):
            self._hands.let_go(plan)
            return at
        for body in dict.fromkeys(self._hands.held.values()):
            holders = [name for name, other in self._hands.held.items() if other == body]
            if len(holders) > 1:
                return self._leave_together(holders, body, at)
        contact = contact_at(plan, at)
        if contact is None:
            return at
        robot = plan.scene.robots[contact.segment.robot]
        if at <= time[contact.begin] + SAME_TIME:
            self._leave_approach(contact, robot, at)
            return float(time[contact.first])
        q = plan.trajectory.joints[robot.name]
        if at > time[contact.end] + SAME_TIME and np.abs(q[index_at(time, at)] - q[contact.end]).max() > MOVING:
            return at
        sample = stable_sample(plan, contact, min(at, float(time[contact.end])))
        if time[sample] < at - 2.0 * (time[1] - time[0]):
            self._go_back((robot.name,), sample, at)
            at = float(time[sample])
        state = self._hands.start_state(plan, sample)
        opening, motion = release(self._ports.scene(), state, plan, contact)
        self._hands.open(robot, opening)
        self._hands.move(robot, motion)
        return at

    def _leave_together(self, robots: Sequence[str], body: str, at: float) -> float:
        """Robots that hold one body bring it back to where it stood, together, and let it go one after the other."""
        plan, time = self._plan, self._plan.trajectory.time
        held = grasps_at(plan, at, robots, body)
        latest = max(held, key=lambda contact: contact.begin)  # before that, not all of them hold it
        sample = stable_sample(plan, latest, min(at, float(time[latest.end])))
        if time[sample] < at - 2.0 * (time[1] - time[0]):
            self._go_back(robots, sample, at)
            at = float(time[sample])
        for contact in held:
            state = self._hands.start_state(plan, sample)
            opening, motion = release(self._ports.scene(), state, plan, contact)
            robot = plan.scene.robots[contact.segment.robot]
            self._hands.open(robot, opening)
            self._hands.move(robot, motion)
        return at

    def _leave_approach(self, contact: PlannedContact, robot: Robot, at: float) -> None:
        """Go back on the way to a contact until the hand is clear of the object, and of the new body."""
        plan = self._plan
        sample = min(clear_sample(plan, contact, at), self._free_sample(contact, at))
        if plan.trajectory.time[sample] < at - SAME_TIME:
            opening = plan.trajectory.gripper.get(robot.name)
            self._hands.open(robot, None if opening is None else float(opening[sample]))
            self._go_back((robot.name,), sample, at)

    def _free_sample(self, contact: PlannedContact, at: float) -> int:
        """The last sample on the way to a contact, up to ``at`` (s), before the way comes too near to a new body."""
        plan, time = self._plan, self._plan.trajectory.time
        new = unknown_bodies(plan, self._ports.scene().bodies)
        conflict = first_conflict(plan, new, float(time[contact.first]), at)
        until = at if conflict is None else conflict.time - BACK_OFF
        return max(contact.first, index_at(time, until))

    def _go_back(self, robots: Sequence[str], sample: int, at: float) -> None:
        plan = self._plan
        state = self._hands.start_state(plan, index_at(plan.trajectory.time, at))
        motions = back_to(plan, robots, sample, state.q, at)
        self._hands.start(plan.scene.robots, motions).follow()
