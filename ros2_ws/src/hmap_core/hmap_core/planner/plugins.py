"""Parts of the planner by name: built in, registered in Python, or found by Python entry points.

A package adds a part by an entry point in one of the groups below; its value is a class or a function that returns the
part. A name may carry an argument after a colon, as in ``ompl:RRTConnect``: then it is called with that argument.
Nothing is imported before it is chosen.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from hmap_core import __version__
from hmap_core.exceptions import InputError

OBJECT_PATH_PLANNERS = "hmap.object_path_planners"  # of ObjectPathPlanner
CONTACT_PROPOSERS = "hmap.contact_proposers"  # of ContactProposer
TRANSIT_PLANNERS = "hmap.transit_planners"  # of TransitPlanner
PLANNERS = "hmap.planners"  # of ManipulationPlanner
KINDS = {
    OBJECT_PATH_PLANNERS: ("object-path planner", "plan_path"),
    CONTACT_PROPOSERS: ("contact proposer", "propose"),
    TRANSIT_PLANNERS: ("transit planner", "find_transit"),
    PLANNERS: ("planner", "plan"),
}  # group -> what it is called, and the method that a part of it has
DEFAULT_PLANNER, DEFAULT_PROPOSER = "hmap", "auto"
_BUILT_IN = {
    OBJECT_PATH_PLANNERS: {
        "hmap": "hmap_core.planner.object_path:BidirectionalSearch",
        "ompl": "hmap_core.planner.ompl_object_path:ompl_object_path",
    },
    CONTACT_PROPOSERS: {
        "auto": "hmap_core.learning.proposer:where_known",
        "sampled": "hmap_core.planner.sampled_contacts:SampledContacts",
        "learned": "hmap_core.learning.proposer:LearnedContacts",
    },
    TRANSIT_PLANNERS: {
        "hmap": "hmap_core.planner.transit:TreeTransit",
        "ompl": "hmap_core.planner.ompl_transit:OmplTransit",
    },
    PLANNERS: {
        "hmap": "hmap_core.planner.hmap_planner:hmap_planner",
        "birrt": "hmap_core.baselines.birrt:BirrtPlanner",
        "komo": "hmap_core.baselines.komo.planner:Komo",
        "lgp_star": "hmap_core.baselines.lgp_star.planner:LgpStar",
        "hpp_manipulation": "hmap_core.benchmark.hpp_planner:HppManipulation",
        "rai_komo": "hmap_core.benchmark.rai_planner:RaiKomo",
        "rai_lgp_star": "hmap_core.benchmark.rai_planner:RaiLgpStar",
        "cmgmp": "hmap_core.baselines.cmgmp:CmgmpPlanner",
        "lgp": "hmap_core.baselines.lgp:LgpPlanner",
    },
}
_registered: dict[str, dict[str, "Plugin"]] = {group: {} for group in KINDS}


@dataclass(frozen=True)
class Plugin:
    """A part that can be chosen by name.

    Attributes:
        group: one of KINDS.
        name: by which it is chosen.
        origin: the distribution or module that provides it.
        version: of the distribution; empty where there is none.
        load: returns what makes the part, a class or a function.
    """

    group: str
    name: str
    origin: str
    version: str
    load: Callable[[], Callable[..., Any]]


def register(group: str, name: str, factory: Callable[..., Any]) -> None:
    """Register a part in this process; it takes the place of another one of the same name.

    Args:
        group: one of KINDS.
        name: by which it is chosen.
        factory: a class or function that returns the part; called without arguments, or with the text after the colon.

    Raises:
        InputError: there is no such group.
    """
    _check_group(group)
    _registered[group][name] = Plugin(group, name, factory.__module__, "", lambda: factory)


def plugins(group: str) -> dict[str, Plugin]:
    """All parts of a group by name: built in, from entry points, registered; the later takes precedence.

    Raises:
        InputError: there is no such group.
    """
    _check_group(group)
    found = {
        name: Plugin(group, name, "hmap_core", __version__, partial(_attribute, value))
        for name, value in _BUILT_IN[group].items()
    }
    return found | _installed(group, tuple(sys.path)) | _registered[group]


@lru_cache
def _installed(group: str, path: tuple[str, ...]) -> dict[str, Plugin]:
    """Parts from entry points of what is installed on ``path``, which is ``sys.path``: reading it takes 10 ms."""
    found = {}
    for entry in entry_points(group=group):
        distribution = entry.dist
        origin = (distribution.name, distribution.version) if distribution else (entry.module, "")
        found[entry.name] = Plugin(group, entry.name, *origin, entry.load)
    return found


def create(group: str, name: str) -> Any:
    """Create a part by its name.

    Args:
        group: one of KINDS.
        name: a name of :func:`plugins`, or ``NAME:ARGUMENT``.

    Raises:
        InputError: the name is unknown, or the part cannot be loaded or is none of this kind.
    """
    what, method = KINDS[group]
    own, colon, argument = name.partition(":")
    known = plugins(group)
    if own not in known:
        raise InputError(f"unknown {what} '{name}'; there are {', '.join(sorted(known))}")
    try:
        factory = known[own].load()
        part = factory(argument) if colon else factory()
    except InputError:
        raise
    except Exception as error:
        raise InputError(
            f"the {what} '{name}' of {known[own].origin} cannot be loaded: {type(error).__name__}: {error}"
        ) from error
    if not callable(getattr(part, method, None)):
        raise InputError(f"the {what} '{name}' of {known[own].origin} has no method '{method}'")
    return part


def resolve(group: str, part: Any) -> Any:
    """A part as it is given, or created if it is given by name; None stays None."""
    return create(group, part) if isinstance(part, str) else part


def _check_group(group: str) -> None:
    if group not in KINDS:
        raise InputError(f"unknown group '{group}'; there are {', '.join(KINDS)}")


@lru_cache
def _attribute(value: str) -> Callable[..., Any]:
    entry = EntryPoint("", value, "")
    factory: Callable[..., Any] = getattr(import_module(entry.module), entry.attr)
    return factory
