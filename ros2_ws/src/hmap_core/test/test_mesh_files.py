"""Meshes of all formats mean the same, and what has no volume is refused."""

import json
import shutil
import subprocess
import sys

import mesh_fixtures as meshes
import numpy as np
import pytest
import trimesh

from hmap_core.collision.convex import hull_vertices
from hmap_core.exceptions import Code, InputError
from hmap_core.mesh_files import MAX_HULL_VERTICES, read_hull, read_mesh
from hmap_core.scenes.meshes import check_convex
from hmap_core.types import Shape, ShapeKind
from hmap_core.validation.files import mesh_points

CORNERS = sorted([x, y, z] for x in (0.0, 0.1) for y in (0.0, 0.2) for z in (0.0, 0.3))


def corners(path) -> list[list[float]]:
    return sorted(np.round(read_hull(path).vertices, 6).tolist())


@pytest.mark.parametrize("kind", meshes.FORMATS)
def test_all_formats_are_read(tmp_path, kind):
    path = meshes.save(meshes.box(), tmp_path / f"box.{kind.partition('_')[0].upper()}", kind)
    hull = read_hull(path)
    assert corners(path) == CORNERS and hull.notes == () and hull.fill == pytest.approx(1.0)


@pytest.mark.parametrize("suffix", ["obj", "ply"])
def test_vertices_that_no_face_uses_do_not_count(tmp_path, suffix):
    path = meshes.with_unused_vertex(tmp_path / f"box.{suffix}")
    assert corners(path) == CORNERS and len(read_mesh(path).vertices) == 8


def test_collada_has_a_unit(tmp_path):
    path = meshes.in_millimetres(tmp_path / "box.dae")
    assert corners(path) == CORNERS and read_hull(path).notes == ()
    path.write_text(path.read_text().replace("Z_UP", "Y_UP"))
    assert corners(path) == CORNERS and "<up_axis>" in read_hull(path).notes[0]
    path.write_text(path.read_text().replace('meter="0.001"', 'meter="0"'))
    with pytest.raises(InputError, match='box.dae\' has <unit meter="0">; a number above 0 is needed'):
        read_hull(path)


def test_nodes_of_a_scene_are_placed(tmp_path):
    vertices = read_hull(meshes.scene_of_boxes(tmp_path / "boxes.glb")).vertices
    np.testing.assert_allclose([vertices.min(0), vertices.max(0)], [[0, 0, 0], [1.1, 0.2, 0.3]], atol=1e-6)


def test_a_mesh_that_is_inside_out_is_turned_with_a_note(tmp_path, caplog):
    mesh = meshes.box()
    mesh.invert()
    path = meshes.save(mesh, tmp_path / "box.stl")
    hull = read_hull(path)
    assert hull.fill == pytest.approx(1.0) and hull.notes == ("is inside out: its faces are turned",)
    assert read_mesh(path).volume > 0.0
    check_convex(path, accept_hull=False)
    check_convex(path, accept_hull=False)
    assert caplog.messages == [f"mesh '{path}' is inside out: its faces are turned"]


def test_faces_that_are_not_oriented_alike_count_as_concave(tmp_path):
    mesh = meshes.box()
    mesh.faces[0] = mesh.faces[0][::-1]
    path = meshes.save(mesh, tmp_path / "box.obj")
    assert read_hull(path).fill == 0.0 and corners(path) == CORNERS


FLAT = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\nf 1 3 2\nf 2 3 4\n"
BAD = {
    "box.stl": ("", "is not a mesh"),
    "box.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n", "has 0 triangles; at least 4 are needed"),
    "flat.obj": (FLAT, "is flat: its points span no volume"),
    "point.obj": ("v 1 1 1\n" * 4 + "f 1 2 3\n" * 4, "is"),
    "nan.obj": (FLAT.replace("1 1 0", "1 1 nan"), "is not a mesh"),
    "dust.obj": (
        "v 0 0 0\nv 1e-10 0 0\nv 0 1e-10 0\nv 0 0 1e-10\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n",
        "is",
    ),
    "huge.obj": (FLAT.replace("1 1 0", "1 1 1e9"), "a coordinate is larger than 1e+06 m"),
    "box.glb": ("glTF", "is not a mesh"),
    "box.dae": ("<COLLADA>", "is not a mesh"),
    "box.ply": ("ply", "is not a mesh"),
    "box.step": ("ISO-10303-21;", "is of an unknown format; allowed: .stl, .obj, .dae"),
    "box": ("", "is of an unknown format"),
}


