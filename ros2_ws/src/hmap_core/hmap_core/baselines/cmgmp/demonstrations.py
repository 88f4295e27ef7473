"""The five demonstrations of the authors of CMGMP as object problems, with their sizes, coefficients and thresholds.

Restated from the files of their examples (https://github.com/XianyiCheng/CMGMP). Lengths are those of these files; the
weight only scales the forces.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hmap_core.baselines.cmgmp.fingers import PointFingers
from hmap_core.baselines.cmgmp.polyhedra import Polyhedron, polyhedron
from hmap_core.baselines.cmgmp.problem import ObjectProblem
from hmap_core.baselines.cmgmp.search import Search
from hmap_core.exceptions import InputError, PlannerError
from hmap_core.transforms import pose

SURFACE = 300  # points of the surface that fingers may touch


@dataclass(frozen=True)
class Demonstration:
    """A problem with point fingers.

    Attributes:
        problem: the object among its obstacles.
        size: (3,) of the object, a box.
        fingers: their number; radius: of a fingertip; patch: whether it is soft.
        touched: normals (k, 3) of the faces that may be touched.
        samples: extensions after which a search gives up.
        to_goal: share of the extensions towards the goal.
    """

    problem: ObjectProblem
    size: tuple[float, float, float]
    fingers: int
    radius: float
    patch: bool
    touched: Sequence[tuple[int, int, int]]
    samples: int = 500
    to_goal: float = 0.7

    def manipulator(self, rng: np.random.Generator) -> PointFingers:
        """Its fingers, with points drawn on the faces that may be touched."""
        half = 0.5 * np.array(self.size)
        normals = np.array(self.touched, float)
        areas = np.array([np.prod(np.delete(self.size, np.abs(n).argmax())) for n in normals])
        chosen = normals[rng.choice(len(normals), SURFACE, p=areas / areas.sum())]
        points = rng.uniform(-half, half, (SURFACE, 3))
        points = np.where(chosen != 0.0, chosen * half, points)
        return PointFingers(self.problem, points, chosen, self.fingers, self.radius, self.patch)


ALL_FACES = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))


def box(size: Sequence[float], centre: Sequence[float] = (0.0, 0.0, 0.0)) -> Polyhedron:
    """A box of full extents (3,)."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    return polyhedron(corners * np.asarray(size, float) + np.asarray(centre, float))


def push_along_walls() -> Demonstration:
    """Two fingers push a box over the ground to a wall, up along it, and onto its top."""
    problem = ObjectProblem(
        "push_along_walls", [box([0.2] * 3)], [box((2, 2, 1), (1, 0, -0.5)), box((1, 2, 2), (-0.5, 0, 0))],
        pose((0.5, 0, 0.1)), pose((-0.3, 0, 1.1)), friction=0.4, finger_friction=0.8, weight=1.0,
        lower=np.array([-5.0, 1.0, 0.0]), upper=np.array([5.0, 11.0, 0.0]), turns=np.array([0.0, 0.0, 1.0]),
        translation_weight=1.0, turn_weight=0.3, longest=10.0, widest=np.pi / 2, reached=np.deg2rad(5),
    )  # fmt: skip
    return Demonstration(problem, (0.2, 0.2, 0.2), 2, 0.1, False, ALL_FACES, samples=100, to_goal=1.0)


def pick_card() -> Demonstration:
    """Two soft fingers slide a card over the edge of a table and turn it upright above."""
    size = (2.0, 2.0, 0.5)
    problem = ObjectProblem(
        "pick_card", [box(size)], [box((4, 4, 0.2), (0, 0, -0.1))],
        pose((0, 0, 0.25)), pose((2.5, 0, 1.5), (0, -np.sqrt(0.5), 0, np.sqrt(0.5))),
        friction=0.2, finger_friction=0.7, weight=0.1,
        lower=np.array([-1.0, -1.0, 0.0]), upper=np.array([5.0, 1.0, 0.5]),
        translation_weight=1.0, turn_weight=0.4, longest=0.75, widest=np.deg2rad(35), reached=2 * np.deg2rad(10),
    )  # fmt: skip
    return Demonstration(problem, size, 2, 0.15, True, ((0, 0, 1), (0, 0, -1)))


