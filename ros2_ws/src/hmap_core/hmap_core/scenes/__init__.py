"""Scenes, tasks and robots as data: YAML files with a strict schema, randomised by a seed. See ``docs/scenes.md``."""

from typing import TYPE_CHECKING

from hmap_core.lazy import lazy_exports

if TYPE_CHECKING:
    from hmap_core.scenes.bodies import list_objects
    from hmap_core.scenes.builder import SceneBuilder
    from hmap_core.scenes.json_schema import export_json_schema
    from hmap_core.scenes.loader import load_scene
    from hmap_core.scenes.portable import scene_from_text, scene_to_dict, scene_to_text
    from hmap_core.scenes.robots import list_robots, load_robot_model
    from hmap_core.scenes.tasks import list_tasks, task_descriptions

__all__ = [
    "SceneBuilder",
    "export_json_schema",
    "list_objects",
    "list_robots",
    "list_tasks",
    "load_robot_model",
    "load_scene",
    "scene_from_text",
    "scene_to_dict",
    "scene_to_text",
    "task_descriptions",
]

# Imported when they are used: `hmap tasks` needs none of the numerical libraries.
__getattr__ = lazy_exports(
    __name__,
    {
        "SceneBuilder": "builder",
        "export_json_schema": "json_schema",
        "list_objects": "bodies",
        "list_robots": "robots",
        "list_tasks": "tasks",
        "load_robot_model": "robots",
        "load_scene": "loader",
        "scene_from_text": "portable",
        "scene_to_dict": "portable",
        "scene_to_text": "portable",
        "task_descriptions": "tasks",
    },
)
