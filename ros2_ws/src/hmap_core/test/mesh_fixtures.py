"""Mesh files of all formats, made by trimesh and changed as text."""

from pathlib import Path

import numpy as np
import trimesh

FORMATS = ("stl", "stl_ascii", "obj", "dae", "glb", "ply")


def box() -> trimesh.Trimesh:
    """A box of 0.1 x 0.2 x 0.3 m with its corner at the origin."""
    mesh = trimesh.creation.box((0.1, 0.2, 0.3))
    mesh.apply_translation((0.05, 0.1, 0.15))
    return mesh


def save(mesh, path: Path, kind: str | None = None) -> Path:
    data = mesh.export(file_type=kind or path.suffix[1:])
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    if path.suffix.lower() == ".dae":
        path.write_text(path.read_text().replace("Y_UP", "Z_UP"))
    return path


def with_unused_vertex(path: Path) -> Path:
    """A box as OBJ or PLY with a vertex 9 m away that no face uses."""
    mesh = box()
    vertices = np.vstack([mesh.vertices, [[9.0, 9.0, 9.0]]])
    return save(trimesh.Trimesh(vertices, mesh.faces, process=False), path)


def in_millimetres(path: Path) -> Path:
    """A box as COLLADA with the unit millimetre."""
    mesh = box()
    mesh.apply_scale(1000.0)
    save(mesh, path)
    unit = '<unit name="millimeter" meter="0.001"/><up_axis>'
    path.write_text(path.read_text().replace("<up_axis>", unit, 1))
    return path


def scene_of_boxes(path: Path) -> Path:
    """A box in two nodes of a GLB scene, 1 m apart along x."""
    scene = trimesh.Scene()
    for x in (0.0, 1.0):
        scene.add_geometry(box(), transform=trimesh.transformations.translation_matrix((x, 0, 0)), geom_name="box")
    path.write_bytes(scene.export(file_type="glb"))
    return path
