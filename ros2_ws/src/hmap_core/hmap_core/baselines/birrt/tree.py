"""A tree of configurations of robot and object, with the contact mode of each branch."""

from dataclasses import dataclass, field

import numpy as np

from hmap_core.baselines.birrt.manifold import Manifold
from hmap_core.baselines.branches import Branching


@dataclass(eq=False)
class Node(Branching):
    """A configuration that a tree has reached.

    Attributes:
        T: (7,) pose of the object.
        parent: None for the root.
        mode: the contact of the branch that leads here; None for the root, where all hands are free.
        path, poses: (m, n) and (m, 7) of that branch, from the parent on.
        stands: whether the object may be let go here.
        dead: whether motions were found to be impossible on the way here.
    """

    T: np.ndarray
    parent: "Node | None" = None
    mode: Manifold | None = None
    path: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    poses: np.ndarray = field(default_factory=lambda: np.zeros((0, 7)))
    stands: bool = True
    dead: bool = False

    @property
    def q(self) -> np.ndarray:
        """Configuration (n,) of the robot in contact."""
        return self.path[-1]


class Tree:
    """Nodes that are reached from a root.

    Args:
        T: (7,) pose of the object at the root.
        backwards: whether the tree grows from the goal.
    """

    def __init__(self, T: np.ndarray, backwards: bool):
        self.backwards = backwards
        self.nodes = [Node(T)]
        self._poses: list[np.ndarray] = [T]

    @property
    def root(self) -> Node:
        """The first node."""
        return self.nodes[0]

    @property
    def poses(self) -> np.ndarray:
        """Poses (M, 7) of the object at all nodes."""
        return np.array(self._poses)

    def add(self, node: Node) -> Node:
        """Add a node."""
        self.nodes.append(node)
        self._poses.append(node.T)
        return node

    def prune(self) -> None:
        """Drop what hangs on dead nodes."""
        gone = {id(node) for node in self.nodes if node.dead}
        for node in self.nodes:  # parents come before their children
            if node.parent is not None and id(node.parent) in gone:
                node.dead = True
                gone.add(id(node))
        self.nodes = [node for node in self.nodes if not node.dead]
        self._poses = [node.T for node in self.nodes]
