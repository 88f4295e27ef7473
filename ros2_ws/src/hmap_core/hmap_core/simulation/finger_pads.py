"""Flat pads on the inner faces of fingers that stay parallel, as spheres side by side.

Scanned finger meshes are uneven by a tenth of a millimetre, and for contacts of their convex hulls Bullet finds normals
that point along the face, which turn what is held and keep it from being let go. So it does, more seldom, for boxes on
boxes whose edges are nearly parallel. A sphere has one normal.
"""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import trimesh

from hmap_core.kinematics.urdf import Urdf, load_urdf
from hmap_core.robot_description.uris import find_file
from hmap_core.transforms import to_matrix
from hmap_core.types import RobotModel

FACE = 3e-4  # m; vertices of a finger this near to the foremost one are of its inner face
FULL_WIDTH = 0.9  # of the pads' half width; beyond, a vertex is at a side of the face
RADIUS = 0.003  # m of the spheres that make a pad; of smaller ones on long faces Bullet tilts normals by up to 25 deg
RIM = 0.001  # m that they reach beyond the pad's edges
SPREAD = (-1.0, 0.0, 1.0)  # where they are, as shares of how far from its middle they may be
HOLLOW = 1e-4  # m by which all but the corners lie behind these: they touch what is too small for the corners
RECESS = 2e-3  # m by which hulls are cut off behind the face of its pad: Bullet's hulls are 1 mm larger all round
TAPER = 0.05  # of linkages: of faces that are nearly parallel, Bullet may find that what is before one is behind it
LEAST = 1e-3  # m; smaller faces get no pad
FLAT = 1e-5  # m of thickness; what is left of a hull is no body
DIGITS = 12  # of a transform that are more than rounding
PARALLEL = 0.02  # rad; fingers that turn more between closed and open get no pads


def with_pads(model: RobotModel, folder: Path) -> Path:
    """A URDF with pads on its fingers, written to a folder; the model's own where its fingers do not stay parallel."""
    gripper = model.gripper
    if gripper is None:
        return model.urdf
    urdf = load_urdf(model.urdf)
    found = [(link, _pad(urdf, model, link)) for link in gripper.finger_links]
    pads = {link: pad for link, pad in found if pad is not None}
    if not pads or len(pads) < len(found):
        return model.urdf
    tree = ElementTree.parse(model.urdf)
    for mesh in tree.iter("mesh"):
        mesh.set("filename", str(find_file(mesh.get("filename", ""), model.urdf)[0]))
    for link in tree.getroot().findall("link"):
        name = link.get("name")
        if name is not None and name in pads:
            _replace(link, urdf.hulls[name], pads[name], folder, TAPER if gripper.openings else 0.0)
    path = folder / f"{model.name}.urdf"
    ElementTree.indent(tree)  # Bullet's reader breaks long lines, also within a number
    tree.write(path)
    return path


def _pad(urdf: Urdf, model: RobotModel, link: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None:
    """Width and height (2,), centre (3,) and axes (3, 3) of a finger's pad, and where (3,) it opens to, link frame."""
    gripper = model.require_gripper()
    if not urdf.hulls[link]:
        return None
    closed, opened = (_in_end_effector(urdf, model, link, at) for at in (gripper.min_opening, gripper.open_opening))
    if np.trace(closed[:3, :3].T @ opened[:3, :3]) < 1.0 + 2.0 * np.cos(PARALLEL):
        return None
    side = np.sign(opened[1, 3] - closed[1, 3])
    if side == 0.0:  # a jaw that stands still
        side = np.sign(np.concatenate([points for points, _ in urdf.hulls[link]]).mean(axis=0) @ closed[1, :3])
    opening, along = side * closed[1, :3], closed[2, :3]
    axes = np.stack([np.cross(opening, along), opening, along], axis=1)
    middle = -closed[:3, 3] @ closed[:3, :3] @ axes[:, 0]  # of the hand, across
    vertices = np.concatenate([points for points, _ in urdf.hulls[link]]) @ axes
    inner = vertices[vertices[:, 1] <= vertices[:, 1].min() + FACE]
    half, across = gripper.pad_half_width, inner[:, 0] - middle
    wide = np.abs(across) >= FULL_WIDTH * half
    sides, across = inner[wide], across[wide]
    if not len(sides) or np.ptp(sides[:, 2]) < LEAST:
        return None
    low = sides[:, 2].min()
    top = min(sides[across * end > 0.0, 2].max(initial=low) for end in (1.0, -1.0))
    if top - low < LEAST:
        return None
    centre = axes @ [middle, np.median(inner[:, 1]) + RADIUS, (low + top) / 2.0]
    return np.array([2.0 * half, top - low]), centre, axes, opening


def _in_end_effector(urdf: Urdf, model: RobotModel, link: str, opening: float) -> np.ndarray:
    """A link's frame (4, 4) in the end-effector's at an opening (m)."""
    gripper = model.require_gripper()
    values = dict(zip(gripper.joint_names, gripper.joints(opening), strict=True))
    T_root_ee = urdf.tree.pose(model.end_effector_link, values) @ to_matrix(model.T_link_ee)
    return np.round(np.linalg.inv(T_root_ee) @ urdf.tree.pose(link, values), DIGITS)


def _replace(link: ElementTree.Element, hulls, pad, folder: Path, taper: float) -> None:
    """Give a link its hulls, cut off behind its pad and written to ``folder``, and the pad as collision shapes.

    The cut recedes from the pad by ``taper`` metres for each from the finger's end. What is all before it is left out.
    """
    size, centre, axes, opening = pad
    for collision in link.findall("collision"):
        link.remove(collision)
    pieces = [vertices for vertices, _ in hulls]
    end = (np.concatenate(pieces) @ axes[:, 2]).max()
    for k, vertices in enumerate(pieces):
        behind = taper * (end - vertices @ axes[:, 2])  # the more, the farther towards the hand
        missing = (centre - vertices) @ opening - RADIUS + RECESS + behind
        cut = vertices + np.outer(np.maximum(missing, 0.0), opening)
        if np.linalg.matrix_rank(cut - cut.mean(axis=0), FLAT) < 3:
            continue
        file = folder / f"{link.get('name')}_{k}.obj"
        trimesh.PointCloud(cut).convex_hull.export(file)
        hull = ElementTree.SubElement(link, "collision")
        ElementTree.SubElement(ElementTree.SubElement(hull, "geometry"), "mesh", filename=str(file))
    reach = size / 2.0 + RIM - RADIUS
    across, along = reach[0] * axes[:, 0], reach[1] * axes[:, 2]
    for u in SPREAD:
        for v in SPREAD:
            sphere = ElementTree.SubElement(link, "collision")
            behind = (HOLLOW if u * v == 0.0 else 0.0) * opening
            ElementTree.SubElement(sphere, "origin", xyz=_text(centre + u * across + v * along + behind))
            ElementTree.SubElement(ElementTree.SubElement(sphere, "geometry"), "sphere", radius=f"{RADIUS:g}")


def _text(numbers: np.ndarray) -> str:
    return " ".join(f"{v:.9g}" for v in numbers)
