"""JSON Schemas of the scene files, for editors. ``python -m hmap_core.scenes`` writes them."""

import json
from pathlib import Path

from pydantic import BaseModel

from hmap_core.scenes import resources
from hmap_core.scenes.schema import ObjectFile, RobotFile, TaskFile

MODELS: dict[str, type[BaseModel]] = {"task": TaskFile, "object": ObjectFile, "robot": RobotFile}


def schema_folder() -> Path:
    """Folder of the schemas in the ``hmap_scenes`` package.

    Raises:
        InputError: the package is not installed.
    """
    return resources.package_path("hmap_scenes") / "schema"


def schema_text(name: str, model: type[BaseModel]) -> str:
    """JSON Schema of a file format, version 1.

    Args:
        name: of the format, such as ``task``.
        model: pydantic model of the format.

    Returns:
        The schema as JSON text.
    """
    schema = model.model_json_schema(by_alias=True)
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": f"hmap/{name}.schema.json"} | schema
    return json.dumps(schema, indent=1) + "\n"


def export_json_schema(folder: Path | None = None) -> list[Path]:
    """Writes ``<name>.schema.json`` for every kind of scene file.

    Args:
        folder: None for :func:`schema_folder`.

    Returns:
        Paths of the files.
    """
    folder = schema_folder() if folder is None else folder
    paths = []
    for name, model in MODELS.items():
        paths.append(folder / f"{name}.schema.json")
        paths[-1].write_text(schema_text(name, model), encoding="utf-8")
    return paths
