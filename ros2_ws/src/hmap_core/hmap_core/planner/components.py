"""The parts of which a planning job is composed: local ones here, remote ones in the ROS package."""

from dataclasses import dataclass

from hmap_core.planner.contact_checker import LocalContactChecker
from hmap_core.planner.contact_finder import ProposeAndCheck
from hmap_core.planner.end_contacts import EndContacts
from hmap_core.planner.komo_segments import KomoSegmentPlanner
from hmap_core.planner.object_path import BidirectionalSearch
from hmap_core.planner.protocols import (
    ContactChecker,
    ContactFinder,
    ContactProposer,
    ManipulatorRanker,
    ObjectPathPlanner,
    SegmentPlanner,
)
from hmap_core.planner.sampled_contacts import SampledContacts
from hmap_core.planner.tool_grasps import ToolGraspFinder, ToolGraspSearch


@dataclass(frozen=True)
class PlannerComponents:
    """What Algorithm 1 is composed of.

    Attributes:
        object_path: plans the path of an object (Algorithm 2).
        proposer: proposes contacts that are not checked yet.
        checker: checks contacts of one robot.
        contacts: finds feasible contacts (Algorithm 3).
        segments: plans the motions of robots (KOMO).
        tools: finds grasps on tools.
        end_contacts: finds contacts that serve at the start and at the goal.
        ranker: orders robots, tools and holds before contacts are sampled; None: by geometry alone.
    """

    object_path: ObjectPathPlanner
    proposer: ContactProposer
    checker: ContactChecker
    contacts: ContactFinder
    segments: SegmentPlanner
    tools: ToolGraspFinder
    end_contacts: EndContacts
    ranker: ManipulatorRanker | None = None


def local_components(
    object_path: ObjectPathPlanner | None = None,
    proposer: ContactProposer | None = None,
    checker: ContactChecker | None = None,
    contacts: ContactFinder | None = None,
    segments: SegmentPlanner | None = None,
) -> PlannerComponents:
    """Compose the parts that work in this process.

    Args:
        object_path: by default hmap's own search.
        proposer: queried before sampled contacts; by default contacts are only sampled. One that is a
            :class:`ManipulatorRanker` orders robots, tools and holds, too.
        checker: by default the local feasibility check.
        contacts: by default proposes and checks by the two above.
        segments: by default KOMO in this process.
    """
    sampled, checker = SampledContacts(), checker or LocalContactChecker()
    ranker = proposer if isinstance(proposer, ManipulatorRanker) else None
    return PlannerComponents(
        object_path or BidirectionalSearch(),
        sampled,
        checker,
        contacts or ProposeAndCheck(proposers(proposer), checker),
        segments or KomoSegmentPlanner(),
        ToolGraspSearch(sampled, ranker, proposer if ranker is not None else None),
        EndContacts(sampled),
        ranker,
    )


def proposers(first: ContactProposer | None) -> tuple[ContactProposer, ...]:
    """A proposer with the one that samples as its fallback; None: contacts are only sampled."""
    if first is None or type(first) is SampledContacts:  # one that is derived from it is another one
        return (SampledContacts(),)
    return first, SampledContacts()
