"""Robot files: the properties of an arm that a URDF lacks."""

from pathlib import Path

import numpy as np

from hmap_core.exceptions import Code, InputError
from hmap_core.robot_description import Finding, RobotDescription, Severity, load_robot_description
from hmap_core.scenes import resources
from hmap_core.scenes.document import Document, Location, key_text, read
from hmap_core.scenes.fields import did_you_mean
from hmap_core.scenes.grippers import build_gripper
from hmap_core.scenes.parameters import draw
from hmap_core.scenes.robot_rules import LIMIT_TOLERANCE, ArmEntry, allowed_limits, problems, unnamed_joints
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
        The robot model. Its limits are those that both the robot file and the URDF allow.

    Raises:
        InputError: UNKNOWN_ROBOT, INVALID_SCENE or INVALID_POSE; the reason names the file, line, key and value.
    """
    document, entry = _read(name, base)
    return _build(document, entry, _description(document, entry))


def robot_findings(name: str, base: Path | None = None) -> tuple[Finding, ...]:
    """Everything that is assumed in loading a robot, by its URDF, its robot file, or both.

    Args:
        name: see :func:`load_robot_model`.
        base: see :func:`load_robot_model`.

    Returns:
        The warnings.

    Raises:
        InputError: as :func:`load_robot_model`.
    """
    document, entry = _read(name, base)
    description = _description(document, entry)
    _build(document, entry, description)
    arm = _arm(entry)
    found = [
        Finding(
            problem.severity, document.path, key_text(problem.place), problem.text, line=document.line(problem.place)
        )
        for problem in problems(description, arm)
    ]
    return (*description.findings, *unnamed_joints(description, arm), *found)


def _read(name: str, base: Path | None) -> tuple[Document, RobotFile]:
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
    return document, validate(RobotFile, document, draw(document, seed=0))


def _description(document: Document, entry: RobotFile) -> RobotDescription:
    try:
        return load_robot_description(resources.resolve(entry.urdf, document.path.parent)).require_valid()
    except InputError as error:
        raise document.error(("urdf",), error.reason) from error


def _arm(entry: RobotFile) -> ArmEntry:
    return ArmEntry(
        tuple(entry.joints),
        entry.end_effector.link,
        np.array([entry.position_limits.lower, entry.position_limits.upper]),
        np.array(entry.velocity_limits),
        tuple(entry.gripper.joints) if entry.gripper else (),
    )


def _build(document: Document, entry: RobotFile, description: RobotDescription) -> RobotModel:
    _check_names(document, entry, description)
    arm = _checked_arm(document, entry, description)
    position_limits, velocity_limits = allowed_limits(description, arm)
    for i, (lower, upper) in enumerate(position_limits.T):
        if not lower - LIMIT_TOLERANCE <= entry.home[i] <= upper + LIMIT_TOLERANCE:
            raise document.error(("home", i), f"of {arm.joints[i]} must be within its limits [{lower:g}, {upper:g}]")
    return RobotModel(
        name=document.path.stem,
        urdf=description.file,
        urdf_uri=entry.urdf if "://" in entry.urdf else resources.portable(description.file.resolve()),
        joint_names=arm.joints,
        end_effector_link=arm.end_effector_link,
        T_link_ee=entry.end_effector.pose.vector(),
        home=np.clip(entry.home, *position_limits),
        position_limits=position_limits,
        velocity_limits=velocity_limits,
        acceleration_limits=np.array(entry.acceleration_limits),
        gripper=build_gripper(document, entry, description) if entry.gripper else None,
        ignored_collisions=tuple((first, second) for first, second in entry.ignored_collisions),
        simulation=entry.simulation,
        payload=entry.payload,
    )


def _checked_arm(document: Document, entry: RobotFile, description: RobotDescription) -> ArmEntry:
    """What a robot file says of the arm, after all checks that need no home and no gripper."""
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
    arm = _arm(entry)
    for problem in problems(description, arm):
        if problem.severity is Severity.ERROR:
            raise document.error(problem.place, problem.text)
    return arm


def _check_names(document: Document, entry: RobotFile, description: RobotDescription) -> None:
    """Checks that the URDF has every joint and link that the robot file names, and that the joints can move."""
    joints = [joint.name for joint in description.joints.values() if joint.moves]
    links = list(description.links)
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
            still = known is joints and name in description.joints
            missing = f"is {description.joints[name].kind} and not a moving joint" if still else "is not"
            raise document.error(
                location, f"{missing} in {description.file.name}.{did_you_mean(name, known)} It has: {', '.join(known)}"
            )
    gripper = entry.gripper.joints if entry.gripper else []
    for location, names in ((("joints",), entry.joints), (("gripper", "joints"), gripper)):
        for i, name in enumerate(names):
            if name in names[:i]:
                raise document.error((*location, i), "is named twice")
