"""A package of somebody else, with a part of each kind, found by entry points."""

from pathlib import Path

MODULE = '''
"""A proposer, an object-path planner and a whole planner, as somebody else writes them."""

import numpy as np

from hmap_core.planner import ContactProposals, HmapPlanner
from hmap_core.planner.object_path import BidirectionalSearch
from hmap_core.planner.sampled_contacts import SampledContacts


class LastFirst:
    """Proposes the last few of each batch of sampled contacts in the opposite order, with a confidence."""

    def propose(self, query):
        for batch in SampledContacts().propose(query):
            last = batch.contacts[:-10:-1]
            yield ContactProposals(last, tuple(np.linspace(1.0, 0.0, len(last))))


class Detour:
    """Plans as hmap does, and says so."""

    def __init__(self, label="detour"):
        self.label = label

    def plan_path(self, query):
        print(f"{self.label} plans {query.goal.object}")
        return BidirectionalSearch().plan_path(query)


class Twice:
    """A whole method."""

    def plan(self, scene, state=None, seed=0, time_limit=60.0, progress=None, cancel=None):
        print("twice plans", scene.task)
        return HmapPlanner().plan(scene, state, seed + 1, time_limit, progress, cancel)


class Broken:
    """Has no method of a planner."""
'''
ENTRY_POINTS = """
[hmap.contact_proposers]
last_first = foreign_parts:LastFirst

[hmap.object_path_planners]
detour = foreign_parts:Detour

[hmap.planners]
twice = foreign_parts:Twice
broken = foreign_parts:Broken
missing = foreign_parts:Missing
"""


def install(folder: Path) -> Path:
    """Write the package, as it lies in a site-packages folder, and return that folder."""
    (folder / "foreign_parts.py").write_text(MODULE)
    info = folder / "foreign_parts-1.2.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: foreign-parts\nVersion: 1.2\n")
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    return folder
