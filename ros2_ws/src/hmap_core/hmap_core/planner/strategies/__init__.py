"""What Algorithm 1 tries, in its order: one strategy a file, all behind :class:`~.base.Strategy`."""

from hmap_core.planner.robot_order import UNLIKELY
from hmap_core.planner.strategies.attached_path import AttachedPathStrategy
from hmap_core.planner.strategies.attached_tool import AttachedToolStrategy
from hmap_core.planner.strategies.by_hand import ByHand, ByHandToTheEnd, ByHandWhereverItReaches
from hmap_core.planner.strategies.carry_heavy import CarryHeavy
from hmap_core.planner.strategies.carry_together import CarryTogether
from hmap_core.planner.strategies.ends_check import EndsCheck
from hmap_core.planner.strategies.goal_check import GoalCheck
from hmap_core.planner.strategies.hand_over import HandOver
from hmap_core.planner.strategies.manipulation_graph import ManipulationGraphStrategy
from hmap_core.planner.strategies.new_tool import NewTool
from hmap_core.planner.strategies.object_path import ObjectPathStrategy
from hmap_core.planner.strategies.pick_and_place import PickAndPlace
from hmap_core.planner.strategies.pressed_path import PressedPath
from hmap_core.planner.strategies.pushed_around import PushedAround
from hmap_core.planner.strategies.pushed_on import PushedOn
from hmap_core.planner.strategies.pushed_paths import PushedPaths
from hmap_core.planner.strategies.remove_obstacles import RemoveObstacles
from hmap_core.planner.strategies.slide_first import SlideFirst
from hmap_core.planner.strategies.tilt_in_steps import TiltInSteps

# for a path of the object, one round of the outer loop
PATH_STRATEGIES = (
    CarryHeavy(),
    TiltInSteps(),  # for arms with few joints only
    ObjectPathStrategy(),
    AttachedPathStrategy(),
    GoalCheck(),
    PickAndPlace(),
    HandOver(first=True),
    SlideFirst(),
    PushedPaths(),
    PushedOn(),
    PushedAround(),
    PressedPath(),
    EndsCheck(),  # what follows begins with a grasp, a push or a press
    CarryTogether(),
    ManipulationGraphStrategy(),
    HandOver(),
)
# at one waypoint, with all bodies where they are; they solve the relaxed problem, too. LAST_STRATEGIES follow.
CONTACT_STRATEGIES = (ByHandToTheEnd(), AttachedToolStrategy(), ByHand(), NewTool(), ByHandWhereverItReaches())
# as above, where hands are expected to serve little: with free hands, tools that are expected to serve come first
TOOL_FIRST = (NewTool(UNLIKELY), ByHand(), NewTool(), ByHandWhereverItReaches())
# with a tool attached
ATTACHED_FIRST = (AttachedToolStrategy(), ByHandToTheEnd(), ByHand(), NewTool(), ByHandWhereverItReaches())
# at one waypoint, after those for contacts
LAST_STRATEGIES = (RemoveObstacles(),)
