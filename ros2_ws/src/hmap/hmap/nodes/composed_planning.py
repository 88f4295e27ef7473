"""The supervisor and the planning nodes in one process: it calls their components directly, without services.

The services are offered all the same, for other programs. Parameters are given by node: ``-p supervisor:seed:=1``.
"""

import sys
from collections.abc import Sequence

from hmap.node import HmapNode, run_nodes
from hmap.nodes.contact_proposer import ContactProposerNode
from hmap.nodes.komo_optimiser import KomoOptimiser
from hmap.nodes.supervisor import Supervisor
from hmap.nodes.waypoint_planner import WaypointPlanner
from hmap_core.planner import local_components


def make_nodes() -> Sequence[HmapNode]:
    """The nodes.

    Raises:
        InputError: another supervisor runs already, or a parameter is wrong.
    """
    paths, contacts, motions = WaypointPlanner(), ContactProposerNode(), KomoOptimiser()
    components = local_components(paths.planner, contacts.proposer, segments=motions.segments)
    return paths, contacts, motions, Supervisor(components)


def main(args: list[str] | None = None) -> int:
    """Run the nodes; the exit code."""
    return run_nodes(make_nodes, plans=True, args=args)


if __name__ == "__main__":
    sys.exit(main())
