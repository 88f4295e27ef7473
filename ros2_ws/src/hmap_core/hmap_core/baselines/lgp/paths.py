"""The bound by paths: the optimisation problem of a whole skeleton, which is also its solution."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np

from hmap_core.baselines.lgp.actions import Action, support_of
from hmap_core.baselines.transfers import NOT_ON_THE_WAY, Transfer, TransferProblem
from hmap_core.exceptions import Code, MotionError
from hmap_core.planner import steps
from hmap_core.planner.context import SearchContext
from hmap_core.planner.solution_sequence import SolutionSequence
from hmap_core.types import ContactPoint

GUESSES = 1  # further first guesses of a path with the same contacts


@dataclass(frozen=True)
class BoundedAction:
    """An action for which the bound by poses holds.

    Attributes:
        action: the action.
        T_start, T_end: (7,) of its object.
        contacts: that hold at both.
    """

    action: Action
    T_start: np.ndarray
    T_end: np.ndarray
    contacts: list[ContactPoint]


def paths(context: SearchContext, actions: Sequence[BoundedAction], rng: np.random.Generator) -> SolutionSequence:
    """The motions of a skeleton, with contacts drawn at random: one problem for each run of actions of one hand.

    Raises:
        MotionError: a problem has no feasible path.
        PlannerError: the time is up.
    """
    sequence = SolutionSequence(context.start)
    for run in runs_of(actions):
        grasp = run[0].action.hand.grasp
        if grasp is not None:
            sequence = steps.pick_tool(context, sequence, grasp)
        transfers = [_transfer(context, sequence, own, rng) for own in run]
        context.time_left()
        found = TransferProblem(run[0].action.hand.scene, sequence.state, transfers).solve(rng, GUESSES)
        if found is None:
            raise MotionError(f"no path of '{run[-1].action}' is feasible", Code.NO_MOTION)
        for motion in found:
            sequence = sequence.after(motion)
        placed = steps.place_tool(context, sequence)
        if placed is None:
            raise MotionError(context.record.reason, Code.NO_MOTION)
        sequence = placed
    return sequence


def runs_of(actions: Sequence[BoundedAction]) -> list[list[BoundedAction]]:
    """Actions in their order, in runs with the same grasp on a tool, or with bare hands."""
    return [list(run) for _, run in groupby(actions, key=lambda own: own.action.hand.grasp)]


def _transfer(
    context: SearchContext, sequence: SolutionSequence, own: BoundedAction, rng: np.random.Generator
) -> Transfer:
    scene, object = context.scene, own.action.object
    planar = scene.motion == "planar" and object == scene.goal.object
    slides_on = support_of(scene, sequence.state, object) if planar else None
    contact = own.contacts[int(rng.integers(len(own.contacts)))]
    return Transfer(own.action.hand.robot, object, contact, own.T_start, own.T_end, NOT_ON_THE_WAY, slides_on)
