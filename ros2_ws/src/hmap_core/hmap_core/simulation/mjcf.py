"""Exports a scene as MJCF, the model format of MuJoCo.

What PyBullet reads of robots is read here, too: the cleaned URDF with pads on the fingers. Robots collide with fixed
bodies and with each other by groups; every contact of a movable body is an explicit pair, so that its friction is the
product of both coefficients, as in PyBullet.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from hmap_core import transforms
from hmap_core.exceptions import InputError
from hmap_core.mesh_files import read_hull
from hmap_core.robot_description import RobotDescription, load_robot_description
from hmap_core.scenes.robot_rules import simulated_urdf
from hmap_core.simulation.bodies import COLORS, ROLLING_FRICTION, ROUND, mass_properties
from hmap_core.simulation.finger_pads import with_pads
from hmap_core.simulation.settings import GRAVITY, RobotSettings
from hmap_core.types import Body, BodyKind, Robot, Scene, Shape, ShapeKind

TIME_STEP = 1.0 / 480.0  # s
SOLREF, SOLIMP = "0.005 1", "0.95 0.99 0.001"  # of contacts and couplings: time constant in s, damping ratio; impedance
LINK_FRICTION = 0.5  # of links that are no fingers
SPINNING_FRICTION = 1e-3  # m, of contacts
ARMATURE = 0.1  # kg m^2 or kg, inertia of an arm's motors
# stiffness and damping of the motors of an arm: N m/rad and N m s/rad, or N/m and N s/m
TURNING, SLIDING = (4000.0, 200.0), (2e5, 4e3)
# of a gripper, and the inertia of its motors
FINGER_TURNING, FINGER_SLIDING = (200.0, 5.0, 5e-3), (1e4, 200.0, 0.1)
UNLIMITED = 1e6  # N m or N, of motors whose force a command sets
MOST_ROBOTS = 29  # each has a bit of a collision group
FIXED_GROUP = 1 << 30
_NO_GROUP = {"contype": "0", "conaffinity": "0"}  # of movable bodies, whose contacts are explicit


@dataclass(frozen=True)
class _Geom:
    """What contact pairs need to know of a collision shape."""

    name: str
    owner: str  # of the body or robot
    movable: bool
    friction: float
    spinning: float
    rolls: bool


def scene_to_mjcf(scene: Scene, folder: Path) -> str:
    """Exports a scene.

    Bodies, joints and actuators of a robot are named ``ROBOT/NAME``; the gripper's actuators have no limit of force,
    which commands set.

    Args:
        scene: the scene, at its start.
        folder: where files that belong to it can be written meanwhile.

    Returns:
        The text of the MJCF file, which needs no others.

    Raises:
        InputError: a movable body has no mass, a robot cannot be read, or there are too many robots.
    """
    if len(scene.robots) > MOST_ROBOTS:
        raise InputError(f"{len(scene.robots)} robots cannot be exported as MJCF; {MOST_ROBOTS} are possible")
    root = Element("mujoco", model=scene.task)
    SubElement(root, "compiler", angle="radian", balanceinertia="true", boundmass="1e-5", boundinertia="1e-9")
    SubElement(
        root,
        "option",
        timestep=f"{TIME_STEP:.9g}",
        gravity=f"0 0 {-GRAVITY}",
        integrator="implicitfast",
        cone="elliptic",
        impratio="10",
        noslip_iterations="5",
    )
    parts = {name: SubElement(root, name) for name in ("asset", "worldbody", "contact", "equality", "actuator")}
    geoms: list[_Geom] = []
    for body in scene.bodies.values():
        geoms += _add_body(body, parts)
    for number, robot in enumerate(scene.robots.values()):
        geoms += _RobotWriter(robot, number, parts, folder).write()
    for a, b in itertools.combinations(geoms, 2):
        if a.owner != b.owner and (a.movable or b.movable):
            _add_pair(a, b, parts["contact"])
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode")


def _add_body(body: Body, parts: dict[str, Element]) -> list[_Geom]:
    fixed = body.kind is BodyKind.FIXED
    if not fixed and not body.mass > 0.0:
        raise InputError(f"body '{body.name}' is {body.kind} and has mass {body.mass} kg; it has to be positive")
    element = SubElement(parts["worldbody"], "body", {"name": body.name, **_place(body.pose)})
    if not fixed:
        SubElement(element, "freejoint", name=body.name)
        T, moments = mass_properties(body.shapes, body.mass)
        SubElement(element, "inertial", {"mass": _text([body.mass]), "diaginertia": _text(moments), **_place(T)})
    group = {"contype": str(FIXED_GROUP), "conaffinity": str(FIXED_GROUP - 1)} if fixed else _NO_GROUP
    color = _text(body.color or COLORS[body.kind])
    geoms = []
    for i, shape in enumerate(body.shapes):
        name = f"{body.name}#{i}"
        _add_geom(element, name, shape, parts["asset"], rgba=color, **group)
        geoms.append(_Geom(name, body.name, not fixed, body.friction, SPINNING_FRICTION, shape.kind in ROUND))
    return geoms


class _RobotWriter:
    """Writes a robot: links, joints, couplings and motors."""

    def __init__(self, robot: Robot, number: int, parts: dict[str, Element], folder: Path):
        self._robot, self._model, self._parts = robot, robot.model, parts
        self._settings = RobotSettings.of(robot.model.name, robot.model.simulation)
        self._bit = 1 << number
        urdf = with_pads(replace(robot.model, urdf=simulated_urdf(robot.model)), folder)
        self._urdf: RobotDescription = load_robot_description(urdf).require_valid()
        gripper = robot.model.gripper
        self._fingers = gripper.finger_links if gripper else ()
        self._driven = gripper.joint_names if gripper else ()

    def write(self) -> list[_Geom]:
        """Writes everything of the robot; its collision shapes."""
        geoms = list(self._links(self._urdf.root, self._parts["worldbody"], self._robot.base_pose))
        efforts: tuple[float | None, ...] = self._settings.joint_forces or tuple(
            self._urdf.joints[name].effort for name in self._model.joint_names
        )
        for name, effort in zip(self._model.joint_names, efforts, strict=True):
            self._motor(name, *(SLIDING if self._slides(name) else TURNING), effort)
        for name in self._driven:
            self._motor(name, *(FINGER_SLIDING if self._slides(name) else FINGER_TURNING)[:2], None)
        for name, driver, factor, offset in self._couplings():
            SubElement(
                self._parts["equality"],
                "joint",
                joint1=self._named(name),
                joint2=self._named(driver),
                polycoef=_text([offset, factor, 0.0, 0.0, 0.0]),
                solref=SOLREF,
                solimp=SOLIMP,
            )
        return geoms

    def _named(self, name: str) -> str:
        return f"{self._robot.name}/{name}"

    def _slides(self, joint: str) -> bool:
        return self._urdf.joints[joint].kind == "prismatic"

    def _links(self, link: str, parent: Element, T_parent_link: np.ndarray) -> Iterator[_Geom]:
        element = SubElement(parent, "body", {"name": self._named(link), "gravcomp": "1", **_place(T_parent_link)})
        joint = self._urdf.tree.by_child.get(link)
        if joint is not None and joint.moves:
            self._joint(element, joint.name)
        inertial = self._urdf.links[link].inertial
        moments, axes = np.linalg.eigh(inertial.inertia)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        T = transforms.multiply(
            inertial.T_link_com, transforms.pose((0.0, 0.0, 0.0), transforms.quaternions(axes[None])[0])
        )
        SubElement(element, "inertial", {"mass": _text([inertial.mass]), "diaginertia": _text(moments), **_place(T)})
        finger = link in self._fingers
        friction = self._settings.finger_friction if finger else LINK_FRICTION
        spinning = self._settings.finger_spinning_friction if finger else SPINNING_FRICTION
        group = {"contype": str(self._bit), "conaffinity": str(FIXED_GROUP - 1 - self._bit)}
        for i, shape in enumerate(self._urdf.links[link].shapes):
            name = f"{self._named(link)}#{i}"
            _add_geom(element, name, shape, self._parts["asset"], **group)
            yield _Geom(name, self._robot.name, False, friction, spinning, False)
        for below in self._urdf.joints.values():
            if below.parent == link:
                yield from self._links(below.child, element, below.T_parent_joint)

    def _joint(self, element: Element, name: str) -> None:
        joint = self._urdf.joints[name]
        in_arm, slides = name in self._model.joint_names, joint.kind == "prismatic"
        armature = ARMATURE if in_arm else (FINGER_SLIDING if slides else FINGER_TURNING)[2]
        limits = {}
        if np.isfinite(joint.lower) and np.isfinite(joint.upper) and joint.lower < joint.upper:
            limits = {"limited": "true", "range": _text([joint.lower, joint.upper])}
        values = {"name": self._named(name), "type": "slide" if slides else "hinge", "axis": _text(joint.axis)}
        SubElement(element, "joint", {**values, "armature": _text([armature]), **limits})

    def _motor(self, joint: str, stiffness: float, damping: float, effort: float | None) -> None:
        limit = UNLIMITED if effort is None else effort
        SubElement(
            self._parts["actuator"],
            "general",
            name=self._named(joint),
            joint=self._named(joint),
            biastype="affine",
            gainprm=_text([stiffness]),
            biasprm=_text([0.0, -stiffness, -damping]),
            forcelimited="true",
            forcerange=_text([-limit, limit]),
        )

    def _couplings(self) -> Iterator[tuple[str, str, float, float]]:
        """Joints that follow others: joint, driving joint, factor and offset."""
        gripper = self._model.gripper
        if gripper is None:
            return
        start, slope = (np.broadcast_to(v, len(self._driven)) for v in (gripper.at_zero, gripper.per_joint))
        for k in range(1, len(self._driven)):
            factor = float(slope[k] / slope[0])
            yield self._driven[k], self._driven[0], factor, float(start[k] - factor * start[0])
        for driver in self._driven:
            for name, (factor, offset) in self._urdf.tree.mimics(driver).items():
                if name not in self._driven and factor != 0.0 and self._urdf.joints[name].moves:
                    yield name, driver, factor, offset


def _add_geom(element: Element, name: str, shape: Shape, assets: Element, **more: str) -> None:
    kind, size = shape.kind, np.asarray(shape.size, float)
    if kind is ShapeKind.MESH:
        if shape.mesh is None:
            raise InputError(f"a mesh shape of '{name}' has no file")
        vertices = read_hull(shape.mesh).vertices * size
        SubElement(assets, "mesh", name=name, vertex=_text(vertices.ravel()))
        more |= {"type": "mesh", "mesh": name}
    else:
        half = {ShapeKind.BOX: 0.5, ShapeKind.SPHERE: 1.0}.get(kind, np.array([1.0, 0.5]))  # radius, half the height
        more |= {"type": str(kind), "size": _text(half * size)}
    SubElement(element, "geom", {"name": name, "solref": SOLREF, "solimp": SOLIMP, **_place(shape.pose), **more})


def _add_pair(a: _Geom, b: _Geom, contact: Element) -> None:
    rolls = a.rolls or b.rolls
    sliding, spinning = a.friction * b.friction, max(a.spinning, b.spinning)
    rolling = ROLLING_FRICTION if rolls else 0.0
    SubElement(
        contact,
        "pair",
        geom1=a.name,
        geom2=b.name,
        condim="6" if rolls else "4",
        friction=_text([sliding, sliding, spinning, rolling, rolling]),
        solref=SOLREF,
        solimp=SOLIMP,
    )


def _place(T: np.ndarray) -> dict[str, str]:
    """Position and quaternion (w first) of a pose (7,)."""
    return {"pos": _text(T[:3]), "quat": _text(np.roll(T[3:], 1))}


def _text(numbers) -> str:
    return " ".join(f"{v:.9g}" for v in numbers)
