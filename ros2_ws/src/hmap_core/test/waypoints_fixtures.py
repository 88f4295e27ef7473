"""Problems that several tests of the waypoints share."""

from geometry_fixtures import TABLE, box

from hmap_core.transforms import pose
from hmap_core.types import BodyKind
from hmap_core.waypoints import ObjectPathProblem

# what a check at instants may miss of the min_distance, m
SLACK = 3e-4
BAR = box("bar", (1.0, 0.08, 0.08), (0, 0, 0), kind=BodyKind.MOVABLE)


def tunnel(name, length, x):
    return [
        box(f"{name}_top", (length, 0.14, 0.03), (x, 0.25, 0.165)),
        box(f"{name}_left", (length, 0.03, 0.14), (x, 0.19, 0.08)),
        box(f"{name}_right", (length, 0.03, 0.14), (x, 0.31, 0.08)),
    ]


TUNNELS = [*tunnel("a", 0.9, -0.9), *tunnel("b", 0.2, -0.2)]
U_WALLS = [
    box("north", (0.9, 0.05, 0.2), (0, 0.45, 0.15)),
    box("south", (0.9, 0.05, 0.2), (0, -0.45, 0.15)),
    box("east", (0.05, 0.95, 0.2), (0.45, 0, 0.15)),
    box("west", (0.05, 0.95, 0.2), (-0.45, 0, 0.15)),
    box("middle", (0.05, 0.7, 0.2), (0, -0.1, 0.15)),
]
WINDOW = [
    box("left", (0.05, 1.0, 1.0), (0, -0.6, 0.55)),
    box("right", (0.05, 1.0, 1.0), (0, 0.6, 0.55)),
    box("below", (0.05, 0.2, 0.5), (0, 0, 0.3)),
    box("over", (0.05, 0.2, 0.2), (0, 0, 0.95)),
]


def u_problem():
    return ObjectPathProblem(
        box("brick", (0.25, 0.1, 0.1), (0, 0, 0)), pose((-0.25, -0.3, 0.1)), pose((0.25, -0.3, 0.1)), (TABLE, *U_WALLS)
    )


def window_problem():
    return ObjectPathProblem(
        box("plate", (0.1, 0.25, 0.1), (0, 0, 0)),
        pose((-0.4, 0, 0.3)),
        pose((0.4, 0, 0.3)),
        (TABLE, *WINDOW),
        motion="spatial",
    )


def two_doors_problem():
    """A room with two doors; three boxes stand in one, two in the other, and three more in the open."""
    walls = [
        box("between", (0.05, 0.8, 0.3), (0, 0, 0.2)),
        *(box(f"wall{s}", (0.05, 0.5, 0.3), (0, s * 0.75, 0.2)) for s in (-1, 1)),
        *(box(f"side{s}", (2.0, 0.05, 0.3), (0, s, 0.2)) for s in (-1, 1)),
        *(box(f"end{s}", (0.05, 2.0, 0.3), (s, 0, 0.2)) for s in (-1, 1)),
    ]
    places = {f"a{k}": (0.1 * k - 0.1, -0.45, 0.1) for k in range(3)}
    places |= {f"b{k}": (0.1 * k - 0.05, 0.45, 0.1) for k in range(2)}
    places |= {f"c{k}": (-0.5, 0.3 * k - 0.3, 0.1) for k in range(3)}
    boxes = [box(name, (0.08, 0.08, 0.1), at, kind=BodyKind.MOVABLE) for name, at in places.items()]
    return ObjectPathProblem(
        box("brick", (0.07, 0.07, 0.1), (0, 0, 0)),
        pose((-0.6, -0.1, 0.1)),
        pose((0.6, -0.1, 0.1)),
        (TABLE, *walls, *boxes),
        motion="planar",
        removable=frozenset(places),
    )
