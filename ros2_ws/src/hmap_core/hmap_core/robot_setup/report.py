"""Report on a robot: findings, joints, links, reach and gripper."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hmap_core.exceptions import InputError
from hmap_core.kinematics.arm import Arm, load_arm
from hmap_core.robot_description import Finding, Joint, RobotDescription, Severity, load_robot_description
from hmap_core.robot_description.inertia import FRAME_MASS
from hmap_core.robot_setup.guess import guess_robot
from hmap_core.robot_setup.robot_text import draft_model, with_loadable_gripper
from hmap_core.robot_setup.self_distance import SelfDistance
from hmap_core.scenes import resources
from hmap_core.scenes.document import read
from hmap_core.scenes.robots import list_robots, load_robot_model, robot_findings
from hmap_core.types import RobotModel

ROBOT_FILES = (".yaml", ".yml")
NO_PAIRS = "run `hmap robot new`, or `python -m hmap_core.simulation.collision_pairs`, and list the pairs"


@dataclass(frozen=True)
class JointRow:
    """A joint that moves; limits are infinite, and effort is None, where the URDF has none.

    Attributes:
        name, kind: as in the URDF.
        role: ``arm``, ``gripper``, ``mimics NAME``, or empty for a joint that stays at 0.
        lower, upper: rad or m; the robot file's for the arm.
        velocity: per s; the robot file's for the arm.
        effort: N m or N.
    """

    name: str
    kind: str
    role: str
    lower: float
    upper: float
    velocity: float
    effort: float | None


@dataclass(frozen=True)
class LinkRow:
    """A link: its mass in kg, None for a mere frame, and its collision shapes by kind."""

    name: str
    mass: float | None
    shapes: dict[str, int]


@dataclass(frozen=True)
class RobotReport:
    """What is known about a robot.

    Attributes:
        file: the robot file or URDF.
        findings: of the URDF and of the robot file.
        joints, links: of the URDF; empty if it cannot be read.
        model: the robot model; of a URDF, its guess without ignored collisions. None if there are errors.
        reach: m, largest distance of the end-effector frame from the first joint, a bound; None without model.
    """

    file: Path
    findings: tuple[Finding, ...]
    joints: tuple[JointRow, ...] = ()
    links: tuple[LinkRow, ...] = ()
    model: RobotModel | None = None
    reach: float | None = None

    @property
    def usable(self) -> bool:
        """Whether there is no error."""
        return all(finding.severity is not Severity.ERROR for finding in self.findings)

    def to_dict(self) -> dict[str, Any]:
        """The report as plain data for JSON; infinite limits are None."""
        gripper = self.model.gripper if self.model else None
        return {
            "file": str(self.file),
            "usable": self.usable,
            "findings": [
                {"severity": str(f.severity), "file": str(f.file), "line": f.line, "element": f.element, "text": f.text,
                 "remedy": f.remedy} for f in self.findings
            ],
            "joints": [{key: _finite(value) for key, value in vars(row).items()} for row in self.joints],
            "links": [vars(row) for row in self.links],
            "mass": sum(row.mass or 0.0 for row in self.links),
            "reach": self.reach,
            "end_effector": self.model.end_effector_link if self.model else None,
            "payload": self.model.payload if self.model else None,
            "home": self.model.home.tolist() if self.model else None,
            "gripper": None if gripper is None else {
                "joints": list(gripper.joint_names),
                "finger_links": list(gripper.finger_links),
                "min_opening": gripper.min_opening,
                "max_opening": gripper.max_opening,
                "open_opening": gripper.open_opening,
                "force": gripper.force,
            },
        }  # fmt: skip


def report(robot: str | Path) -> RobotReport:
    """Reports on a robot file or a URDF.

    Args:
        robot: a name of :func:`~hmap_core.scenes.list_robots`, a robot file (``.yaml``), or a URDF or xacro file, for
            which arm and gripper are guessed.

    Returns:
        The report. What cannot be used is an error among its findings.

    Raises:
        InputError: there is no such robot or file.
    """
    file = _path(str(robot))
    if not file.is_file():
        raise InputError(f"{file}: no such file; a robot file (.yaml) or a URDF is needed")
    findings: list[Finding] = []
    is_urdf = file.suffix.lower() not in ROBOT_FILES
    urdf = file if is_urdf else _urdf_of(file, findings)
    if urdf is None:
        return RobotReport(file, tuple(findings))
    description = load_robot_description(urdf)
    found = list(description.findings)
    model = arm = None
    if not description.errors:
        try:
            model = draft_model(with_loadable_gripper(guess_robot(urdf))) if is_urdf else load_robot_model(str(file))
            arm = load_arm(model)
            if not is_urdf:
                found = [*robot_findings(str(file)), *_home_findings(file, arm)]
        except InputError as error:
            model = None
            found.append(_error(file, error))
    findings += found
    reach = _reach(arm) if model is not None and arm is not None else None
    return RobotReport(file, tuple(findings), _joints(description, model), _links(description), model, reach)


def _path(robot: str) -> Path:
    if Path(robot).suffix or Path(robot).is_file():
        return Path(robot).expanduser()
    if robot not in list_robots():
        load_robot_model(robot)  # says which robots there are
    return resources.package_path("hmap_scenes") / "robots" / f"{robot}.yaml"


def _urdf_of(file: Path, findings: list[Finding]) -> Path | None:
    """The URDF that a robot file names; None, with an error among the findings, if it names none."""
    try:
        uri = read(file).data.get("urdf")
        if not isinstance(uri, str):
            load_robot_model(str(file))  # says what is wrong
            return None
        return resources.resolve(uri, file.parent)
    except InputError as error:
        findings.append(_error(file, error))
        return None


def _error(file: Path, error: InputError) -> Finding:
    return Finding(Severity.ERROR, file, "", error.reason.removeprefix(f"{file}: "))


def _home_findings(file: Path, arm: Arm) -> list[Finding]:
    """A warning if links overlap at home that a task checks."""
    distance, pair = SelfDistance(arm).nearest(arm.model.home)
    if distance >= 0.0 or pair is None:
        return []
    problem = f"{' and '.join(pair)} overlap by {-1e3 * distance:.1f} mm; tasks that start there are refused"
    remedy = "change home" if arm.model.ignored_collisions else NO_PAIRS
    return [Finding(Severity.WARNING, file, "home", problem, remedy)]


def _reach(arm: Arm) -> float:
    tip = arm.T_tip_ee[:3, 3]
    return float(arm.span + np.linalg.norm(tip))


def _joints(description: RobotDescription, model: RobotModel | None) -> tuple[JointRow, ...]:
    moving = [joint for joint in description.joints.values() if joint.moves]
    return tuple(_joint(joint, model) for joint in moving)


def _joint(joint: Joint, model: RobotModel | None) -> JointRow:
    lower, upper, velocity, role = joint.lower, joint.upper, joint.velocity, ""
    if model is not None and joint.name in model.joint_names:
        k = model.joint_names.index(joint.name)
        lower, upper = map(float, model.position_limits[:, k])
        velocity, role = float(model.velocity_limits[k]), "arm"
    elif model is not None and model.gripper is not None and joint.name in model.gripper.joint_names:
        role = "gripper"
    elif joint.mimic is not None:
        role = f"mimics {joint.mimic[0]}"
    return JointRow(joint.name, joint.kind, role, lower, upper, velocity, joint.effort)


def _links(description: RobotDescription) -> tuple[LinkRow, ...]:
    return tuple(
        LinkRow(
            name,
            None if link.inertial.mass <= FRAME_MASS and not link.shapes else link.inertial.mass,
            dict(Counter(str(shape.kind) for shape in link.shapes)),
        )
        for name, link in description.links.items()
    )


def _finite(value: object) -> object:
    return None if isinstance(value, float) and not np.isfinite(value) else value
