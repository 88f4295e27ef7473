"""The judge: decides whether a plan is valid, and reports every violated rule.

The judge shares nothing with the planner but the exceptions. It reads the plan file itself, computes its own kinematics
from the URDF, and measures exact distances with coal, also between the samples. ``docs/validation.md`` explains every
rule.
"""

from hmap_core.validation.judge import check, executed_clearance
from hmap_core.validation.report import Kind, Report, Violation

__all__ = ["Kind", "Report", "Violation", "check", "executed_clearance"]
