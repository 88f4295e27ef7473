"""``hmap tasks``: what can be planned."""

import argparse

HELP = "list the tasks that come with hmap"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    pass


def run(arguments: argparse.Namespace) -> int:
    tasks = descriptions()
    width = max(map(len, tasks), default=0)
    for name, description in tasks.items():
        print(f"{name:<{width}}  {description}")
    return 0


def descriptions() -> dict[str, str]:
    """Task name -> its description in one line."""
    from hmap_core.scenes import list_tasks  # slow to import
    from hmap_core.scenes.document import read
    from hmap_core.scenes.resources import package_path

    folder = package_path("hmap_scenes") / "tasks"
    return {name: " ".join(str(read(folder / f"{name}.yaml").data["description"]).split()) for name in list_tasks()}