OTHER_CONTENT = {
    "pointer": (b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 9\n", "fetch .* by 'git lfs pull'"),
    "page": (b"<!DOCTYPE html><html>404</html>", "is a page of the web; download the file itself"),
    "archive": (b"PK\x03\x04...", "is a ZIP archive; unpack it"),
    "compressed": (b"\x1f\x8b\x08...", "is compressed; unpack it"),
}


@pytest.mark.parametrize("suffix", ["stl", "obj", "dae"])
@pytest.mark.parametrize("kind", OTHER_CONTENT)
def test_files_that_are_something_else_are_told_with_the_remedy(tmp_path, kind, suffix):
    content, says = OTHER_CONTENT[kind]
    path = tmp_path / f"box.{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=says):
        read_hull(path)


@pytest.mark.parametrize("header", [b"made by hand", b"solid box"])
def test_binary_stl_files_may_be_longer_than_their_header_says_and_not_shorter(tmp_path, header):
    path = meshes.save(meshes.box(), tmp_path / "box.stl")
    data = header.ljust(80) + path.read_bytes()[80:]
    path.write_bytes(data + 37 * b"\0")
    np.testing.assert_allclose(np.ptp(read_hull(path).vertices, axis=0), (0.1, 0.2, 0.3), atol=1e-6)
    np.testing.assert_allclose(np.ptp(mesh_points(path), axis=0), (0.1, 0.2, 0.3), atol=1e-6)
    path.write_bytes(data[:-60])
    with pytest.raises(InputError, match="its header says 12 triangles, which are 684 bytes, and it has 624"):
        read_hull(path)


def test_a_binary_stl_file_with_coordinates_that_are_no_numbers_is_refused(tmp_path):
    path = meshes.save(meshes.box(), tmp_path / "box.stl")
    triangles = np.frombuffer(path.read_bytes()[84:], [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("", "<u2")])
    for bad in (1, len(triangles) - 2):
        damaged = triangles.copy()
        damaged["corners"][:bad, 0, 0] = np.nan
        path.write_bytes(path.read_bytes()[:84] + damaged.tobytes())
        with pytest.raises(InputError, match="a coordinate is not finite; export it again"):
            read_hull(path)


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_mesh_is_refused(tmp_path, name):
    text, says = BAD[name]
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError) as error:
        read_hull(tmp_path / name)
    assert error.value.code == Code.INVALID_SCENE
    assert error.value.reason.startswith(f"mesh '{tmp_path / name}' ") and says in error.value.reason


TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nf 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n"
DAMAGED_LINES = {
    "no index": ("f 2 3 4", "f 2 3 /4", "line 9 is 'f 2 3 /4'; a corner of a face is v, v/vt, v//vn or v/vt/vn"),
    "two numbers": ("f 2 3 4", "f 2 3 4-1", "line 9 is 'f 2 3 4-1'; a corner of a face"),
    "a word": ("f 2 3 4", "f 2 3 v", "line 9 is 'f 2 3 v'; a corner of a face"),
    "zero": ("f 2 3 4", "f 2 3 0", "whole numbers other than 0"),
    "four parts": ("f 2 3 4", "f 2 3 4/1/1/1", "line 9 is 'f 2 3 4/1/1/1'; a corner of a face"),
    "no vertex": ("f 2 3 4", "f 2 3 5", "line 9 is 'f 2 3 5'; the file has vertices 1 to 4"),
    "before the first": ("f 2 3 4", "f 2 3 -5", "line 9 is 'f 2 3 -5'; the file has vertices 1 to 4"),
    "an edge": ("f 2 3 4", "f 2 3", "line 9 is 'f 2 3'; a face has 3 vertices or more"),
    "two coordinates": ("v 0 1 0", "v 0 1", "line 3 is 'v 0 1'; a vertex has 3 coordinates, and only numbers"),
    "comma": ("v 0 1 0", "v 0 0,5 0", "line 3 is 'v 0 0,5 0'; a vertex has 3 coordinates, and only numbers"),
    "not finite": ("v 0 1 0", "v 0 inf 0", "line 3 is 'v 0 inf 0'; a coordinate is not finite"),
    "Python's numbers": ("v 0 1 0", "v 0 1_0 0", "line 3 is 'v 0 1_0 0'; a vertex has 3 coordinates"),
    "texture": ("vt 0 0", "vt 0 x", "line 5 is 'vt 0 x'; 'vt' is followed by numbers only"),
}


@pytest.mark.parametrize("kind", DAMAGED_LINES)
def test_a_damaged_line_of_an_obj_file_is_named(tmp_path, kind):
    before, after, says = DAMAGED_LINES[kind]
    path = tmp_path / "body.obj"
    path.write_text(TETRAHEDRON)
    read_hull(path)
    path.write_text(TETRAHEDRON.replace(before, after))
    with pytest.raises(InputError) as error:
        read_hull(path)
    assert error.value.reason.startswith(f"mesh '{path}' is not a mesh: ") and says in error.value.reason
    assert error.value.reason.endswith("; correct it, or export the mesh again")


