"""Something that can be played: a plan, a run while it goes on, or a recorded bag."""

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hmap_core.trajectory.samples import state_at
from hmap_core.transforms import interpolate
from hmap_core.types import Plan, Scene, SceneState
from hmap_core.viz.captions import caption

Clouds = Mapping[str, np.ndarray]


@dataclass
class Recording:
    """States of a scene over time; linear between them (rotations along the shortest arc).

    Attributes:
        name: for people.
        scene: the scene.
        times: s from the start, increasing.
        states: one for each time.
        captions: what is going on from a time (s) on, in the order of time.
        plans: the plan that is followed from a time (s) on, in the order of time.
        searches: what was tried for a plan, told at a time (s), in the order of time.
        clouds: what cameras see from a time (s) on: object -> points (N, 3), world frame, m; in the order of time.
        began: s, stamp of the first state; None before there is one, or where there are no stamps.
    """

    name: str
    scene: Scene
    times: list[float] = field(default_factory=list)
    states: list[SceneState] = field(default_factory=list)
    captions: list[tuple[float, str]] = field(default_factory=list)
    plans: list[tuple[float, Plan]] = field(default_factory=list)
    searches: list[tuple[float, dict[str, Any]]] = field(default_factory=list)
    clouds: list[tuple[float, Clouds]] = field(default_factory=list)
    began: float | None = None

    @property
    def duration(self) -> float:
        """s."""
        return self.times[-1] if self.times else 0.0

    def restart(self, began: float) -> None:
        """Begin anew at a stamp (s), with the plan that is followed now."""
        self.began = began
        for entries in (self.times, self.states, self.captions):
            entries.clear()
        self.plans = [(0.0, plan) for _, plan in self.plans[-1:]]
        self.searches = [(0.0, search) for _, search in self.searches[-1:]]
        self.clouds = [(0.0, clouds) for _, clouds in self.clouds[-1:]]

    def add(self, time: float, state: SceneState) -> None:
        """Add a newer state; one that is not newer than the last one is left out."""
        if not self.times or time > self.times[-1]:
            self.times.append(time)
            self.states.append(state)

    def state(self, t: float) -> SceneState:
        """Where everything is at a time (s); at the ends beyond them."""
        if not self.times:
            return self.scene.start_state()
        k = bisect_right(self.times, t)
        if k == 0 or k == len(self.times):
            return self.states[min(k, len(self.times) - 1)]
        before, after = self.states[k - 1], self.states[k]
        share = (t - self.times[k - 1]) / (self.times[k] - self.times[k - 1])
        return SceneState(
            q={n: q + share * (after.q[n] - q) if n in after.q else q for n, q in before.q.items()},
            gripper={n: g + share * (after.gripper.get(n, g) - g) for n, g in before.gripper.items()},
            poses={n: _between(T, after.poses.get(n, T), share) for n, T in before.poses.items()},
        )

    def caption(self, t: float) -> str:
        """What is going on at a time (s)."""
        return newest(self.captions, t) or ""

    def cloud(self, t: float) -> Clouds:
        """What cameras see at a time (s)."""
        return newest(self.clouds, t) or {}

    def plan(self, t: float) -> Plan | None:
        """The plan that is followed at a time (s), or the first one before that."""
        return newest(self.plans, t) or (self.plans[0][1] if self.plans else None)

    def search(self, t: float) -> dict[str, Any] | None:
        """What was tried for the plan at a time (s)."""
        return newest(self.searches, t) or (self.searches[0][1] if self.searches else None)


def _between(T: np.ndarray, after: np.ndarray, share: float) -> np.ndarray:
    """The pose (7,) at a share of the way from one to another; most bodies rest."""
    return T if np.array_equal(T, after) else interpolate(T, after, share)


def newest(entries: Sequence[tuple[float, Any]], t: float) -> Any:
    """The value of the last entry whose time is not after ``t``; None where there is none."""
    k = bisect_right(entries, t, key=lambda entry: entry[0])
    return entries[k - 1][1] if k else None


def of_plan(plan: Plan, name: str = "") -> Recording:
    """A plan as it would be followed."""
    times = [float(t) for t in plan.trajectory.time]
    states = [state_at(plan, k) for k in range(len(times))]
    captions = [(times[k], caption(plan, k)) for k in range(len(times))]
    search = plan.stats.get("search")
    searches = [(0.0, search)] if isinstance(search, dict) else []
    return Recording(name or plan.scene.task, plan.scene, times, states, captions, [(0.0, plan)], searches)
