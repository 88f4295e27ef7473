"""Writes the JSON Schemas of the scene files."""

from hmap_core.scenes.json_schema import export_json_schema

if __name__ == "__main__":
    print(*export_json_schema(), sep="\n")
