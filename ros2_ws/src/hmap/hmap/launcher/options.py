"""Command-line options of all commands that start a graph."""

import argparse

from hmap_core.cli.main import port_number

LOCALHOST, PAGE_PORT = "127.0.0.1", 8080  # of the page for the browser


def graph_arguments(parser: argparse.ArgumentParser) -> None:
    """Add ``--no-viewer``, ``--port`` and ``--composed``."""
    parser.add_argument("--no-viewer", action="store_true", help="do not offer the page for the browser")
    text = f"of the page, or the next free one ({PAGE_PORT})"
    parser.add_argument("--port", type=port_number, default=PAGE_PORT, metavar="N", help=text)
    text = "supervisor and planners in one process, without services between them: planning costs less, and no planner "
    text += "is started anew"
    parser.add_argument("--composed", action="store_true", help=text)
