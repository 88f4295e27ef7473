"""The tasks that come with hmap: their names and descriptions, without loading them."""

from hmap_core.scenes import resources
from hmap_core.scenes.document import read_key


def list_tasks(unsolvable: bool = True) -> list[str]:
    """Names of the tasks that come with hmap, such as ``tunnel`` and ``published/tunnel``.

    Args:
        unsolvable: include tasks without a solution, which exist for their error messages.

    Returns:
        The names, sorted.
    """
    folder = resources.package_path("hmap_scenes") / "tasks"
    return sorted(
        path.relative_to(folder).with_suffix("").as_posix()
        for path in folder.rglob("*.yaml")
        if unsolvable or not read_key(path, "unsolvable")
    )


def task_descriptions() -> dict[str, str]:
    """The description of each task.

    Returns:
        Name -> description, in one line; sorted by name.
    """
    folder = resources.package_path("hmap_scenes") / "tasks"
    return {name: " ".join(str(read_key(folder / f"{name}.yaml", "description")).split()) for name in list_tasks()}
