"""Robot descriptions: URDF and xacro files, read once and by one set of rules. See ``docs/robots.md``.

:func:`load_robot_description` is the only reader of URDF files for the planner and the simulation. The judge
(:mod:`hmap_core.validation`) has a reader of its own, on purpose; a test compares both.

The XML is read with the standard library (expat) and rules of our own, and not with ``yourdfpy``, ``urdf_parser_py``
or ``pinocchio``. The reason is what these parsers accept silently. Of 22 faulty descriptions (no axis direction, NaN
limits or radii, inverted limits, a joint to a link that is missing, a loop of joints, two roots, a name used twice,
``${...}`` in a name, a mesh scale of two numbers, ...), yourdfpy 0.0.60 and urdf_parser_py 0.0.4 each accept 14.
Where they refuse, the error names neither file nor element ("could not convert string to float: '0,5'"). Both refuse
``<capsule>``, which PyBullet and Drake read. The rules have to inspect the raw elements all the same, so a parser in
between would be a second reading. yourdfpy also takes 0.6 s to import, and requires ``trimesh[easy]`` with about 20
more libraries.
"""

from hmap_core.robot_description.cleaned import cleaned_urdf
from hmap_core.robot_description.description import Link, RobotDescription
from hmap_core.robot_description.findings import Finding, Severity
from hmap_core.robot_description.loader import load_robot_description
from hmap_core.robot_description.tree import MOVING, Joint, JointTree

__all__ = [
    "MOVING",
    "Finding",
    "Joint",
    "JointTree",
    "Link",
    "RobotDescription",
    "Severity",
    "cleaned_urdf",
    "load_robot_description",
]
