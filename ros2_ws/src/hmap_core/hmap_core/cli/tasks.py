"""``hmap tasks``: lists the tasks."""

import argparse

from hmap_core import scenes

HELP = "list the tasks that come with hmap"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The command has no options."""
    pass


def run(arguments: argparse.Namespace) -> int:
    """Print names and descriptions; the exit code."""
    tasks = scenes.task_descriptions()
    width = max(map(len, tasks), default=0)
    for name, description in tasks.items():
        print(f"{name:<{width}}  {description}")
    return 0
