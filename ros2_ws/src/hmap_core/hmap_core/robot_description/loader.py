"""Loads robot descriptions."""

from collections.abc import Iterable, Sequence
from functools import lru_cache
from pathlib import Path

from hmap_core.robot_description.description import Link, RobotDescription
from hmap_core.robot_description.document import read_document
from hmap_core.robot_description.findings import Finding, listed
from hmap_core.robot_description.geometry import read_shape
from hmap_core.robot_description.inertia import read_inertial
from hmap_core.robot_description.joints import check_mimics, read_joint
from hmap_core.robot_description.node import Node
from hmap_core.robot_description.tree import Joint, loops
from hmap_core.robot_description.uris import find_file


def load_robot_description(file: Path | str, packages: Iterable[Path | str] = ()) -> RobotDescription:
    """Reads a URDF or xacro file.

    Args:
        file: the file.
        packages: folders of ROS packages, or folders that contain them, for ``package://``.

    Returns:
        The description, from a cache. It may have errors: see :meth:`RobotDescription.require_valid`.
    """
    path = Path(file)
    try:
        state = path.stat()
        version = state.st_mtime_ns, state.st_size
    except (OSError, ValueError):
        version = 0, 0
    return _load(path, tuple(Path(folder) for folder in packages), version)


@lru_cache(maxsize=32)
def _load(file: Path, packages: tuple[Path, ...], _version: tuple[int, int]) -> RobotDescription:
    findings: list[Finding] = []
    element = read_document(file, findings)
    if element is None:
        return RobotDescription(file, findings=tuple(findings))
    robot = Node(element, "<robot>", file, findings)
    links = _links(robot, file, packages)
    joints, joint_nodes = _joints(robot)
    joined = _joined(joints, joint_nodes, links)
    whole = len(joined) == len(robot.children("joint"))
    root = _root(robot, links, joined, joint_nodes, whole)
    check_mimics(joint_nodes, list(joints.values()))
    findings.sort(key=lambda finding: finding.line)
    return RobotDescription(file, element.get("name", ""), root, links, joints, tuple(findings), packages, element)


def _links(robot: Node, file: Path, packages: Sequence[Path]) -> dict[str, Link]:
    links: dict[str, Link] = {}
    moved = {child.element.get("link") for joint in robot.children("joint") for child in joint.children("child")}
    for node in robot.children("link"):
        name = node.text("name")
        if name is None:
            continue
        node = node.at(f"link '{name}'")
        if name in links:
            node.error("a link before has the same name", "rename one of them")
            continue
        collisions = node.children("collision")
        numbered = len(collisions) > 1
        found = [
            read_shape(
                collision.at(f"{node.where}, collision {i + 1}") if numbered else collision,
                lambda mesh: find_file(mesh, file, packages),
            )
            for i, collision in enumerate(collisions)
        ]
        shapes = tuple(shape for shape in found if shape is not None)
        links[name] = Link(name, shapes, read_inertial(node, shapes, quiet=name not in moved))
    if not links:
        robot.error("has no <link>")
    return links


def _joints(robot: Node) -> tuple[dict[str, Joint], dict[str, Node]]:
    joints: dict[str, Joint] = {}
    nodes: dict[str, Node] = {}
    for node in robot.children("joint"):
        joint = read_joint(node)
        if joint is None:
            continue
        node = node.at(f"joint '{joint.name}'")
        if joint.name in joints:
            node.error("a joint before has the same name", "rename one of them")
            continue
        joints[joint.name], nodes[joint.name] = joint, node
    return joints, nodes


def _joined(joints: dict[str, Joint], nodes: dict[str, Node], links: dict[str, Link]) -> list[Joint]:
    """The joints that connect two links; the first of those with the same child."""
    joined: dict[str, Joint] = {}
    for joint in joints.values():
        missing = [link for link in (joint.parent, joint.child) if link not in links]
        for link in dict.fromkeys(missing):
            nodes[joint.name].error(f"names the link '{link}', which is missing", f"there are: {listed(links)}")
        if missing:
            continue
        other = joined.setdefault(joint.child, joint)
        if other is not joint:
            problem = f"its child link '{joint.child}' is also the child of joint '{other.name}'"
            nodes[joint.name].error(problem, "a URDF is a tree; remove one of the joints")
    return list(joined.values())


def _root(robot: Node, links: dict[str, Link], joints: Sequence[Joint], nodes: dict[str, Node], whole: bool) -> str:
    """Name of the base link; empty, with a recorded error, if the joints form no single tree.

    Links that only a joint with errors would connect are no further error: ``whole`` says that there is none.
    """
    rings = loops(joints)
    for ring in rings:
        names = listed([f"'{joint.name}'" for joint in ring])
        nodes[ring[0].name].error(f"the joints {names} form a loop", "a URDF is a tree; remove one of the joints")
    children = {joint.child for joint in joints}
    roots = [name for name in links if name not in children]
    if len(roots) > 1 and whole:
        names = listed([f"'{name}'" for name in roots])
        problem = f"has {len(roots)} links that are the child of no joint: {names}"
        robot.error(problem, "exactly one, the base, is allowed; connect the others by joints")
    return roots[0] if len(roots) == 1 and not rings else ""
