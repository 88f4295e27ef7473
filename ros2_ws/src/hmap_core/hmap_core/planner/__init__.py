"""Planning of manipulation: H-MaP (Algorithms 1 to 3 of the paper), its extension points, and plan repair."""

from hmap_core.deadline import DEFAULT_TIME_LIMIT
from hmap_core.planner.components import PlannerComponents, local_components
from hmap_core.planner.free_motion import plan_motion
from hmap_core.planner.hmap_planner import HmapPlanner, PlanningJob
from hmap_core.planner.interfaces import Progress, RobotContact, SubTrajectory
from hmap_core.planner.plan import plan
from hmap_core.planner.protocols import (
    ContactChecker,
    ContactFinder,
    ContactProposals,
    ContactProposer,
    ContactQuery,
    ContactSearchQuery,
    ManipulationPlanner,
    ObjectPathPlanner,
    ObjectPathQuery,
    SegmentPlanner,
    SegmentQuery,
    SharedQuery,
    ToolQuery,
)
from hmap_core.planner.search import J_MAX

__all__ = [
    "DEFAULT_TIME_LIMIT",
    "J_MAX",
    "ContactChecker",
    "ContactFinder",
    "ContactProposals",
    "ContactProposer",
    "ContactQuery",
    "ContactSearchQuery",
    "HmapPlanner",
    "ManipulationPlanner",
    "ObjectPathPlanner",
    "ObjectPathQuery",
    "PlannerComponents",
    "PlanningJob",
    "Progress",
    "RobotContact",
    "SegmentPlanner",
    "SegmentQuery",
    "SharedQuery",
    "SubTrajectory",
    "ToolQuery",
    "local_components",
    "plan",
    "plan_motion",
]
