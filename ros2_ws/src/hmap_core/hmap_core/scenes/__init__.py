"""Scenes, tasks and robots as data: YAML files with a strict schema, randomised by a seed. See ``docs/scenes.md``."""

from hmap_core.scenes.bodies import list_objects
from hmap_core.scenes.builder import SceneBuilder
from hmap_core.scenes.json_schema import export_json_schema
from hmap_core.scenes.loader import list_tasks, load_scene
from hmap_core.scenes.portable import scene_from_text, scene_to_dict, scene_to_text
from hmap_core.scenes.robots import list_robots, load_robot_model

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
]
