"""The graph itself: costs of edges, bounded cheaply before they are planned, and the cheapest way to the goal."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from hmap_core.planner.manipulation_graph.grasp_sets import GraspSet
from hmap_core.planner.manipulation_graph.placements import SAME_TILT, Placement
from hmap_core.planner.solution_sequence import SolutionSequence
from hmap_core.types import ContactPoint

START, GOAL = 0, 1  # numbers of these nodes
GRASP_COST = 1.0  # of an edge that one grasp serves
FEW_GRASPS = 20  # fewer common grasps than this cost more, up to FEW_COST
FEW_COST = 0.5
SLIDE_COST = 1.3  # of an edge over which the object is pushed
SLIDE_WEIGHT, TURN_WEIGHT = 1.0, 0.3  # cost of a metre and of a radian of such an edge
FAILURE_COST = 2.0  # more for each try of an edge that failed
SIMILAR_COST = 0.5  # more for the same contact to a similar placement
SIMILAR = 0.05  # m between similar placements that are turned alike
TRIES = 2  # after which an edge is given up
SLIDES_TRIED = (
    4  # failed edges from one placement, without one that was planned, after which it is not pushed from there
)
DONE_COST = 0.3  # of an edge that is planned: it makes the plan longer
HANDS = 3  # grasps for one edge that are tried
Carried = Callable[[Placement, Placement], bool]


@dataclass
class Edge:
    """What is known of an edge.

    Attributes:
        sliding: whether the object is pushed over its support, else grasped.
        checked: whether inverse kinematics has been solved at both ends, or the support in between looked at.
        hands: robots with grasps that they reach at both ends.
        tries: how often it was planned without success.
    """

    sliding: bool
    checked: bool = False
    hands: list[tuple[str, ContactPoint]] = field(default_factory=list)
    tries: int = 0


class ManipulationGraph:
    """Placements of one object and the contacts between them, evaluated lazily (Dellin, Srinivasa, "A unifying
    formalism for shortest path problems with expensive edge evaluations via lazy best-first search", ICAPS 2016).

    Args:
        placements: start, goal and intermediate placements.
        grasps: grasps of each robot.
        start: what has been done before.
        rng: the only source of randomness.
        carried: whether supports carry the object between two placements of the same height and tilt.
        check_time: called again and again in a search; raises to end it.

    Attributes:
        nodes: the placements.
        reached: sequence that ends with the object at a node, by its number.
    """

    def __init__(
        self,
        placements: list[Placement],
        grasps: list[GraspSet],
        start: SolutionSequence,
        rng: np.random.Generator,
        carried: Carried = lambda a, b: True,
        check_time: Callable[[], object] = lambda: None,
    ):
        self._check_time = check_time
        self.nodes, self._grasps, self._rng, self._carried = placements, grasps, rng, carried
        self.reached = {START: start}
        self._edges: dict[tuple[int, int], Edge] = {}
        self._known: dict[int, np.ndarray] = {}  # which grasps of all robots serve at a node
        n = len(placements)
        price = np.array([placement.cost for placement in placements])
        self._cost = np.full((n, n), GRASP_COST) + price[None]  # optimistic until an edge is looked at
        near = self._near()
        self._cost[near.T.astype(int) @ near == 0] = np.inf  # no robot reaches both
        np.fill_diagonal(self._cost, np.inf)
        self._cost[:, START] = self._cost[GOAL] = np.inf
        self._price = price
        self._more = np.zeros((n, n))  # cost of edges that are like one that failed
        self._slides = np.zeros(n)  # failed edges from each node over which the object is pushed

    def _near(self) -> np.ndarray:
        """Which robots (R, N) might reach the object at which node.

        If no robot grasps the object at both ends, some placement has to be grasped by two robots. Then those that seem
        within reach of two are looked at first, with the robot that reaches the fewest grasps there before the others.
        """
        counts = np.array([[grasp.within_reach(node.pose) for node in self.nodes] for grasp in self._grasps])
        near = counts.reshape(len(self._grasps), len(self.nodes)) > 0
        ends = [[bool(grasp.serves(self.nodes[k].pose).any()) for grasp in self._grasps] for k in (START, GOAL)]
        if len(self._grasps) < 2 or any(a and b for a, b in zip(*ends, strict=True)):
            return near
        for k in range(GOAL + 1, len(self.nodes)):
            for r in np.argsort(counts[:, k], kind="stable"):
                if near[r, k] and near[:, k].sum() > 1:
                    near[r, k] = self._grasps[r].reaches(self.nodes[k].pose, self._rng)
        return near

    def cheapest(self) -> list[int] | None:
        """Numbers of the nodes on the cheapest way from a reached node to the goal; None where there is none.

        Each of its edges has been checked at both ends.
        """
        while True:
            self._check_time()
            way = self._shortest()
            if way is None:
                return None
            edges = list(zip(way[:-1], way[1:], strict=True))
            stuck = [edge for edge in edges if self._is_stuck(edge)]
            for edge in stuck:
                self._cost[edge] = np.inf
            if stuck:
                continue
            if not any(self._look(edge) for edge in edges) and not any(self._check(edge) for edge in edges):
                return way

    def edge(self, a: int, b: int) -> Edge:
        """What is known of an edge on the way that :meth:`cheapest` returned."""
        return self._edges[a, b]

    def solved(self, a: int, b: int, sequence: SolutionSequence) -> None:
        """Note that an edge was planned."""
        self.reached[b] = sequence
        if self._edges[a, b].sliding:
            self._slides[a] = -np.inf
        self._cost[a, b] = DONE_COST

    def failed(self, a: int, b: int) -> None:
        """Price an edge that could not be planned."""
        edge = self._edges[a, b]
        edge.tries += 1
        edge.checked = edge.sliding  # other grasps may do
        self._cost[a, b] += FAILURE_COST if edge.tries < TRIES else np.inf
        here = self.nodes[b]
        for k, other in enumerate(self.nodes):
            near = np.linalg.norm(other.pose[:3] - here.pose[:3]) < SIMILAR
            if k not in (b, GOAL) and near and np.abs(other.up - here.up).max() < SAME_TILT:
                self._cost[a, k] += SIMILAR_COST
                self._more[a, k] += SIMILAR_COST
        self._slides[a] += edge.sliding

    def _is_stuck(self, edge: tuple[int, int]) -> bool:
        """Whether an edge is a push from where no push was planned."""
        return edge in self._edges and self._edges[edge].sliding and self._slides[edge[0]] >= SLIDES_TRIED

    def _shortest(self) -> list[int] | None:
        """The way by Dijkstra's algorithm with the costs that are known now."""
        n = len(self.nodes)
        cost, before, done = np.full(n, np.inf), np.full(n, -1), np.zeros(n, bool)
        for k, sequence in self.reached.items():
            cost[k] = DONE_COST * len(sequence.motions)
        while True:
            at = int(np.where(done, np.inf, cost).argmin())
            if done[at] or np.isinf(cost[at]):
                return None
            if at == GOAL:
                break
            done[at] = True
            over = cost[at] + self._cost[at]
            better = ~done & (over < cost)
            cost[better], before[better] = over[better], at
        way = [GOAL]
        while way[-1] not in self.reached:
            way.append(int(before[way[-1]]))
        return way[::-1]

    def _look(self, edge: tuple[int, int]) -> bool:
        """Bound the edges of two nodes by the rigid hand; whether that was not done before."""
        fresh = [k for k in edge if k not in self._known]
        for k in fresh:
            self._learn(k)
        return bool(fresh)

    def _learn(self, node: int) -> None:
        """Find the grasps that serve at a node, and the cost of its edges with all other nodes that are known."""
        served = np.concatenate([grasp.serves(self.nodes[node].pose) for grasp in self._grasps] or [np.zeros(0, bool)])
        others = list(self._known)
        common = (
            np.array([self._known[other] for other in others]).reshape(len(others), len(served)).astype(int) @ served
        )
        for other, number in zip(others, common.tolist(), strict=True):
            for edge in ((other, node), (node, other)):
                if self._cost[edge] < np.inf:
                    self._edges[edge] = Edge(sliding=number == 0)
                    self._cost[edge] = self._grasp_cost(edge, number) if number else self._sliding_cost(edge)
        self._known[node] = served

    def _grasp_cost(self, edge: tuple[int, int], common: int) -> float:
        few = FEW_COST * max(0.0, 1.0 - common / FEW_GRASPS)
        return float(GRASP_COST + few + self._price[edge[1]] + self._more[edge])

    def _sliding_cost(self, edge: tuple[int, int]) -> float:
        a, b = (self.nodes[k] for k in edge)
        tried_before = edge == (START, GOAL)  # by the strategies for one object path
        if tried_before or self._slides[edge[0]] >= SLIDES_TRIED or not a.slides_to(b):
            return float("inf")
        way = float(np.linalg.norm(a.pose[:2] - b.pose[:2]))
        turn = 2.0 * float(np.arccos(min(1.0, abs(float(a.pose[3:] @ b.pose[3:])))))
        return SLIDE_COST + SLIDE_WEIGHT * way + TURN_WEIGHT * turn + self._price[edge[1]] + float(self._more[edge])

    def _check(self, edge: tuple[int, int]) -> bool:
        """Check an edge: inverse kinematics at both ends, or the support in between; whether its cost has changed."""
        known = self._edges[edge]
        if known.checked:
            return False
        known.checked = True
        a, b = (self.nodes[k] for k in edge)
        if not known.sliding:
            known.hands = [
                (grasp.robot, contact)
                for grasp in self._grasps
                for contact in grasp.hands(a.pose, b.pose, HANDS, self._rng)
            ]
            if known.hands:
                return False
            known.sliding = True
            self._cost[edge] = self._sliding_cost(edge)
            if np.isinf(self._cost[edge]):
                return True
        if not self._carried(a, b):
            self._cost[edge] = np.inf
        return True
