"""Multi-bound tree search over skeletons: cheap bounds first, and the paths of what passes them."""

import heapq
from dataclasses import dataclass, field
from itertools import count

import numpy as np

from hmap_core.baselines.lgp import bounds
from hmap_core.baselines.lgp.actions import Action, Hand, Target, hands, successors
from hmap_core.baselines.lgp.paths import BoundedAction, paths
from hmap_core.exceptions import Code, MotionError, PlannerError
from hmap_core.planner.context import SearchContext
from hmap_core.planner.outcome import Solution
from hmap_core.types import Goal, SceneState

ACTION = 1.0  # cost of an action
TOOL = 0.4  # more of one with a tool
PLACE = 0.2  # more of one that leaves the place open
AGAIN = 0.6  # more of a node at each further visit
ROUNDS = 3  # of the whole search, where no skeleton is left
POSE_VISITS = 3  # of a node whose bound by poses does not hold, before it is dropped


@dataclass(eq=False)
class Node:
    """A skeleton, of which the bound by poses holds for all actions but, at first, the last one.

    Attributes:
        actions: bounded ones.
        last: the action for which the bound is not known yet; None for the root, and once it holds.
        state: where everything is before ``last``, or at the end.
        cost: by which nodes are visited, the lowest first.
        visits: of the node so far.
    """

    actions: tuple[BoundedAction, ...]
    last: Action | None
    state: SceneState
    cost: float
    visits: int = 0

    def skeleton(self) -> str:
        """The text of the skeleton."""
        names = [str(own.action) for own in self.actions] + ([str(self.last)] if self.last else [])
        return "; ".join(names) or "nothing"


@dataclass
class SkeletonSearch:
    """Searches the skeleton of a task and its paths (Toussaint and Lopes, ICRA 2017).

    Attributes:
        context: of the job.
        goal: of the task.
    """

    context: SearchContext
    goal: Goal
    _queue: list[tuple[float, int, Node]] = field(default_factory=list)

    def __post_init__(self):
        self._rng, self._numbers = self.context.child_rng(), count()
        self._hands: list[Hand] = hands(self.context, self.goal)
        self._rounds = 0
        self._begin_anew()

    def _begin_anew(self) -> None:
        """Queue the skeletons of one action, as long as that may help."""
        if self._rounds == ROUNDS:
            raise PlannerError(
                f"no skeleton passes the bound by poses: no hand has a contact on '{self.goal.object}' that it reaches "
                f"before and after a move; last: {self.context.record.reason}",
                Code.NO_CONTACT,
            )
        self._rounds += 1
        self._expand(Node((), None, self.context.start, 0.0))

    def solve(self) -> Solution:
        """Visit nodes until one has a path.

        Raises:
            PlannerError: NO_CONTACT, no skeleton passes the bound by poses; TIME_LIMIT or CANCELED.
        """
        while True:
            if not self._queue:
                self._begin_anew()
            _, number, node = heapq.heappop(self._queue)
            self._tell(number, node)
            node.visits += 1
            if node.last is not None:
                self._bound(node)
                continue
            try:
                sequence = paths(self.context, node.actions, self._rng)
            except MotionError as error:
                self.context.record.failed(error)
                self._resample(node)
                self._push(node, AGAIN)
                continue
            return Solution(sequence, waypoints=np.array([own.T_end for own in node.actions]))

    def _tell(self, number: int, node: Node) -> None:
        context, text = self.context, f"skeleton {number}: {node.skeleton()}"
        error = context.record.error
        context.record.reason = text if error is None else f"{text}; {error.reason}"
        context.report("motion", attempt=number, text=text)

    def _bound(self, node: Node) -> None:
        """Ask for the bound by poses of the last action; where it holds, for the paths, or for further actions."""
        action, rng = node.last, self._rng
        assert action is not None
        T_end = bounds.target_pose(self.context.scene, node.state, self.goal, action, rng)
        contacts = [] if T_end is None else bounds.contacts_at_switches(node.state, action, T_end, rng)
        if T_end is None or not contacts:
            if node.visits < POSE_VISITS:
                self._push(node, AGAIN)
            return
        bounded = BoundedAction(action, node.state.poses[action.object], T_end, contacts)
        after = node.state.copy()
        after.poses[action.object] = T_end
        done = Node((*node.actions, bounded), None, after, node.cost)
        if action.target is Target.GOAL:
            self._push(done, 0.0)
            return
        if action.target is Target.PLACE:  # another place, some time
            self._push(Node(node.actions, action, node.state, node.cost), AGAIN)
        self._expand(done)

    def _resample(self, node: Node) -> None:
        """Draw other contacts of a node's actions."""
        renewed, state = [], self.context.start.copy()
        for own in node.actions:
            found = bounds.contacts_at_switches(state, own.action, own.T_end, self._rng)
            renewed.append(BoundedAction(own.action, own.T_start, own.T_end, found or own.contacts))
            state.poses[own.action.object] = own.T_end
        node.actions = tuple(renewed)

    def _expand(self, node: Node) -> None:
        """Queue the skeletons with one more action."""
        scene, done = self.context.scene, [own.action for own in node.actions]
        for action in successors(scene, self.goal, done, self._hands):
            cost = ACTION + TOOL * (action.hand.grasp is not None) + PLACE * (action.target is Target.PLACE)
            first = not node.actions or node.actions[-1].action.hand is not action.hand
            self._push(Node(node.actions, action, node.state, node.cost), cost if first else cost - 0.1 * ACTION)

    def _push(self, node: Node, more: float) -> None:
        node.cost += more
        blocked = bounds.blockers(self.context.scene, node.state, self.goal.object, self.goal.pose)
        away = {node.last.object} if node.last is not None and node.last.object != self.goal.object else set()
        ahead = sum(name in self.context.scene.removable and name not in away for name in blocked)
        heapq.heappush(self._queue, (node.cost + ACTION * ahead, next(self._numbers), node))
