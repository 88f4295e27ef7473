"""Splits a concave mesh into convex parts: ``python -m hmap_core.scenes.decompose cup.obj``.

The decomposition (CoACD: Wei et al. 2022) is run once, by hand, and not when a scene is loaded. The parts are files
that can be inspected and shared, and loading stays fast and reproducible. The command prints the ``parts`` entry for a
scene file.
"""

import argparse
import sys
from pathlib import Path

import coacd
import numpy as np
import trimesh

from hmap_core.command_line import YES, keep_for_results, run_reported
from hmap_core.mesh_files import read_mesh

CONCAVITY = 0.05  # largest deviation of a part from its hull, relative to the size of the mesh
MIN_CONCAVITY = 0.01
SEED = 0


def decompose(path: Path, concavity: float = CONCAVITY) -> list[Path]:
    """Writes the convex parts of a mesh next to it, as ``<name>_part<i>.obj``.

    Args:
        path: the mesh file.
        concavity: largest deviation of a part from its convex hull, relative to the size of the mesh.

    Returns:
        Paths of the parts.

    Raises:
        InputError: INVALID_SCENE; the mesh cannot be read.
    """
    mesh = read_mesh(path)
    coacd.set_log_level("error")
    source = coacd.Mesh(np.asarray(mesh.vertices, float), np.asarray(mesh.faces))
    hulls = coacd.run_coacd(source, threshold=concavity, seed=SEED)
    parts = []
    for i, (vertices, faces) in enumerate(hulls):
        part = path.with_name(f"{path.stem}_part{i}.obj")
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
