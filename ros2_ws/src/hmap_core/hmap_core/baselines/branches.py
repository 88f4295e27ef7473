"""Nodes of search trees, and the branches that lead to them."""

from typing import Self


class Branching:
    """A node of a tree, for those who ask how it is reached.

    Attributes:
        parent: None for the root.
    """

    parent: Self | None

    def branch(self) -> list[Self]:
        """The nodes from the root's first child to this one."""
        nodes: list[Self] = []
        node: Self | None = self
        while node is not None and node.parent is not None:
            nodes.append(node)
            node = node.parent
        return nodes[::-1]
