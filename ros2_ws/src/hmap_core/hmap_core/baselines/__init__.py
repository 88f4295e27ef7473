"""Methods that H-MaP is compared with, one folder each; ``docs/baselines.md`` describes them.

Each is a :class:`hmap_core.planner.protocols.ManipulationPlanner` that :mod:`hmap_core.planner.plugins` knows by name.
It is built on the planner's own parts and returns the same kind of plan, so judge and execution treat all alike.
"""
