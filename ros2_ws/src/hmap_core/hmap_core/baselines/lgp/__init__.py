"""Logic-geometric programming with a search for the skeleton; ``docs/baselines.md`` describes it."""

from hmap_core.baselines.lgp.planner import LgpPlanner

__all__ = ["LgpPlanner"]
