"""The RRT of CMGMP: every extension tries all contact modes of the node that it starts from."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from hmap_core.baselines.branches import Branching
from hmap_core.baselines.cmgmp.fingers import NONE, Manipulator, Placement
from hmap_core.baselines.cmgmp.forces import Balance
from hmap_core.baselines.cmgmp.integrate import Integration, Mode, wanted
from hmap_core.baselines.cmgmp.modes import Enumeration
from hmap_core.baselines.cmgmp.problem import EnvironmentContact, ObjectProblem, Touching
from hmap_core.transforms import distance, interpolate

TO_GOAL = 0.7  # share of the extensions towards the goal, as in the authors' program
NEARER = 1e-3  # share of the wanted velocity by which a mode has to do better than rest
SAME_TWIST = 1e-6
SHORTEST = 2  # poses of a branch, at least


@dataclass(eq=False)
class Node(Branching):
    """A pose that the tree has reached.

    Attributes:
        T: (7,) of the object.
        parent: None for the root.
        placement: of the fingers on the branch that leads here; None for the root.
        poses: (m, 7) of that branch.
        touching: the object's contacts with obstacles.
        to_goal: whether it was extended towards the goal.
    """

    T: np.ndarray
    parent: "Node | None"
    placement: Placement | None
    poses: np.ndarray
    touching: Touching
    to_goal: bool = False
    before: Placement | None = None  # at the beginning of the branch


@dataclass
class Search:
    """Searches a way of an object to its goal, with the fingers that move it.

    Attributes:
        problem: the object among its obstacles.
        manipulator: moves it.
        rng: the only source of randomness.
        from_one_pose: largest number of extensions towards the goal from nodes that differ in their fingers only.
        nodes: of the tree.
    """

    problem: ObjectProblem
    manipulator: Manipulator
    rng: np.random.Generator
    from_one_pose: float = np.inf
    nodes: list[Node] = field(default_factory=list)

    def __post_init__(self):
        problem = self.problem
        self._balance = Balance(problem)
        self._integration = Integration(problem, self._balance)
        self._enumeration = Enumeration(problem.size)
        root = Node(problem.start, None, None, problem.start[None], problem.contacts(problem.start))
        self.nodes.append(root)

    def solve(self, samples: int, going_on: Callable[[int], None], to_goal: float = TO_GOAL) -> list[Node] | None:
        """The branch to the goal, or None.

        Args:
            samples: largest number of extensions.
            going_on: called with the number of extensions before each of them; may raise.
            to_goal: share of the extensions towards the goal.
        """
        for number in range(samples):
            going_on(number)
            near, target = self._sampled(number, to_goal)
            for node in self._extended(near, target):
                self.nodes.append(node)
                if self.reached(node):
                    return node.branch()
        return None

    def reached(self, node: Node) -> bool:
        """Whether a node is at the goal."""
        return self.problem.distance(node.T, self.problem.goal) <= self.problem.reached

    def _sampled(self, number: int, to_goal: float) -> tuple[Node, np.ndarray]:
        """A pose, and the node to be extended towards it: for the goal the nearest that was not extended to it yet."""
        problem, rng = self.problem, self.rng
        fresh = [node for node in self.nodes if not node.to_goal]
        if number == 0 or rng.random() < to_goal:
            if not fresh:
                return self.nodes[int(rng.integers(len(self.nodes)))], problem.goal
            near = min(fresh, key=lambda node: problem.distance(node.T, problem.goal))
            near.to_goal = near.parent is not None
            if np.isfinite(self.from_one_pose):
                self._close(near)
            return near, problem.goal
        target = self._random_pose()
        return min(self.nodes, key=lambda node: problem.distance(node.T, target)), target

    def _close(self, near: Node) -> None:
        """Extend no node at the pose of one any more towards the goal, if that was done often enough."""
        alike = [node for node in self.nodes if self.problem.distance(node.T, near.T) <= self.problem.tolerance]
        if sum(node.to_goal for node in alike) >= self.from_one_pose:
            for node in alike:
                node.to_goal = True

    def _random_pose(self) -> np.ndarray:
        problem, rng = self.problem, self.rng
        place = rng.uniform(problem.lower, problem.upper)
        if problem.turns is None:
            quaternion = rng.normal(size=4)
            return np.concatenate([place, quaternion / np.linalg.norm(quaternion)])
        turn = Rotation.from_rotvec(rng.uniform(-np.pi, np.pi) * problem.turns)
        return np.concatenate([place, (turn * Rotation.from_quat(problem.start[3:])).as_quat()])

    def _extended(self, near: Node, target: np.ndarray) -> list[Node]:
        """New nodes towards a pose (7,), one for each contact mode that leads there."""
        problem = self.problem
        target = _steered(near.T, target, problem.longest, problem.widest)
        found = []
        for contacts in self._readings(near):
            for mode, twist in self._modes(near, target, contacts):
                node = self._in_mode(near, target, mode, twist)
                if node is not None:
                    found.append(node)
        return found

    def _readings(self, node: Node) -> Iterator[list[EnvironmentContact]]:
        """The contacts of a node; where a pair touches at a corner, with the one normal and with the other."""
        yield node.touching.contacts
        for pair, normal in node.touching.others.items():
            yield self.problem.contacts(node.T, {pair: normal}).contacts

    def _modes(
        self, near: Node, target: np.ndarray, contacts: list[EnvironmentContact]
    ) -> Iterator[tuple[Mode, np.ndarray]]:
        """Modes that lead nearer to a pose (7,), with their twists."""
        for kept in self._enumeration.modes(contacts, self._integration.fixed(near.T)):
            last = None
            for sticks in (True, False) if kept.any() else (False,):
                mode = Mode(contacts, kept, sticks)
                twist = self._integration.velocity(near.T, target, mode)
                if twist is None or not self._leads_nearer(twist, wanted(near.T, target)):
                    continue
                if last is None or np.abs(twist - last).max() >= SAME_TWIST:
                    yield mode, twist
                last = twist

    def _leads_nearer(self, twist: np.ndarray, whole: np.ndarray) -> bool:
        """Whether a twist (6,) is nearer to the whole way (6,) than rest is."""

        def length(t: np.ndarray) -> float:
            far, turn = np.linalg.norm(t[:3]), np.linalg.norm(t[3:])
            return float(self.problem.translation_weight * far + self.problem.turn_weight * turn)

        return length(twist - whole) < (1.0 - NEARER) * length(whole)

    def _in_mode(self, near: Node, target: np.ndarray, mode: Mode, twist: np.ndarray) -> Node | None:
        """The node to which one mode leads, with the fingers as they are or relocated."""
        placement = self._placement(near, mode, twist)
        if placement is None:
            return None
        generators = self._balance.fingers(placement.points, placement.normals)
        poses = self._integration.run(near.T, target, mode, generators, lambda T: self.manipulator.free(placement, T))
        if len(poses) < SHORTEST:
            return None
        after, poses = self.manipulator.followed(placement, poses)
        if len(poses) < SHORTEST or not self._confirmed(near.T, mode, twist, generators):
            return None
        T = poses[-1]
        return Node(T, near, after, poses, self.problem.contacts(T), before=placement)

    def _confirmed(self, T: np.ndarray, mode: Mode, twist: np.ndarray, fingers: np.ndarray) -> bool:
        """Whether the linear program has forces for the beginning of a branch."""
        environment = self._balance.obstacles(mode.contacts, mode.kept, twist, mode.sticks)
        generators = np.concatenate([fingers, environment], axis=1)
        return self._balance.forces(generators, self._balance.gravity(T)) is not None

    def _placement(self, near: Node, mode: Mode, twist: np.ndarray) -> Placement | None:
        """Fingers that hold the object in a mode at a node: as they are, or relocated; None for none."""
        present = near.placement
        if present is not None and self._holds(near.T, mode, twist, present) and self.manipulator.free(present, near.T):
            return present
        for relocation in self.manipulator.relocations(present, near.T, self.rng):
            placement = relocation.placement
            if not self._rests(near, relocation.remaining) or not self._holds(near.T, mode, twist, placement):
                continue
            settled = self.manipulator.settled(placement, near.T, self.rng)
            if settled is not None:
                return settled
        return None

    def _holds(self, T: np.ndarray, mode: Mode, twist: np.ndarray, placement: Placement) -> bool:
        fingers = self._balance.fingers(placement.points, placement.normals)
        return self._integration.balanced(T, twist, mode, fingers)

    def _rests(self, node: Node, placement: Placement) -> bool:
        """Whether the object rests while some fingers are relocated."""
        contacts = node.touching.contacts
        everything = Mode(contacts, np.ones(len(contacts), bool), True)
        return self._holds(node.T, everything, np.zeros(6), placement)

    def rests_alone(self, node: Node) -> bool:
        """Whether the object at a node rests without fingers."""
        return self._rests(node, NONE)


def _steered(T: np.ndarray, target: np.ndarray, longest: float, widest: float) -> np.ndarray:
    """The pose (7,) from T (7,) towards a target, no farther away than an extension goes."""
    far, turn = distance(T, target)
    place = interpolate(T, target, min(1.0, longest / far) if far > 0.0 else 1.0)[:3]
    turned = interpolate(T, target, min(1.0, widest / turn) if turn > 0.0 else 1.0)[3:]
    return np.concatenate([place, turned])
