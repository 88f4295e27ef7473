"""How a subgoal of a blocked plan goes on: strategies in their order, the cheapest first."""

from hmap_core.planner.strategies.repair.as_planned import AsPlanned
from hmap_core.planner.strategies.repair.new_approach import NewApproach
from hmap_core.planner.strategies.repair.one_contact import OneContact
from hmap_core.planner.strategies.repair.replan_subgoal import ReplanSubgoal
from hmap_core.planner.strategies.repair.same_contact import SameContact

REHEARSED = (NewApproach(), SameContact(), OneContact())
REPAIR_STRATEGIES = (AsPlanned(), *REHEARSED, ReplanSubgoal())
