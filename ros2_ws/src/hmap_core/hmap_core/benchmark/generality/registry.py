"""All families by name."""

from collections.abc import Sequence

from hmap_core.benchmark.generality import (
    everyday,
    infeasible,
    other_arms,
    regrasp,
    removal,
    rolling,
    sliding,
    tooling,
    two_arms,
)
from hmap_core.benchmark.generality.family import Family
from hmap_core.exceptions import InputError

GROUPS = (everyday, other_arms, regrasp, two_arms, rolling, removal, tooling, sliding, infeasible)
FAMILIES: dict[str, Family] = {family.name: family for group in GROUPS for family in group.FAMILIES}


def families(names: Sequence[str] = ()) -> list[Family]:
    """The families of these names; all of them without names.

    Raises:
        InputError: a name is unknown.
    """
    unknown = [name for name in names if name not in FAMILIES]
    if unknown:
        raise InputError(f"unknown family {unknown[0]!r}. Known: {', '.join(FAMILIES)}")
    return [FAMILIES[name] for name in dict.fromkeys(names)] or list(FAMILIES.values())
