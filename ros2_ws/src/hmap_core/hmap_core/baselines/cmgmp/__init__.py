"""Contact-mode-guided manipulation planning (CMGMP); ``docs/baselines.md`` describes it."""

from hmap_core.baselines.cmgmp.planner import CmgmpPlanner

__all__ = ["CmgmpPlanner"]
