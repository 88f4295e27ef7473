"""Small robot descriptions as text: a two-joint arm whose elements can be exchanged, and a robot file for it."""

from pathlib import Path

COLLISION = "<collision><geometry>{}</geometry></collision>"
BALL = COLLISION.format('<sphere radius="0.05"/>')
JOINT = (
    '<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
    '<origin xyz="0 0 0.3"/>{axis}{limit}{extra}</joint>'
)
AXIS = '<axis xyz="0 1 0"/>'
LIMIT = '<limit lower="-1.5" upper="1.5" velocity="2" effort="100"/>'
INERTIAL = '<inertial><mass value="{mass}"/><inertia ixx="{i}" ixy="0" ixz="0" iyy="{i}" iyz="0" izz="{i}"/></inertial>'

ROBOT_FILE = """schema: 1
urdf: {urdf}
joints: [{joints}]
end_effector: {{link: tip}}
home: [{home}]
position_limits: {{lower: [{lower}], upper: [{upper}]}}
velocity_limits: [{velocity}]
acceleration_limits: [{acceleration}]
"""


def link(name: str, inside: str = BALL, mass: float = 1.0) -> str:
    return f'<link name="{name}">{INERTIAL.format(mass=mass, i=0.01 * mass) if mass else ""}{inside}</link>'


def joint(name, parent, child, kind="revolute", axis=AXIS, limit=LIMIT, extra="") -> str:
    return JOINT.format(**locals())


def robot(*elements: str, links=("base", "upper", "tip"), joints=None) -> str:
    """A URDF: an arm with the joints ``shoulder`` and ``elbow``, and further elements."""
    arm = [joint("shoulder", "base", "upper"), joint("elbow", "upper", "tip")] if joints is None else joints
    inside = "\n".join([*(link(name) for name in links), *arm, *elements])
    return f'<robot name="arm">\n{inside}\n</robot>\n'


def write(folder: Path, text: str, name: str = "arm.urdf") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def write_robot(folder: Path, urdf: str, joints: str = "shoulder, elbow", **values) -> Path:
    """A robot file for a URDF's text; values may replace those of its joints."""
    write(folder, urdf)
    n = len(joints.split(","))
    numbers = {"home": 0, "lower": -1.5, "upper": 1.5, "velocity": 2, "acceleration": 5}
    filled = {key: ", ".join([str(values.get(key, value))] * n) for key, value in numbers.items()}
    return write(folder, ROBOT_FILE.format(urdf="arm.urdf", joints=joints, **filled), "arm.yaml")
