"""The graph itself: costs of edges, bounded cheaply before they are planned, and the cheapest way to the goal."""

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


@dataclass
class Edge:
    """What is known of an edge.

    Attributes:
        sliding: whether the object is pushed over its support, else grasped.
        checked: whether inverse kinematics has been solved at both ends.
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
    ):
        self.nodes, self._grasps, self._rng = placements, grasps, rng
        self.reached = {START: start}
        self._edges: dict[tuple[int, int], Edge] = {}
        n = len(placements)
        price = np.array([placement.cost for placement in placements])
        self._cost = np.full((n, n), GRASP_COST) + price[None]  # optimistic until an edge is looked at
        np.fill_diagonal(self._cost, np.inf)
        self._cost[:, START] = self._cost[GOAL] = np.inf
        self._price = price
        self._more = np.zeros((n, n))  # cost of edges that are like one that failed
        self._slides = np.zeros(n)  # failed edges from each node over which the object is pushed

    def cheapest(self) -> list[int] | None:
        """Numbers of the nodes on the cheapest way from a reached node to the goal; None where there is none.

        Each of its edges has been checked at both ends.
        """
        while True:
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
        self._slides[a] = -np.inf
        self._cost[a, b] = DONE_COST

    def failed(self, a: int, b: int) -> None:
        """Price an edge that could not be planned."""
        edge = self._edges[a, b]
        edge.tries += 1
        edge.checked = edge.sliding
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
        """Bound an edge by the rigid hand; whether that changed its cost."""
        if edge in self._edges:
            return False
        a, b = (self.nodes[k] for k in edge)
        common = sum(int((grasp.serves(a.pose) & grasp.serves(b.pose)).sum()) for grasp in self._grasps)
        self._edges[edge] = Edge(sliding=common == 0)
        if common:
            few = FEW_COST * max(0.0, 1.0 - common / FEW_GRASPS)
            self._cost[edge] = GRASP_COST + few + self._price[edge[1]] + self._more[edge]
        else:
            self._cost[edge] = self._sliding_cost(edge)
        return True

    def _sliding_cost(self, edge: tuple[int, int]) -> float:
        a, b = (self.nodes[k] for k in edge)
        tried_before = edge == (START, GOAL)  # by the strategies for one object path
        if not a.slides_to(b) or self._slides[edge[0]] >= SLIDES_TRIED or tried_before:
            return np.inf
        way = float(np.linalg.norm(a.pose[:2] - b.pose[:2]))
        turn = 2.0 * float(np.arccos(min(1.0, abs(float(a.pose[3:] @ b.pose[3:])))))
        return SLIDE_COST + SLIDE_WEIGHT * way + TURN_WEIGHT * turn + self._price[edge[1]] + float(self._more[edge])

    def _check(self, edge: tuple[int, int]) -> bool:
        """Check an edge by inverse kinematics at both ends; whether it has become more expensive."""
        known = self._edges[edge]
        if known.checked or known.sliding:
            return False
        a, b = (self.nodes[k] for k in edge)
        known.checked = True
        known.hands = [
            (grasp.robot, contact)
            for grasp in self._grasps
            for contact in grasp.hands(a.pose, b.pose, HANDS, self._rng)
        ]
        if known.hands:
            return False
        known.sliding = True
        self._cost[edge] = self._sliding_cost(edge)
        return True
