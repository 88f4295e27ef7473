"""Multi-modal bidirectional RRT over the joints of a robot and the object; ``docs/baselines.md`` describes it."""

from hmap_core.baselines.birrt.planner import BirrtPlanner

__all__ = ["BirrtPlanner"]
