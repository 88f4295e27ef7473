"""What a robot description says: links, joints, and the findings of its reading."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from xml.etree.ElementTree import Element

from hmap_core.exceptions import Code, InputError
from hmap_core.robot_description.findings import Finding, Severity
from hmap_core.robot_description.inertia import Inertial
from hmap_core.robot_description.tree import Joint, JointTree
from hmap_core.types import Shape


@dataclass(frozen=True)
class Link:
    """A link with its collision shapes, in the link frame, and its mass properties, which may be assumed."""

    name: str
    shapes: tuple[Shape, ...]
    inertial: Inertial


@dataclass(frozen=True, eq=False)
class RobotDescription:
    """A robot description.

    A description with errors has what could be read.

    Attributes:
        file: the URDF or xacro file.
        name: of the robot.
        root: name of the base link; empty if there is not exactly one.
        links, joints: by name, in the order of the file.
        findings: errors and warnings, in the order of the file.
        packages: folders in which ``package://`` is looked for, beside the usual ones.
        element: the element ``<robot>``; None if the file is no URDF. Must not be modified.
    """

    file: Path
    name: str = ""
    root: str = ""
    links: dict[str, Link] = field(default_factory=dict)
    joints: dict[str, Joint] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    packages: tuple[Path, ...] = ()
    element: Element | None = None

    @cached_property
    def tree(self) -> JointTree:
        """The joints as a tree. The description must have no errors."""
        return JointTree({joint.child: joint for joint in self.joints.values()})

    @property
    def errors(self) -> list[Finding]:
        """The findings for which the description is refused."""
        return [finding for finding in self.findings if finding.severity is Severity.ERROR]

    @property
    def warnings(self) -> list[Finding]:
        """The findings that say what was assumed."""
        return [finding for finding in self.findings if finding.severity is Severity.WARNING]

    def require_valid(self) -> "RobotDescription":
        """The description itself.

        Raises:
            InputError: INVALID_SCENE; it has errors. The reason is the first one.
        """
        if not self.errors:
            return self
        more = f" (and {len(self.errors) - 1} more errors)" if len(self.errors) > 1 else ""
        raise InputError(f"{self.errors[0]}{more}", Code.INVALID_SCENE)
