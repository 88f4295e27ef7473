"""The single steps of Algorithm 1's inner loop: find contacts, plan a motion, pick a tool, place it."""

from dataclasses import dataclass, replace

from hmap_core.exceptions import ContactError, HmapError, MotionError
from hmap_core.planner.context import SearchContext
from hmap_core.planner.interfaces import RobotContact, SubTrajectory, ToolGrasp
from hmap_core.planner.protocols import SegmentQuery, ToolQuery
from hmap_core.planner.robot_order import robot_order
from hmap_core.planner.search_tree import Attempt
from hmap_core.planner.segments.contact_segment import CutCorner
from hmap_core.planner.solution_sequence import SolutionSequence
from hmap_core.planner.tasks import WaypointTask
from hmap_core.planner.tools import attach_tool, with_tool_placed
from hmap_core.types import Scene, SceneState

LEARNED = "learned"  # name of the proposer that has learned; others are counted as sampled
MOST_CUT = 3  # motions in which the object itself comes too close to another body on a path, before that is given up
TRIES_WITH_TOOL = 4  # contacts tried with one grasp on a tool


@dataclass(frozen=True)
class Manipulator:
    """What touches the object: bare hands, or the tool that one robot holds.

    Attributes:
        scene: the scene; the tool is part of the hand in it.
        state: where everything is; with bare hands all tools stand.
        robots: names, in the order in which they are queried.
        grasp: on the tool; None for bare hands.
    """

    scene: Scene
    state: SceneState
    robots: tuple[str, ...]
    grasp: ToolGrasp | None

    @staticmethod
    def of(task: WaypointTask, grasp: ToolGrasp | None) -> "Manipulator":
        """The bare hands of all robots, or the tool of one of them, at a waypoint."""
        scene, state, object = task.context.scene, task.sequence.state, task.object
        if grasp is None:
            state = with_tool_placed(state, task.sequence.tool_grasp)
            robots = robot_order(task.context.components.ranker, scene, state, object, task.ahead)
            return Manipulator(scene, state, robots, None)
        if task.sequence.tool_grasp is None:  # the robot comes from where it picks the tool
            state = state.copy()
            state.q[grasp.robot] = grasp.contact.keyframes[0]
        return Manipulator(attach_tool(scene, grasp), state, (grasp.robot,), grasp)

    def others_first(self, contacts: list[RobotContact]) -> "Manipulator":
        """The same, with the robots of some contacts last."""
        failed = {contact.robot for contact in contacts}
        return replace(self, robots=tuple(sorted(self.robots, key=failed.__contains__)))


def find_contacts(task: WaypointTask, manipulator: Manipulator, count: int, min_reach: int = 0) -> list[RobotContact]:
    """Find at most ``count`` feasible contacts that serve for ``min_reach`` poses at a waypoint, or none."""
    context, object = task.context, task.object
    if _given_up(task):
        return []
    who = f"'{object}'" if manipulator.grasp is None else f"'{object}' with what {manipulator.robots[0]} holds"
    context.report("contacts", task.at, task.total, text=f"contacts on {who}")
    cloud = context.clouds.get(object)
    query = context.contact_search(
        manipulator.scene, manipulator.state, object, task.ahead, manipulator.robots, count, cloud
    )
    known = _situation(manipulator, object)
    query = replace(query, thorough=known not in context.record.nothing_fits, min_reach=min_reach)
    context.record.contact_searches += 1
    with context.record.tree.attempt(f"contacts on {who}") as node:
        try:
            found = context.components.contacts.find_contacts(query)
        except ContactError as error:
            _failed(context, node, error)
            if error.nothing_fits:
                context.record.nothing_fits[known] = manipulator.scene
            return []
        node.succeed(f"{len(found)} feasible")
    counts = context.record.counts
    counts["contact_proposals"] += 1
    counts["contacts_checked"] += max(contact.checked for contact in found)
    counts["learned_contacts"] += sum(contact.proposer == LEARNED for contact in found)
    return found


def _situation(manipulator: Manipulator, object: str) -> tuple:
    """What decides whether hands fit on an object, as a key; the scene has to be kept, so that no other gets its id."""
    state = manipulator.state
    placed = ((name, numbers.tobytes()) for name, numbers in (*state.poses.items(), *state.q.items()))
    return id(manipulator.scene), object, *sorted(manipulator.robots), *placed


def plan_motion(
    task: WaypointTask, manipulator: Manipulator, sequence: SolutionSequence, contact: RobotContact, number: int
) -> SubTrajectory | None:
    """Plan the motion for one contact, the ``number``-th that is tried; None where there is none."""
    context, object = task.context, task.object
    if _given_up(task):
        return None
    context.record.counts["contact_tries"] += 1
    what = f"{contact.robot} carries '{object}' by {contact.contact.kind}"
    context.report("motion", task.at, task.total, number, what)
    poses = task.ahead[: contact.reach + 1]
    query = SegmentQuery(manipulator.scene, sequence.state, object, contact, poses, context.seed(), context.time_left())
    reach = f"{contact.reach} of {len(task.ahead) - 1} poses"
    with context.record.tree.attempt(f"try {number}: {what}, {reach}") as node:
        try:
            motion = context.components.segments.plan_segment(query)
        except MotionError as error:
            _failed(context, node, error)
            context.record.cut_paths[_path(task)] += isinstance(error, CutCorner) and error.of_object
            return None
        node.succeed()
        return motion


def _path(task: WaypointTask) -> tuple[str, bytes]:
    """The rest of the object's path as a key."""
    return task.object, task.ahead.tobytes()


def _given_up(task: WaypointTask) -> bool:
    """Whether the object itself hits something on the rest of its path, whatever carries it."""
    return task.context.record.cut_paths[_path(task)] >= MOST_CUT


def _failed(context: SearchContext, node: Attempt, error: HmapError) -> None:
    """Note a failure in the search tree, and as the last one."""
    context.record.failed(error)
    node.fail(error.stage, error.code, error.reason)


def pick_tool(context: SearchContext, sequence: SolutionSequence, grasp: ToolGrasp) -> SolutionSequence:
    """The sequence after a robot has picked a tool. Raises MotionError."""
    query = ToolQuery(context.scene, sequence.state, grasp, context.seed(), context.time_left())
    picked = context.components.segments.plan_pick(query)
    return replace(sequence.after(picked), tool_grasp=grasp)


def place_tool(context: SearchContext, sequence: SolutionSequence) -> SolutionSequence | None:
    """The sequence after a robot has placed its tool, the same where hands are free; None where it cannot be placed."""
    grasp = sequence.tool_grasp
    if grasp is None:
        return sequence
    context.report("motion", text=f"{grasp.robot} puts '{grasp.tool}' down")
    query = ToolQuery(context.scene, sequence.state, grasp, context.seed(), context.time_left())
    with context.record.tree.attempt(f"{grasp.robot} places '{grasp.tool}'") as node:
        try:
            motion = context.components.segments.plan_place(query)
        except MotionError as error:
            _failed(context, node, error)
            return None
        node.succeed()
    return replace(sequence.after(motion), tool_grasp=None)
