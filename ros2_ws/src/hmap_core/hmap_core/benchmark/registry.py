"""The problems by name. A new problem is an entry here: seeded instances, two solvers, and a judge."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from hmap_core.benchmark import hmap_side, loop, rai_side, rrt
from hmap_core.benchmark.instances import Answer
from hmap_core.benchmark.judge import judge
from hmap_core.benchmark.problems import contact_ik, object_path, pick_place, puck, push_step, tunnel_push, two_arm
from hmap_core.exceptions import InputError


@dataclass(frozen=True)
class Side:
    """One of the two compared solvers.

    Attributes:
        prepare: (instance) -> the argument ``prepared`` of ``solve``; not timed.
        solve: (instance, prepared) -> Answer; timed.
    """

    prepare: Callable[[Any], Any]
    solve: Callable[[Any, Any], Answer]


@dataclass(frozen=True)
class Problem:
    """A problem of the benchmark.

    Attributes:
        instance: seed -> instance.
        hmap: hmap's side.
        rai: RAI's side.
        judge: (instance, path) -> the errors of the path, in words.
        ompl: the side of a planner of OMPL, where there is one.
    """

    instance: Callable[[int], Any]
    hmap: Side
    rai: Side
    judge: Callable[[Any, Any], list[str]]
    ompl: Side | None = None


def motion(instance: Callable[[int], Any]) -> Problem:
    """A problem with motion instances."""
    ours, theirs = Side(hmap_side.prepare, hmap_side.solve), Side(rai_side.prepare, rai_side.solve)
    return Problem(instance, ours, theirs, judge)


def object_path_problem(instance: Callable[[int], Any]) -> Problem:
    """A problem of the path of an object without a robot."""
    ours, theirs = Side(rrt.prepare_hmap, rrt.solve_hmap), Side(rrt.prepare_rai, rrt.solve_rai)
    return Problem(instance, ours, theirs, rrt.judge, Side(rrt.prepare_hmap, rrt.solve_ompl))


PROBLEMS: dict[str, Problem] = {
    "contact_ik": motion(contact_ik.contact_ik),
    "contact_ik_surface": motion(contact_ik.contact_ik_surface),
    "push_step": motion(push_step.push_step),
    "pick_place": motion(pick_place.pick_place),
    "pick_place_rounded": motion(pick_place.pick_place_rounded),
    "puck_komo": motion(puck.puck_komo),
    "puck_loop": Problem(
        puck.puck_loop,
        Side(loop.HMAP.configurations, loop.HMAP.run),
        Side(loop.RAI.configurations, loop.RAI.run),
        loop.judge_loop,
    ),
    "tunnel_push": motion(tunnel_push.tunnel_push),
    "two_arm": motion(two_arm.two_arm),
    "rrt_se2": object_path_problem(object_path.se2),
    "rrt_se3": object_path_problem(object_path.se3),
}


def find(names: list[str]) -> dict[str, Problem]:
    """The problems with these names; all problems for an empty list.

    Raises:
        InputError: a problem does not exist.
    """
    for name in names:
        if name not in PROBLEMS:
            raise InputError(f"problem '{name}' is not known; allowed: {', '.join(PROBLEMS)}")
    return {name: PROBLEMS[name] for name in names or PROBLEMS}
