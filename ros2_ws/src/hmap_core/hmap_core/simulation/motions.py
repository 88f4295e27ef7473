"""Desired joint motions over time: along a trajectory, and to a stop."""

import numpy as np


class Follow:
    """Motion along the points of a trajectory, cubic with velocities and straight without; rests after the end."""

    def __init__(
        self,
        start: float,
        times: np.ndarray,
        positions: np.ndarray,
        velocities: np.ndarray | None,
        efforts: np.ndarray | None = None,
    ):
        """From ``start`` (s) on, at ``times`` (N,) after it.

        Args:
            start: s.
            times: (N,) s.
            positions: (N, n) rad.
            velocities: (N, n) rad/s.
            efforts: (N, n) N m beside those that follow the motion.
        """
        self._start, self._times, self._q, self._qd = start, times, positions, velocities
        self._efforts = efforts
        self.end = start + float(times[-1])

    def at(self, now: float) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n,) in rad and velocities (n,) in rad/s at a time (s)."""
        t = now - self._start
        if t >= self._times[-1]:
            return self._q[-1].copy(), np.zeros(self._q.shape[1])
        k = max(0, int(np.searchsorted(self._times, t, side="right")) - 1)
        h = self._times[k + 1] - self._times[k]
        s = max(0.0, t - self._times[k]) / h
        slope = (self._q[k + 1] - self._q[k]) / h
        if self._qd is None:
            return self._q[k] + s * h * slope, slope
        a, b = self._qd[k], self._qd[k + 1]
        # cubic Hermite: deviations of the end velocities from the mean one
        u, v = a - slope, b - slope
        q = self._q[k] + h * (s * slope + s * (1 - s) * ((1 - s) * u - s * v))
        return q, slope + (1 - s) * (1 - 3 * s) * u + s * (3 * s - 2) * v

    def efforts_at(self, now: float) -> np.ndarray:
        """Efforts (n,) in N m at a time (s), beside those that follow the motion; none after the end."""
        t = now - self._start
        if self._efforts is None or t >= self._times[-1]:
            return np.zeros(self._q.shape[1])
        return np.array([np.interp(t, self._times, column) for column in self._efforts.T])


class Stop:
    """Motion straight on to rest, all joints at once, each within its acceleration limit."""

    def __init__(self, start: float, q: np.ndarray, qd: np.ndarray, acceleration_limits: np.ndarray):
        self._start, self._q, self._qd = start, np.array(q, float), np.array(qd, float)
        self._duration = float((np.abs(qd) / acceleration_limits).max())
        self.end = start + self._duration

    def at(self, now: float) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n,) in rad and velocities (n,) in rad/s at a time (s)."""
        if now >= self.end:
            return self._q + 0.5 * self._duration * self._qd, np.zeros_like(self._qd)
        t = max(0.0, now - self._start)
        return self._q + (t - 0.5 * t * t / self._duration) * self._qd, (1.0 - t / self._duration) * self._qd

    def efforts_at(self, now: float) -> np.ndarray:
        """No efforts (n,) beside those that follow the motion."""
        return np.zeros_like(self._qd)
