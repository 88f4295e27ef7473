"""Whether another plan is asked for when one cannot be followed on, and how often: decided here and nowhere else."""

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

from hmap_core.exceptions import Code, ExecutionError, HmapError, PlannerError
from hmap_core.execution.drift import DriftTolerance
from hmap_core.execution.failures import Blocked, Drifted
from hmap_core.execution.ports import Canceled, Ports
from hmap_core.execution.report import Replan
from hmap_core.planner.interfaces import ToolGrasp
from hmap_core.types import Plan, Scene, SceneState

RECOVERABLE = (
    Code.TRACKING_LOST,
    Code.GOAL_MISSED,
    Code.OBJECT_DROPPED,
    Code.STALE_STATE,
)  # after which another plan may do
NO_PLAN = (
    Code.START_IN_COLLISION,
    Code.GOAL_IN_COLLISION,
    Code.NO_OBJECT_PATH,
    Code.NO_CONTACT,
    Code.OUT_OF_REACH,
    Code.NO_MOTION,
    Code.TIME_LIMIT,
    Code.PLAN_REJECTED,
)  # with which planning fails where another attempt, or another state, may do


@dataclass(frozen=True)
class RecoveryPolicy:
    """How an execution recovers.

    Attributes:
        replans: new plans, failed attempts included, after something went wrong; 0: the plan is followed to its end.
        obstacle_replans: new plans because a body came in the way.
        obstacle_patience: s of the clock to wait for bodies to move on where they leave no plan.
        drift: what bodies may be off the plan between contacts.
        strict: the task is solved only if no body falls and none that a plan leaves alone moves, so a fall and such a
            motion end the execution. Otherwise only the goal counts.
        keep_tools: the planner can begin with a tool attached to a hand; False: the tool is placed before.
    """

    replans: int = 0
    obstacle_replans: int = 0
    obstacle_patience: float = 0.0
    drift: DriftTolerance = field(default_factory=DriftTolerance)
    strict: bool = True
    keep_tools: bool = True


@dataclass(frozen=True)
class ReplanRequest:
    """What a new plan starts from.

    Attributes:
        scene: with every body that is known now, and the goal.
        state: where everything is, without the noise of the measurement.
        reason: why a new plan is needed; empty for the first one.
        attempt: how many new plans have been asked for, this one included.
        tools: the tools that stay attached to hands.
        blocked: a plan, and the planned time (s) up to which it was followed, where a body came in its way. It may be
            repaired.
        changed: when the scene changed last, s of the executor's clock.
    """

    scene: Scene
    state: SceneState
    attempt: int
    reason: str = ""
    tools: tuple[ToolGrasp, ...] = ()
    blocked: tuple[Plan, float] | None = None
    changed: float = 0.0


Replanner = Callable[[ReplanRequest], Plan]  # or raises HmapError
StartState = Callable[[], SceneState]


class Recovery:
    """Decides about new plans in one execution, and asks for them.

    Attributes:
        replans: every time that a new plan was asked for, in order.
        error: why there is no new plan where one was asked for in vain.
    """

    def __init__(self, policy: RecoveryPolicy, replan: Replanner | None, ports: Ports, canceled: Canceled):
        """
        Args:
            policy: what is allowed.
            replan: makes new plans; None: there are none.
            ports: to see whether bodies move on.
            canceled: true ends the execution.
        """
        self.policy = policy
        self.replans: list[Replan] = []
        self.error: HmapError | None = None
        self._replan, self._ports, self._canceled = replan, ports, canceled
        self._began = ports.clock.now()
        self._failures = self._blocked = 0

    @property
    def may_replan(self) -> bool:
        """Whether a new plan may be asked for after a failure."""
        return self._replan is not None and self._failures < self.policy.replans

    def accepts(self, failure: ExecutionError, fell: Mapping[str, float], moved: Mapping[str, float]) -> bool:
        """Whether a new plan may make up for a failure.

        Args:
            failure: why the plan is not followed on.
            fell, moved: the bodies that fell, and those that should have stayed and moved.
        """
        missed = failure.code is Code.GOAL_MISSED and not isinstance(failure, Drifted)
        if self.policy.strict and (fell or (moved and missed)):
            return False
        if isinstance(failure, Blocked):
            return self._replan is not None and self._blocked < self.policy.obstacle_replans
        return failure.code in RECOVERABLE and self.may_replan

    def new_plan(
        self, failure: ExecutionError, plan: Plan, start: StartState, tools: Iterable[ToolGrasp] = ()
    ) -> Plan | None:
        """A new plan from where everything is now; None where there is none.

        Where bodies leave no plan, they get time to move on. After another failure the planner is asked as often as is
        allowed.

        Args:
            failure: why it is needed.
            plan: the plan until now.
            start: the state in which everything is at rest.
            tools: the grasps of the tools that stay attached.

        Raises:
            PlannerError: CANCELED.
        """
        blocked = (plan, failure.at) if isinstance(failure, Blocked) else None
        self._blocked += blocked is not None
        while blocked is not None or self.may_replan:
            self._failures += blocked is None
            changed = self._ports.observation.changed()
            try:
                return self._asked(failure, plan, start(), tools, blocked)
            except HmapError as error:
                self.error = error
                if error.code is Code.CANCELED or self._canceled():
                    raise PlannerError("canceled", Code.CANCELED) from error
                if error.code not in NO_PLAN or (blocked is not None and not self._bodies_move_on(changed)):
                    return None
        return None

    def _asked(
        self,
        failure: ExecutionError,
        plan: Plan,
        state: SceneState,
        tools: Iterable[ToolGrasp],
        blocked: tuple[Plan, float] | None,
    ) -> Plan:
        observation = self._ports.observation
        scene = replace(self._ports.scene(), goal=plan.scene.goal)
        request = ReplanRequest(
            scene, state, len(self.replans) + 1, failure.reason, tuple(tools), blocked, observation.changed()
        )
        at, began, problem = self._ports.clock.now() - self._began, time.monotonic(), ""
        if self._replan is None:
            raise ValueError("nothing makes new plans")
        try:
            found = self._replan(request)
        except HmapError as error:
            problem = str(error)
            raise
        finally:
            self.replans.append(Replan(at, failure.reason, time.monotonic() - began, problem))
        self.error = None
        return found

    def _bodies_move_on(self, since: float) -> bool:
        observation, patience = self._ports.observation, self.policy.obstacle_patience
        return observation.wait_for_change(since, patience, self._canceled) and not self._canceled()