WRITTEN = {
    "tabs": TETRAHEDRON.replace(" ", "\t"),
    "comments": TETRAHEDRON.replace("f 2 3 4", "f 2 3 4 # the last").replace("v 0 1 0", "v 0 1 0 # up"),
    "windows": TETRAHEDRON.replace("\n", "\r\n"),
    "continued": TETRAHEDRON.replace("f 2 3 4\n", "f 2 3\\\n4\\\n"),
    "comment that seems to go on": TETRAHEDRON.replace("v 0 1 0", "v 0 1 0 # up \\"),
    "from behind": "v 9 9 9\n" + TETRAHEDRON.replace("f 2 3 4", "f -3 -2 -1").replace("f 1 ", "f -4 ")
    .replace("2 3\n", "-3 -2\n").replace("2 4", "-3 -1").replace("3 4", "-2 -1") + "v 7 7 7\n",
    "some with texture": TETRAHEDRON.replace("f 2 3 4", "f 2/1 3/1 4/1"),
    "unused and not finite": TETRAHEDRON + "v nan nan nan\n",
}  # fmt: skip


@pytest.mark.parametrize("kind", WRITTEN)
def test_ways_to_write_an_obj_file_mean_the_same_to_both_readers(tmp_path, kind):
    path = tmp_path / "body.obj"
    path.write_bytes(WRITTEN[kind].encode())
    wanted = sorted([[0, 0, 0], [0, 0, 1], [0, 1, 0], [1, 0, 0]])
    assert corners(path) == wanted and sorted(mesh_points(path).tolist()) == wanted


def test_faces_of_many_corners_are_fans(tmp_path):
    """Triangles with textures beside a hexagon have six numbers in each line."""
    ring = [(np.cos(a), np.sin(a)) for a in np.arange(6) * np.pi / 3]
    text = "".join(f"v {x} {y} 0\n" for x, y in ring) + "v 0 0 1\nvt 0 0\nf 6 5 4 3 2 1\n"
    text += "".join(f"f {i + 1}/1 {(i + 1) % 6 + 1}/1 7/1\n" for i in range(6))
    path = tmp_path / "cone.obj"
    path.write_text(text)
    assert read_hull(path).fill == pytest.approx(1.0) and len(read_mesh(path).faces) == 10


def test_a_large_hull_is_simplified_from_outside(tmp_path):
    """The collision checks number vertices with 16 bits: 33,500 of them ended in a segmentation fault."""
    points = np.random.default_rng(0).normal(size=(33_500, 3))
    points *= np.array([0.05, 0.05, 0.2]) / np.linalg.norm(points, axis=1)[:, None]
    path = meshes.save(trimesh.PointCloud(points).convex_hull, tmp_path / "egg.stl")
    hull = read_hull(path)
    assert 1000 < len(hull.vertices) <= MAX_HULL_VERTICES and "is simplified from outside" in hull.notes[0]
    own = trimesh.PointCloud(hull.vertices).convex_hull
    normals, offsets = own.face_normals, np.einsum("ij,ij->i", own.face_normals, own.triangles[:, 0])
    beyond = max((chunk @ normals.T - offsets).max() for chunk in np.array_split(points, 50))
    assert beyond < 1e-6  # rounding in the file
    assert np.linalg.norm(hull.vertices / [0.05, 0.05, 0.2], axis=1).max() < 1.002
    vertices, radius = hull_vertices(Shape(ShapeKind.MESH, (1.0, 1.0, 2.0), mesh=path))
    assert len(vertices) == len(hull.vertices) and radius == 0.0


def test_large_hulls_do_not_end_the_process(tmp_path):
    """Distances of two bodies with hulls of more vertices than 16 bits can number."""
    points = np.random.default_rng(0).normal(size=(33_500, 3))
    points *= 0.05 / np.linalg.norm(points, axis=1)[:, None]
    path = meshes.save(trimesh.PointCloud(points).convex_hull, tmp_path / "ball.stl")
    code = (
        "import sys, json, numpy as np\n"
        "from pathlib import Path\n"
        "from hmap_core.collision.convex import convex_set, set_distance\n"
        "from hmap_core.types import Shape, ShapeKind\n"
        "ball = convex_set([Shape(ShapeKind.MESH, (1.0, 1.0, 1.0), mesh=Path(sys.argv[1]))])\n"
        "T = np.array([[x, 0, 0, 0, 0, 0, 1.0] for x in (0.0, 0.3)])\n"
        "print(json.dumps(set_distance(ball, T[0], ball, T[1])))\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == pytest.approx(0.2, abs=2e-4)


def test_a_mesh_file_that_changes_is_read_again(tmp_path):
    path = meshes.save(meshes.box(), tmp_path / "box.stl")
    assert corners(path) == CORNERS
    shutil.copy(meshes.save(trimesh.creation.box((1, 1, 1)), tmp_path / "other.stl"), path)
    assert len(corners(path)) == 8 and corners(path) != CORNERS
