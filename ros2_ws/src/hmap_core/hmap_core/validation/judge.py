"""The judge: reads a plan, runs every check, and returns the verdict."""

import math
from collections.abc import Callable

from hmap_core.validation import (
    collision,
    contacts,
    document,
    grips,
    joints,
    loads,
    objects,
    physics,
    presses,
    removals,
    shared,
    stacks,
    switches,
    toppling,
)
from hmap_core.validation.collision import Clearance
from hmap_core.validation.held import HeldBodies
from hmap_core.validation.pairs import PairBuilder
from hmap_core.validation.report import Findings, Report
from hmap_core.validation.support import SupportCheck
from hmap_core.validation.world import World

NEAR = 0.5  # m; pairs that stay farther apart are compared only if none is nearer, and never for held bodies
CLOSE = (0.01, 0.03, 0.1)  # m; the same in worlds of many parts, one after the other


def check(plan: dict, check_time: Callable[[], object] = document.no_limit) -> Report:
    """Judges a plan.

    Args:
        plan: the content of a plan file (``docs/validation.md`` lists the keys that are read).
        check_time: called again and again, at least every few hundredths of a second; may raise to end it. No check is
            left out for lack of time.

    Returns:
        The verdict, with one violation for each violated rule and set of bodies.

    Raises:
        InputError: INVALID_PLAN_FILE; the file cannot be judged.
    """
    world = World(document.read(plan, check_time), check_time)
    findings = Findings()
    made = contacts.collect(world)
    joints.check(world, findings)
    switches.check(world, findings)
    objects.check(world, made, findings)
    removals.check(world, findings)
    contacts.check(world, made, findings)
    grips.check(world, made, findings)
    shared.check(world, made, findings)
    support = SupportCheck(world, made, findings)
    support.run()
    stacks.check(world, made, support, findings)
    physics.check(world, made, findings)
    toppling.check(world, made, support.finder, findings)
    presses.check(world, made, support.finder, findings)
    loads.check(world, made, support.finder, findings)
    clearance = _clearance(world, HeldBodies.of(world, made), support.pairs, findings)
    error = objects.check_goal(world, findings)
    violations = findings.violations()
    return Report(not violations, violations, error, clearance.every, clearance.held)


def executed_clearance(plan: dict, executed: dict) -> float | None:
    """The smallest distance of what was executed, between all that does not touch by design.

    Args:
        plan: the content of a plan file; says what touches by design.
        executed: the same with the measured trajectory.

    Returns:
        metres, negative where bodies overlap; None where nothing can collide.

    Raises:
        InputError: INVALID_PLAN_FILE; one of the two cannot be judged.
    """
    planned = World(document.read(plan))
    made = contacts.collect(planned)
    support = SupportCheck(planned, made, Findings())
    support.run()
    held = HeldBodies({}, HeldBodies.of(planned, made).touching)  # what is held, and when, the measurement does not say
    return _clearance(World(document.read(executed)), held, support.pairs, Findings()).every


def _clearance(world: World, held: HeldBodies, carried: set[frozenset[str]], findings: Findings) -> Clearance:
    """Look for penetrations, and find the smallest clearances; pairs that touch by design do not count for these."""
    pairs = PairBuilder(world, held.touching | carried, held)
    every = nearest = None
    within = 0.0  # a larger clearance may be that of a pair that was left out
    for reach in (*CLOSE, NEAR, math.inf) if pairs.many else (NEAR, math.inf):
        if every is None or every > within:
            every, nearest = collision.check(world, pairs.build(reach), findings, held)
        elif reach <= NEAR and (nearest is None or nearest > within):
            nearest = collision.check(world, pairs.build_held(reach), findings, held).held
        within = reach
    return Clearance(every, nearest)
