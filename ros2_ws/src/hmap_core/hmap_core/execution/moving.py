"""Arms on their way: they move together, change their pace, pause and go on, and come to rest along their path."""

from collections.abc import Callable, Mapping

import numpy as np

from hmap_core.exceptions import Code, ExecutionError, PlannerError
from hmap_core.execution.motion_clock import MotionClock
from hmap_core.execution.pace import Pace
from hmap_core.execution.ports import Canceled, Command, Ports
from hmap_core.execution.warp import HELD_SHARE, SHARE, Warp, constant, ramp_to, warped
from hmap_core.types import JointTrajectory, Robot

LEAD = 0.06  # s of the executor's clock that a command takes at most to reach its controller
HANG = 120.0  # s for one motion, beyond its duration
BRAKE_LIMIT = 10.0  # s of waiting for arms that brake
PAUSE_PERIOD = 0.05  # s between looks during a pause
Look = Callable[[], None]


class _Change(Exception):
    """The pace has changed, or everything shall end."""


class Moving:
    """Arms that move together, each along its own motion.

    Attributes:
        motions: robot -> its motion, with planned times.
        commands: robot -> its present command.
        clock: where they are.
    """

    def __init__(
        self,
        ports: Ports,
        canceled: Canceled,
        pace: Pace,
        robots: Mapping[str, Robot],
        motions: Mapping[str, JointTrajectory],
        held: bool,
        commanded: dict[str, np.ndarray],
    ):
        """Start the motions.

        Args:
            ports: to the controllers and the world.
            canceled: true stops every motion.
            pace: of all motions.
            robots: name -> robot.
            motions: robot -> its motion; all begin together.
            held: whether something is held, which has to stay in the fingers.
            commanded: robot -> the end (n,) of its last command, kept up to date.

        Raises:
            InputError, ExecutionError: as :meth:`ControllerPort.move`.
            PlannerError: CANCELED, during a pause.
        """
        self._ports, self._canceled, self._pace, self._held = ports, canceled, pace, held
        self._robots = {name: robots[name] for name in motions}
        self.motions, self.commands = dict(motions), dict[str, Command]()
        self._commanded = commanded
        self._rests: float | None = None  # s into the motions where they come to rest before their end
        self._asked = 1.0
        self._left = 0.0  # s that the commands take
        wait_while_paused(ports, canceled, pace)
        self._begin(constant(self._positive_rate()))

    def clock_now(self) -> float:
        """Seconds into the motions by now, as planned."""
        return self.clock.into()

    @property
    def known(self) -> bool:
        """Whether all controllers have told where they are."""
        return all(command.feedback for command in self.commands.values())

    def follow(self, look: Look | None = None) -> None:
        """Wait for the end of the motions; their pace may change meanwhile.

        Args:
            look: as in :meth:`ControllerPort.wait`.

        Raises:
            PlannerError: CANCELED; everything stands.
            ExecutionError: as :meth:`ControllerPort.wait`.
        """
        while True:
            try:
                self._wait(self._left + HANG, lambda: self._look(look))
            except _Change:
                if self._canceled():
                    self._end()
                self._change(self._pace.rate, self._share(HELD_SHARE if self._held else SHARE))
                continue
            if self._rests is None:
                return
            wait_while_paused(self._ports, self._canceled, self._pace, look)
            self._go_on(self._rests)

    def brake(self) -> float:
        """Bring the arms to rest along their path, and wait for it.

        Returns:
            seconds into the motions at which they rest.

        Raises:
            PlannerError: CANCELED.
            ExecutionError: as :meth:`ControllerPort.wait`.
        """
        if self._rests is None:
            self._change(0.0, self._share(HELD_SHARE if self._held else SHARE))
        self._ports.controllers.wait(list(self.commands.values()), HANG, self._canceled)
        return self.clock.end if self._rests is None else self._rests

    def _share(self, share: float) -> float:
        """Of the joints' acceleration limits within which the pace changes."""
        return share * self._pace.acceleration

    def _positive_rate(self) -> float:
        """The rate of the pace; that of before a pause which has just begun."""
        self._asked = self._pace.rate or self._asked
        return self._asked

    def _look(self, look: Look | None) -> None:
        if self.known and (self._canceled() or (self._rests is None and self._pace.rate != self._asked)):
            raise _Change
        if look is not None:
            look()

    def _wait(self, limit: float, look: Look) -> None:
        """Wait for the commands; controllers that have not told where they are are canceled by the port."""
        self._ports.controllers.wait(
            list(self.commands.values()), limit, lambda: self._canceled() and not self.known, look
        )

    def _end(self) -> None:
        """Come to rest as fast as the joints allow.

        Raises:
            PlannerError: CANCELED.
        """
        try:
            if self._rests is None:
                self._change(0.0, SHARE)
            self._ports.controllers.wait(list(self.commands.values()), BRAKE_LIMIT, lambda: False)
        except ExecutionError:
            pass  # it is stopped below, whatever went wrong
        self._ports.controllers.stop()
        raise PlannerError("canceled; the motion was stopped", Code.CANCELED)

    def _change(self, rate: float, share: float) -> None:
        """Go on at another rate, or come to rest before the end where that is possible."""
        self._asked = rate
        at = self.clock.at()
        if at is None:
            return
        limits = {name: robot.model.acceleration_limits for name, robot in self._robots.items()}
        begin = at + LEAD * self.clock.rate
        if float(self.clock.warp.into(begin)) >= self.clock.end:
            return
        warp = ramp_to(rate, self.motions, limits, self.clock.warp, begin, share)
        if warp is not None:
            self._rests = warp.settled if rate == 0.0 else None
            self._send(warp, self.clock.start)
            self.clock.replaced(warp)

    def _go_on(self, at: float) -> None:
        """Go on from where they rest, ``at`` seconds into the motions."""
        limits = {name: robot.model.acceleration_limits for name, robot in self._robots.items()}
        rest, share = Warp(0.0, at, 0.0, 0.0, 0.0), self._share(HELD_SHARE if self._held else SHARE)
        warp = ramp_to(self._positive_rate(), self.motions, limits, rest, 0.0, share)
        self._rests = None
        self._begin(warp or constant(self._asked))

    def _begin(self, warp: Warp) -> None:
        """Start from rest."""
        start = self._ports.controllers.common_start() if len(self.motions) > 1 else None
        self._send(warp, start)
        self.clock = MotionClock(self.motions, self.commands, self._ports.clock, warp, start)

    def _send(self, warp: Warp, start: float | None) -> None:
        sent = {name: warped(motion, warp) for name, motion in self.motions.items()}
        for name, motion in sent.items():
            self.commands[name] = self._ports.controllers.move(self._robots[name], motion, start)
            self._commanded[name] = np.array(motion.positions[-1])
        self._left = max((float(motion.times[-1] - motion.times[0]) for motion in sent.values()), default=0.0)


def wait_while_paused(ports: Ports, canceled: Canceled, pace: Pace, look: Look | None = None) -> None:
    """Wait for the end of a pause, if there is one.

    Args:
        ports: to the world.
        canceled: asked while waiting.
        pace: that is paused.
        look: called now and then.

    Raises:
        PlannerError: CANCELED.
    """
    while pace.paused:
        if look is not None:
            look()
        ports.observation.wait_for_change(np.inf, PAUSE_PERIOD, lambda: canceled() or not pace.paused)
        if canceled():
            raise PlannerError("canceled; the motion was paused", Code.CANCELED)
