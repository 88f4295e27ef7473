"""The page for the browser, as a node of a graph."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from hmap.launcher.options import LOCALHOST
from hmap.launcher.ports import free_port
from hmap.launcher.processes import Graph


def start_page(
    graph: Graph, first: int, parameters: Mapping[str, object] | None = None, files: Sequence[Path] = ()
) -> str:
    """Start the viewer on a free port of this machine.

    Args:
        graph: to which it belongs.
        first: port to begin with.
        parameters: of the node, beside its port.
        files: with further parameters.

    Returns:
        Where the page is, for the operator.
    """
    port = free_port(LOCALHOST, first)
    graph.start("viewer", {**(parameters or {}), "port": port}, files)
    return f"page: http://{LOCALHOST}:{port}"
