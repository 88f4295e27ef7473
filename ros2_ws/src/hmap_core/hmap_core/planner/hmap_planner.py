"""H-MaP as a whole method: checks the task, searches by Algorithm 1, and lets the judge decide about the plan."""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from hmap_core.arguments import checked_seed, checked_time_limit
from hmap_core.contacts.camera import Cloud
from hmap_core.deadline import DEFAULT_TIME_LIMIT, check_time
from hmap_core.exceptions import Code, HmapError
from hmap_core.plan_file import to_dict
from hmap_core.planner import plugins, preconditions
from hmap_core.planner.assembly import assemble, scene_at
from hmap_core.planner.attainable_goal import attainable_goal
from hmap_core.planner.components import PlannerComponents, local_components
from hmap_core.planner.context import Budget, Record, SearchContext
from hmap_core.planner.interfaces import ProgressCallback, ToolGrasp
from hmap_core.planner.outcome import Solution
from hmap_core.planner.protocols import Cancel
from hmap_core.planner.search import Search
from hmap_core.planner.search_tree import SearchTree
from hmap_core.planner.solution_sequence import SolutionSequence
from hmap_core.planner.tools import attach_tool, with_tool_attached
from hmap_core.trajectory.measured_limits import within_limits
from hmap_core.types import Goal, Plan, Scene, SceneState, SegmentKind
from hmap_core.validation import Report, check


def default_components(proposer: str = plugins.DEFAULT_PROPOSER) -> PlannerComponents:
    """The parts of this process, with a contact proposer by its name."""
    return local_components(proposer=plugins.create(plugins.CONTACT_PROPOSERS, proposer))


@dataclass
class HmapPlanner:
    """Implements :class:`hmap_core.planner.protocols.ManipulationPlanner`: H-MaP, Algorithms 1 to 3 of the paper.

    Attributes:
        components: the parts that do the work; by default those of this process, with learned contacts where they are
            known.
        clouds: what cameras measured on each object, in its own frame.
        tool_grasp: the grasp on the tool that a robot holds at the start, if one does.
    """

    components: PlannerComponents = field(default_factory=default_components)
    clouds: Mapping[str, Cloud] = field(default_factory=dict)
    tool_grasp: ToolGrasp | None = None

    def plan(
        self,
        scene: Scene,
        state: SceneState | None = None,
        seed: int = 0,
        time_limit: float = DEFAULT_TIME_LIMIT,
        progress: ProgressCallback | None = None,
        cancel: Cancel | None = None,
    ) -> Plan:
        """Plan a task; the judge has accepted what is returned.

        Args:
            scene: the task.
            state: where everything is; None: where the scene starts.
            seed: the only source of randomness: the same seed gives the same plan.
            time_limit: seconds of wall-clock time.
            progress: called whenever something new begins.
            cancel: asked between two steps; True stops the job.

        Raises:
            HmapError: stage, code and reason of the failure; its attribute ``search`` has the search tree.
        """
        job = PlanningJob(self, scene, state, seed, time_limit, progress, cancel)
        try:
            return job.plan()
        except HmapError as error:
            error.search = job.context.record.tree.root.to_dict()
            raise


def hmap_planner(proposer: str = "") -> HmapPlanner:
    """H-MaP by its name among the planners, ``hmap`` or ``hmap:PROPOSER``: a row of its own in a table of methods.

    Args:
        proposer: name of a contact proposer, which may have an argument of its own; empty: the default one.

    Raises:
        InputError: the name is unknown, or the proposer cannot be loaded.
    """
    return HmapPlanner(default_components(proposer or plugins.DEFAULT_PROPOSER))


