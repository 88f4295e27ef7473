"""``hmap plugins``: the parts of the planner that can be chosen by name."""

import argparse
import json

HELP = "list the planners, object-path planners and contact proposers, with their origin"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options of the command."""
    parser.add_argument("--json", action="store_true", help="print the list for scripts")


def run(arguments: argparse.Namespace) -> int:
    """List the parts; the exit code."""
    from hmap_core.planner.plugins import KINDS, plugins

    rows = [
        {"group": group, "kind": kind, "name": plugin.name, "origin": plugin.origin, "version": plugin.version}
        for group, (kind, _) in KINDS.items()
        for plugin in sorted(plugins(group).values(), key=lambda plugin: plugin.name)
    ]
    if arguments.json:
        print(json.dumps(rows))
        return 0
    for row in rows:
        print(f"{row['kind']:<22}{row['name']:<20}{row['origin']} {row['version']}".rstrip())
    return 0
