"""The judge: says whether a plan is valid, and if not, what is wrong with it.

It shares nothing with the planner but the exceptions: its own reading of the file, its own kinematics from the URDF,
and exact distances through coal, also between the samples. ``docs/validation.md`` explains every rule.
"""

from hmap_core.validation.judge import check
from hmap_core.validation.report import Kind, Report, Violation

__all__ = ["Kind", "Report", "Violation", "check"]
