"""Splits a concave mesh into convex parts: ``python -m hmap_core.scenes.decompose cup.obj``.

The method is CoACD (Wei et al., "Approximate convex decomposition for 3D meshes with collision-aware concavity and tree
search", SIGGRAPH 2022). The parts are files that can be inspected and shared. The command prints the ``parts`` entry
for a scene file; :mod:`hmap_core.scenes.convex_parts` does the same for a mesh with ``decompose: true``.
"""

import argparse
import sys
from pathlib import Path

import coacd
import numpy as np
import trimesh

from hmap_core.command_line import YES, keep_for_results, run_reported
from hmap_core.exceptions import Code, InputError
from hmap_core.mesh_files import read_mesh

CONCAVITY = 0.05  # largest deviation of a part from its hull, relative to the size of the mesh
MIN_CONCAVITY = 0.01
SEED = 0
# triangles from which on a mesh is decomposed coarsely; else that takes many minutes
FINE = 20_000
# what that means: a closed surface with so many cells along the longest side takes its place, and the search is shorter
COARSE = {
    "preprocess_mode": "on", "preprocess_resolution": 40, "mcts_iterations": 50, "mcts_nodes": 10, "resolution": 1000,
}  # fmt: skip


def decompose(path: Path, concavity: float = CONCAVITY, folder: Path | None = None) -> list[Path]:
    """Writes the convex parts of a mesh, as ``<name>_part<i>.obj``.

    Args:
        path: the mesh file.
        concavity: largest deviation of a part from its convex hull, relative to the size of the mesh.
        folder: of the parts; by default that of the mesh.

    Returns:
        Paths of the parts.

    Raises:
        InputError: INVALID_SCENE; the mesh cannot be read or decomposed.
    """
    mesh = read_mesh(path)
    coacd.set_log_level("error")
    source = coacd.Mesh(np.asarray(mesh.vertices, float), np.asarray(mesh.faces))
    hulls = coacd.run_coacd(source, threshold=concavity, seed=SEED, **(COARSE if len(mesh.faces) > FINE else {}))
    if not hulls:
        raise InputError(f"mesh '{path}' cannot be split into convex parts; is it closed?", Code.INVALID_SCENE)
    parts = []
    for i, (vertices, faces) in enumerate(hulls):
        part = (folder or path.parent) / f"{path.stem}_part{i}.obj"
        trimesh.Trimesh(vertices, faces).export(part)
        parts.append(part)
    return parts


def main() -> int:
    """The command line; returns exit code 0, or 2 for invalid input."""
    parser = argparse.ArgumentParser(description="Splits a concave mesh into convex parts.")
    parser.add_argument("mesh", type=Path)
    parser.add_argument("--concavity", type=float, default=CONCAVITY, help=f"0.01 (fine) to 1; default {CONCAVITY}")
    arguments = parser.parse_args()
    if not MIN_CONCAVITY <= arguments.concavity <= 1.0:
        parser.error(f"--concavity {arguments.concavity}: must be between {MIN_CONCAVITY} and 1")
    keep_for_results()
    return run_reported(lambda: _print_parts(arguments.mesh, arguments.concavity), "decompose")


def _print_parts(mesh: Path, concavity: float) -> int:
    parts = decompose(mesh, concavity)
    print("parts:")
    for part in parts:
        print(f"  - {{shape: mesh, mesh: {part.name}}}")
    return YES


if __name__ == "__main__":
    sys.exit(main())
