"""The judge: reads a plan, runs every check, and writes the verdict."""

from hmap_core.validation import collision, contacts, document, joints, objects, physics
from hmap_core.validation.pairs import PairBuilder
from hmap_core.validation.report import Findings, Report
from hmap_core.validation.support import SupportCheck
from hmap_core.validation.world import World


def _may_touch(made: list[contacts.Contact], carried: set[frozenset[str]]) -> set[frozenset[str]]:
    """Pairs of owners whose distance says nothing about the plan's clearance."""
    touched = {frozenset((owner, contact.object)) for contact in made for owner in contact.touching}
    return touched | carried


def check(plan: dict) -> Report:
    """Judge a plan.

    Args:
        plan: the content of a plan file (``docs/validation.md`` lists what is read).

    Returns:
        the verdict, with one violation for each broken rule and set of bodies.

    Raises:
        InputError: code ``INVALID_PLAN_FILE``; the file cannot be judged.
    """
    world = World(document.read(plan))
    findings = Findings()
    made = contacts.collect(world)
    joints.check(world, findings)
    objects.check(world, made, findings)
    contacts.check(world, made, findings)
    support = SupportCheck(world, made, findings)
    support.run()
    physics.check(world, made, findings)
    pairs = PairBuilder(world, _may_touch(made, support.pairs)).build()
    clearance = collision.check(world, pairs, findings)
    error = objects.check_goal(world, findings)
    violations = findings.violations()
    return Report(not violations, violations, error, clearance)
