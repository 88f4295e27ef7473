"""The two trees of Bi-RRT, from the start and from the goal, and how they meet."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np

from hmap_core.baselines.birrt.contacts import Contacts
from hmap_core.baselines.birrt.manifold import Manifold
from hmap_core.baselines.birrt.space import ObjectSpace
from hmap_core.baselines.birrt.tree import Node, Tree
from hmap_core.planner.context import SearchContext
from hmap_core.types import Goal

TO_OTHER = 0.3  # share of the samples that are nodes of the other tree
NEAREST = 4  # nodes from which the one that is extended is drawn
KEEP = 0.7  # share of the extensions that keep the contact, where it could be changed
JOINTS = 0.3  # share of the extensions that are straight in the joints
JOINT_RANGE = 0.8  # rad, longest extension in the joints
RANGE = 15  # steps, longest extension of the object
AHEAD = 3  # steps of the object for which a new contact has to serve
CONNECTED = 3  # nodes of the other tree that a new node is connected to
TOOLS_FROM = 40  # extensions after which tools are drawn, too
SAME = 1e-6  # rad; configurations that are nearer are the same
REPORTED = 25  # extensions between two reports


@dataclass(frozen=True)
class Leg:
    """A way in one contact mode.

    Attributes:
        mode: the contact.
        path, poses: (m, n) of the robot and (m, 7) of the object, in the order of time.
        nodes: of the trees that it is made of.
    """

    mode: Manifold
    path: np.ndarray
    poses: np.ndarray
    nodes: tuple[Node, ...] = ()


class BidirectionalSearch:
    """Two trees that grow towards each other (Kuffner and LaValle, ICRA 2000).

    Args:
        context: of the job.
        goal: of the object.
    """

    def __init__(self, context: SearchContext, goal: Goal):
        self._context, self._object, self._rng = context, goal.object, context.child_rng()
        self.space = ObjectSpace(context.scene, context.start, goal)
        self._contacts = Contacts(context, goal.object, self.space)
        self._trees = Tree(self.space.start, False), Tree(self.space.goal, True)
        self._extensions = 0

    def next_way(self) -> list[Leg]:
        """Grow the trees until they meet; the legs from start to goal. Raises PlannerError TIME_LIMIT or CANCELED."""
        while True:
            self._told()
            if self._extensions == TOOLS_FROM:
                self._contacts.add_tools()
            grown, other = self._trees[:: 1 if self._extensions % 2 == 0 else -1]
            self._extensions += 1
            new = self._extend(grown, other)
            way = None if new is None else self._connect(new, grown, other)
            if way is not None:
                return way

    def _told(self) -> None:
        """Report where the search is; raises PlannerError where it has to end."""
        sizes = [len(tree.nodes) for tree in self._trees]
        context, text = self._context, f"'{self._object}': trees of {sizes[0]} and {sizes[1]} nodes"
        context.record.reason = text if context.record.error is None else f"{text}; {context.record.error.reason}"
        if self._extensions % REPORTED == 0:
            context.report("motion", attempt=self._extensions, text=text)
        context.time_left()

    def reject(self, legs: list[Leg], done: int) -> None:
        """Drop the branches of the leg after the ``done`` ones for which there are motions."""
        failed = legs[min(done, len(legs) - 1)]
        for node in failed.nodes:
            node.dead = True
        self._contacts.forget(failed.mode)
        for tree in self._trees:
            tree.prune()

    # --- growing

    def _extend(self, tree: Tree, other: Tree) -> Node | None:
        """A new node towards a random pose of the object, or a random configuration."""
        rng = self._rng
        if rng.random() < TO_OTHER:
            target = other.nodes[int(rng.integers(len(other.nodes)))].T
        else:
            target = self.space.sample(rng)
        order = np.argsort(self.space.distances(tree.poses, target), kind="stable")[:NEAREST]
        near = tree.nodes[int(order[int(rng.integers(len(order)))])]
        line = self.space.line(near.T, target)[: RANGE + 1]
        start = self._contact(near, line[: AHEAD + 1][:: -1 if tree.backwards else 1])
        if start is None:
            return None
        mode, q = start
        if rng.random() < JOINTS:
            chain = mode.hand.manipulation.model.chain
            way = rng.uniform(chain.lower, chain.upper) - q
            way *= min(1.0, JOINT_RANGE / np.abs(way).max())
            path, poses = mode.towards(q, q + way, tree.backwards)
        else:
            path, poses = mode.along(q, line, tree.backwards)
        return self._add(tree, near, mode, path, poses)

    def _contact(self, node: Node, ahead: np.ndarray) -> tuple[Manifold, np.ndarray] | None:
        """The contact in which a branch from a node begins, and the configuration in it.

        Args:
            node: the node.
            ahead: (k, 7) the next poses of the object, in the order of time.
        """
        if node.mode is not None and (not node.stands or self._rng.random() < KEEP):
            return node.mode, node.q
        return self._contacts.draw(node.T, ahead, self._rng)

    def _add(self, tree: Tree, parent: Node, mode: Manifold, path: np.ndarray, poses: np.ndarray) -> Node | None:
        if len(path) < 2:
            return None
        return tree.add(Node(poses[-1], parent, mode, path, poses, self.space.stands(poses[-1])))

    # --- meeting

    def _connect(self, node: Node, tree: Tree, other: Tree) -> list[Leg] | None:
        """The legs from start to goal, if a new node can be connected to the other tree."""
        near = np.argsort(self.space.distances(other.poses, node.T), kind="stable")[:CONNECTED]
        for there in [other.nodes[int(k)] for k in near]:
            met = self._in_same_mode(node, there, tree) if there.mode is node.mode else None
            met = met or self._at_same_pose(node, there, tree)
            if met is not None:
                ends = (there, met) if tree.backwards else (met, there)
                return _legs(*ends)
        return None

    def _in_same_mode(self, node: Node, there: Node, tree: Tree) -> Node | None:
        """The node that reaches another one's configuration in the same contact; None where it does not."""
        mode = cast(Manifold, node.mode)
        if len(there.path) == 0:
            return None
        path, poses = mode.towards(node.q, there.q, tree.backwards)
        if np.abs(path[-1] - there.q).max() > SAME:
            return None
        return self._add(tree, node, mode, path, poses) or node

    def _at_same_pose(self, node: Node, there: Node, tree: Tree) -> Node | None:
        """The node that reaches another one's pose of the object, where it stands; None where it does not."""
        mode = cast(Manifold, node.mode)
        if not there.stands:
            return None
        line = self.space.line(node.T, there.T)
        path, poses = mode.along(node.q, line, tree.backwards)
        met = self._add(tree, node, mode, path, poses)
        return met if len(path) == len(line) else None


def _legs(forward: Node, backward: Node) -> list[Leg]:
    """The legs along a branch of the tree from the start, then along one of the tree from the goal."""
    return joined([_leg(node, 1) for node in forward.branch()] + [_leg(node, -1) for node in backward.branch()[::-1]])


def joined(legs: Sequence[Leg]) -> list[Leg]:
    """The legs, neighbours in the same contact as one where the robot does not move between them."""
    whole: list[Leg] = []
    for leg in legs:
        last = whole[-1] if whole else None
        if last is not None and last.mode is leg.mode and np.abs(last.path[-1] - leg.path[0]).max() <= SAME:
            path, poses = (np.concatenate([a, b[1:]]) for a, b in ((last.path, leg.path), (last.poses, leg.poses)))
            whole[-1] = Leg(leg.mode, path, poses, (*last.nodes, *leg.nodes))
        else:
            whole.append(leg)
    return whole


def _leg(node: Node, direction: int) -> Leg:
    return Leg(cast(Manifold, node.mode), node.path[::direction], node.poses[::direction], (node,))
