"""Bounding volume hierarchies: binary trees of axis-aligned boxes, one shape to a leaf, for compiled broad phases.

Nodes are in depth-first order: node 0 is the root, the first child of an inner node k is node k + 1. Ericson,
"Real-Time Collision Detection", 2005, chapter 6.
"""

from collections import namedtuple

import numba as nb
import numpy as np

from hmap_core.collision.compile_options import OPTIONS

# Arrays of a tree over n boxes; N = 2 n - 1 nodes; lengths in m.
#   center, half (N, 3): centre and half the extents of a node's box
#   radius (N,): half the diagonal of the box
#   second (N,): the second child of an inner node
#   item (N,): the box of a leaf; -1 for inner nodes
Tree = namedtuple("Tree", "center half radius second item")

# capacity of a stack for a traversal: the trees are balanced, so their depth is at most log2 of the number of boxes + 1
DEPTH = 64


@nb.njit(**OPTIONS)
def _fill(lower, upper, center, half, radius, second, item):
    """Builds the tree top-down; each node is split at the median along the axis in which its boxes' centres differ
    most.
    """
    n = lower.shape[0]
    order = np.arange(n)
    middle = lower + upper
    stack = np.empty((DEPTH, 3), np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2] = 0, n, 0
    top = 1
    while top > 0:
        top -= 1
        first, last, node = stack[top, 0], stack[top, 1], stack[top, 2]
        axis, widest = 0, -1.0
        square = 0.0
        for x in range(3):
            low, high, near, far = np.inf, -np.inf, np.inf, -np.inf
            for k in range(first, last):
                i = order[k]
                low, high = min(low, lower[i, x]), max(high, upper[i, x])
                near, far = min(near, middle[i, x]), max(far, middle[i, x])
            center[node, x], half[node, x] = 0.5 * (low + high), 0.5 * (high - low)
            square += half[node, x] ** 2
            if far - near > widest:
                axis, widest = x, far - near
        radius[node] = np.sqrt(square)
        if last - first == 1:
            item[node] = order[first]
            continue
        part = order[first:last]
        part = part[np.argsort(middle[part, axis], kind="mergesort")]
        for k in range(first, last):
            order[k] = part[k - first]
        half_way = (first + last) // 2
        second[node] = node + 2 * (half_way - first)
        stack[top, 0], stack[top, 1], stack[top, 2] = half_way, last, second[node]
        stack[top + 1, 0], stack[top + 1, 1], stack[top + 1, 2] = first, half_way, node + 1
        top += 2


def build_tree(lower: np.ndarray, upper: np.ndarray) -> Tree:
    """Builds the hierarchy of some boxes.

    Args:
        lower: (n, 3) lower corners, m.
        upper: (n, 3) upper corners, m.

    Returns:
        The tree; without nodes if there are no boxes.
    """
    n = len(lower)
    N = max(2 * n - 1, 0)
    tree = Tree(
        np.empty((N, 3)), np.empty((N, 3)), np.empty(N), np.zeros(N, np.int32), np.full(N, -1, np.int32)
    )  # fmt: skip
    if n:
        _fill(np.ascontiguousarray(lower, float), np.ascontiguousarray(upper, float), *tree)
    return tree