def peg_out_of_hole() -> Demonstration:
    """Three soft fingers lift a peg out of a hole with little room round it."""
    length, height, wall, gap = 2.0, 4.0, 1.0, 0.3
    size, side = (length, length, height), length / 2 + gap + wall / 2
    walls = [box((wall, length + 2 * wall, height), (x, 0, height / 2)) for x in (-side, side)]
    walls += [box((length + 2 * wall, wall, height), (0, y, height / 2)) for y in (-side, side)]
    problem = ObjectProblem(
        "peg_out_of_hole", [box(size)], [*walls, box((10, 10, 1), (0, 0, -0.5))],
        pose((0, 0, height / 2)), pose((0, -2 * gap, 2 * height)), friction=0.4, finger_friction=0.8, weight=1.0,
        lower=np.array([-length, -length, 0.0]), upper=np.array([length, length, 2 * height]),
        longest=8.0, widest=np.deg2rad(35), reached=length * np.deg2rad(5),
    )  # fmt: skip
    return Demonstration(problem, size, 3, 1.2 * gap, True, ALL_FACES[:5])


def book_out_of_row() -> Demonstration:
    """Three soft fingers take a book out from between two others."""
    size, gap = (1.0, 4.0, 4.0), 0.1
    books = [box(size, (x, 0, 2.0)) for x in (-1.0 - gap, 1.0 + gap)]
    problem = ObjectProblem(
        "book_out_of_row", [box(size)], [*books, box((4, 1, 4), (0, 2.5 + gap, 2.0)), box((10, 10, 1), (0, 0, -0.5))],
        pose((0, 0, 2)), pose((0, -4, 4)), friction=0.1, finger_friction=0.9, weight=0.1,
        lower=np.array([-1.0, -6.0, 0.0]), upper=np.array([1.0, 1.0, 12.0]),
        longest=1.0, widest=np.deg2rad(35), reached=4 * np.deg2rad(10),
    )  # fmt: skip
    return Demonstration(problem, size, 3, 1.5 * gap, True, (*ALL_FACES[:2], ALL_FACES[3], ALL_FACES[4]))


def flip_cube() -> Demonstration:
    """Two fingers turn a cube on the ground upside down."""
    problem = ObjectProblem(
        "flip_cube", [box([1.0] * 3)], [box((10, 10, 1), (0, 0, -0.5))],
        pose((0, 0, 0.5)), pose((0.2, 0, 0.5), (0, -1, 0, 0)), friction=0.3, finger_friction=0.8, weight=0.1,
        lower=np.array([-2.5, -2.5, 0.0]), upper=np.array([2.5, 2.5, 1.0]),
        translation_weight=0.5, turn_weight=1.0, longest=1.0, widest=np.deg2rad(50), reached=np.deg2rad(5),
    )  # fmt: skip
    return Demonstration(problem, (1.0, 1.0, 1.0), 2, 0.2, False, ALL_FACES)


def solve(demonstration: Demonstration, seed: int, time_limit: float) -> tuple[bool, float, int]:
    """Search one demonstration.

    Args:
        demonstration: the problem and its fingers.
        seed: the only source of randomness.
        time_limit: seconds of CPU time, so that several can be measured at once.

    Returns:
        Whether it was solved, the CPU time in s, and the number of nodes of the tree.
    """
    rng, began = np.random.default_rng(seed), time.process_time()

    def going_on(number: int) -> None:
        if time.process_time() - began > time_limit:
            raise PlannerError(f"no way within {time_limit:g} s of CPU time")

    search = Search(demonstration.problem, demonstration.manipulator(rng), rng)
    try:
        found = search.solve(demonstration.samples, going_on, demonstration.to_goal)
    except PlannerError:
        found = None
    return found is not None, time.process_time() - began, len(search.nodes)


DEMONSTRATIONS: dict[str, Callable[[], Demonstration]] = {
    "push_along_walls": push_along_walls,
    "pick_card": pick_card,
    "peg_out_of_hole": peg_out_of_hole,
    "book_out_of_row": book_out_of_row,
    "flip_cube": flip_cube,
}


def demonstrations(names: Sequence[str] = ()) -> dict[str, Demonstration]:
    """The demonstrations of some names, by default all.

    Raises:
        InputError: there is no demonstration of a name.
    """
    for name in names:
        if name not in DEMONSTRATIONS:
            raise InputError(f"unknown demonstration '{name}'; there are {', '.join(DEMONSTRATIONS)}")
    return {name: DEMONSTRATIONS[name]() for name in names or DEMONSTRATIONS}
