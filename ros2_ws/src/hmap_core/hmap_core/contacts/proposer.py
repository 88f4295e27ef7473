"""The place of the learned network in Algorithm 3.

The paper asks a network for contact points first and falls back to sampling the object's point cloud when what it
proposes is infeasible. A proposer is whatever answers that first question; its contacts go through the same
feasibility check as sampled ones, so a poor proposer costs time and nothing else.
"""

from typing import Protocol

import numpy as np

from hmap_core.types import ContactPoint, Scene, SceneState


class Proposer(Protocol):
    """Proposes contacts from the state of the world, best first."""

    def propose(self, state: SceneState, scene: Scene, object: str, waypoints: np.ndarray) -> list[ContactPoint]:
        """Contacts for moving ``object`` from where it is in ``state`` through ``waypoints`` (I, 7), best first."""
        ...


class NoProposer:
    """Proposes nothing: every contact is sampled."""

    def propose(self, state: SceneState, scene: Scene, object: str, waypoints: np.ndarray) -> list[ContactPoint]:
        """None."""
        return []
