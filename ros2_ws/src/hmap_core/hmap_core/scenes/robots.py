"""Robot files: the properties of an arm that a URDF lacks."""

from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from hmap_core.exceptions import Code, InputError
from hmap_core.scenes import resources
from hmap_core.scenes.document import Document, Location, read
from hmap_core.scenes.fields import did_you_mean
from hmap_core.scenes.grippers import build_gripper
from hmap_core.scenes.parameters import draw
from hmap_core.scenes.schema import RobotFile
from hmap_core.scenes.validate import validate
from hmap_core.types import RobotModel


def list_robots() -> list[str]:
    """Names of the robot models that come with hmap, sorted."""
    return sorted(path.stem for path in (resources.package_path("hmap_scenes") / "robots").glob("*.yaml"))


def load_robot_model(name: str, base: Path | None = None) -> RobotModel:
    """Loads a robot model.

    Args:
        name: a name of :func:`list_robots`, or the path of a robot file.
        base: folder that such a path is relative to; None for the working directory.

    Returns:
        The robot model.

    Raises:
        InputError: UNKNOWN_ROBOT, INVALID_SCENE or INVALID_POSE; the reason names the file, line, key and value.
    """
    if name.endswith((".yaml", ".yml")):
        path = (base or Path()) / Path(name).expanduser()
    else:
        path = resources.package_path("hmap_scenes") / "robots" / f"{name}.yaml"
        if name not in list_robots():
            suggestion = did_you_mean(name, list_robots())
            known = ", ".join(list_robots())
            raise InputError(
                f"unknown robot model {name!r}.{suggestion} Known: {known}, or the path of a .yaml file",
                Code.UNKNOWN_ROBOT,
            )
    document = read(path)
    return _build(document, validate(RobotFile, document, draw(document, seed=0)))


def _build(document: Document, entry: RobotFile) -> RobotModel:
    try:
        urdf = resources.resolve(entry.urdf, document.path.parent)
    except InputError as error:
        raise document.error(("urdf",), error.reason) from error
    root = _root(document, urdf)
    _check_names(document, entry, urdf, root)
    lower, upper = entry.position_limits.lower, entry.position_limits.upper
    arrays = {
        ("home",): entry.home,
        ("position_limits", "lower"): lower,
        ("position_limits", "upper"): upper,
        ("velocity_limits",): entry.velocity_limits,
        ("acceleration_limits",): entry.acceleration_limits,
    }
    for location, values in arrays.items():
        if len(values) != len(entry.joints):
            raise document.error(location, f"has {len(values)} numbers; joints has {len(entry.joints)}")
    for i, name in enumerate(entry.joints):
        if lower[i] >= upper[i]:
            raise document.error(("position_limits", "lower", i), f"of {name} must be below upper, {upper[i]:g}")
        if not lower[i] <= entry.home[i] <= upper[i]:
            raise document.error(("home", i), f"of {name} must be within its limits [{lower[i]:g}, {upper[i]:g}]")
    return RobotModel(
        name=document.path.stem,
        urdf=urdf,
        urdf_uri=entry.urdf if "://" in entry.urdf else resources.portable(urdf.resolve()),
        joint_names=tuple(entry.joints),
        end_effector_link=entry.end_effector.link,
        T_link_ee=entry.end_effector.pose.vector(),
        home=np.array(entry.home),
        position_limits=np.array([lower, upper]),
        velocity_limits=np.array(entry.velocity_limits),
        acceleration_limits=np.array(entry.acceleration_limits),
        gripper=build_gripper(document, entry, urdf, root) if entry.gripper else None,
        ignored_collisions=tuple((first, second) for first, second in entry.ignored_collisions),
        simulation=entry.simulation,
    )


def _check_names(document: Document, entry: RobotFile, urdf: Path, root: Element) -> None:
    """Checks that the URDF has every joint and link that the robot file names."""
    joints = [joint.get("name", "") for joint in root.findall("joint") if joint.get("type") != "fixed"]
    links = [link.get("name", "") for link in root.findall("link")]
    named: list[tuple[Location, str, list[str]]] = [
        *((("joints", i), name, joints) for i, name in enumerate(entry.joints)),
        (("end_effector", "link"), entry.end_effector.link, links),
        *((("ignored_collisions", i, k), n, links) for i, pair in enumerate(entry.ignored_collisions)
          for k, n in enumerate(pair)),
    ]  # fmt: skip
    if entry.gripper:
        named += [(("gripper", "joints", i), name, joints) for i, name in enumerate(entry.gripper.joints)]
        named += [(("gripper", "finger_links", i), name, links) for i, name in enumerate(entry.gripper.finger_links)]
    for location, name, known in named:
        if name not in known:
            raise document.error(
                location, f"is not in {urdf.name}.{did_you_mean(name, known)} It has: {', '.join(known)}"
            )
    for i, name in enumerate(entry.joints):
        if name in entry.joints[:i]:
            raise document.error(("joints", i), "is named twice")


def _root(document: Document, urdf: Path) -> Element:
    """The root element of a URDF."""
    try:
        return ElementTree.parse(urdf).getroot()
    except (ElementTree.ParseError, ValueError) as error:
        raise document.error(("urdf",), f"is not a URDF: {error}") from error