class PlanningJob:
    """One call of :meth:`HmapPlanner.plan`.

    Attributes:
        scene: the task, with everything where the job starts.
        start: where everything is.
        tool_grasp: the grasp on the tool that a robot holds at the start.
        notes: what was changed of the state, for people.
        context: the job as the strategies see it.
        search: Algorithm 1.
    """

    def __init__(
        self,
        planner: HmapPlanner,
        scene: Scene,
        state: SceneState | None = None,
        seed: int = 0,
        time_limit: float = DEFAULT_TIME_LIMIT,
        progress: ProgressCallback | None = None,
        cancel: Cancel | None = None,
        began: float | None = None,
    ):
        """The arguments are those of :meth:`HmapPlanner.plan`; ``began`` is ``time.monotonic()`` when the job began.

        Raises:
            InputError: the seed or the time limit is none; the state does not fit the scene, or has a joint or a
                finger beyond its limits.
        """
        seed, time_limit = checked_seed(seed), checked_time_limit(time_limit)
        self.tool_grasp = planner.tool_grasp
        self._as_written = state is None and self.tool_grasp is None
        measured, self.notes = within_limits(scene, scene.start_state() if state is None else state)
        if state is not None or self.notes:
            state = measured
        if self.tool_grasp is not None:
            state = with_tool_attached(scene, measured, self.tool_grasp)
        self.scene = scene if state is None else scene_at(scene, state)
        self.start = self.scene.start_state() if state is None else state.copy()
        goal = scene.goal
        self.context = SearchContext(
            self.scene,
            self.start,
            planner.components,
            np.random.default_rng(seed),
            Budget(time.monotonic() if began is None else began, time_limit, cancel or (lambda: False)),
            Record(SearchTree(f"task '{scene.task}', seed {seed}: bring '{goal.object}' to its goal")),
            dict(planner.clouds),
            progress or (lambda progress: None),
            self.tool_grasp,
        )
        self.search = Search(self.context)

    def plan(self) -> Plan:
        """Check the task, and search. Raises HmapError."""
        with self.context.within_time():
            goal = self.checked_goal()
            return self.search.plan(goal, SolutionSequence(self.start, tool_grasp=self.tool_grasp), self.accepted)

    def checked_goal(self) -> Goal:
        """Check the task before anything is planned; the goal, where its object can stand within the tolerance.

        Raises:
            HmapError: the task is wrong, or cannot be solved.
        """
        goal = self.scene.goal
        preconditions.check_goal(self.scene, goal)
        if self._as_written:
            preconditions.check_bodies(self.scene, goal)
        else:
            preconditions.check_goal_support(self.scene, self.start, goal)
        goal, moved = attainable_goal(self.scene, self.start, goal)
        self.notes += moved
        check_time()
        attached = self.scene if self.tool_grasp is None else attach_tool(self.scene, self.tool_grasp)
        preconditions.check_robots(attached, self.start, goal.object)
        preconditions.check_reach(self.scene, self.start, goal)
        check_time()
        preconditions.check_grip(self.scene, self.start, goal)
        preconditions.check_weight(self.scene, self.start, goal)
        tool = None if self.tool_grasp is None else self.tool_grasp.tool
        preconditions.check_loads(self.scene, self.start, goal, tool)
        return goal

    def noted(self) -> dict[str, list[str]]:
        """The notes as a part of a plan's statistics; nothing where there are none."""
        return {"notes": list(self.notes)} if self.notes else {}

    def accepted(self, solution: Solution) -> Plan | None:
        """The plan, if the judge accepts it."""
        sequence, waypoints, record = solution.sequence, solution.waypoints, self.context.record
        planning_time = time.monotonic() - self.context.budget.began
        kinds = [s.kind for m in sequence.motions for s in m.segments]
        record.tree.root.succeed()
        stats = {
            "planning_time_s": planning_time,
            "waypoints": len(waypoints),
            "contacts": sum(kind != SegmentKind.TRANSIT for kind in kinds),
            "mode_switches": max(0, len(kinds) - 1),
            "removals": len(sequence.aside),
            "removal_depth": sequence.depth,
            **record.counts,
            "search": record.tree.root.to_dict(),
            **self.noted(),
        }
        plan = assemble(self.scene, self.start, sequence.motions, waypoints, stats)
        self.context.report("checking", len(waypoints), len(waypoints), text="the judge looks at the plan")
        content = to_dict(plan)
        self.context.time_left()
        report = check(content, self.context.time_left)
        if not report.valid:
            self._rejected(report)
            return None
        text = f"planned in {planning_time:.2f} s"
        self.context.report("done", len(waypoints), len(waypoints), text=text)
        return plan

    def _rejected(self, report: Report) -> None:
        worst, record = report.violations[0], self.context.record
        record.code, record.error = Code.PLAN_REJECTED, None
        record.reason = (
            f"the judge rejects the plan: {worst.kind} of {', '.join(worst.bodies)} at {worst.time:.2f} s, "
            f"{worst.amount:.4g} where {worst.limit:.4g} is allowed"
        )
        record.tree.root.fail("planner", record.code, record.reason)
