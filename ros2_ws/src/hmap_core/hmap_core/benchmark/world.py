"""The world of a motion instance for the judge: its own URDF reader, exact shapes, distances by coal."""

from collections.abc import Collection, Mapping

import coal
import numpy as np

from hmap_core.benchmark.instances import MotionInstance
from hmap_core.types import Body, Robot, Scene
from hmap_core.validation.bounds import PartBoxes
from hmap_core.validation.document import BodyData, Document, GoalData, GripperData, RobotData, ShapeData
from hmap_core.validation.geometry import Solid, solid
from hmap_core.validation.pairs import Pair, PairBuilder
from hmap_core.validation.world import Part, World


def robot_data(robot: Robot) -> RobotData:
    """A robot in the judge's data format."""
    model, gripper = robot.model, robot.model.gripper
    k = len(gripper.joint_names) if gripper else 0
    return RobotData(
        robot.name, model.urdf_uri, robot.base_pose, model.joint_names, robot.q, model.position_limits,
        model.velocity_limits, model.acceleration_limits, model.end_effector_link, model.T_link_ee,
        frozenset(frozenset(pair) for pair in model.ignored_collisions),
        None if gripper is None else GripperData(
            gripper.joint_names, np.broadcast_to(gripper.per_joint, k), gripper.finger_links, gripper.min_opening,
            gripper.max_opening, np.broadcast_to(gripper.at_zero, k), np.array(gripper.openings),
        ),
        np.inf,
    )  # fmt: skip


def _body_data(body: Body) -> BodyData:
    shapes = tuple(ShapeData(str(s.kind), s.size, s.pose, str(s.mesh) if s.mesh else None) for s in body.shapes)
    return BodyData(body.name, str(body.kind), shapes, body.pose, body.friction)


def _rounded_box(size: tuple[float, ...], radius: float) -> Solid:
    """A box of these full extents (m) with rounded edges: an inset box swept by a sphere."""
    inset = tuple(s - 2.0 * radius for s in size)
    sharp = solid("box", inset)
    geometry = coal.Box(*inset)
    geometry.setSweptSphereRadius(radius)
    half = np.asarray(size) / 2.0
    return Solid("box", size, geometry, sharp.points, radius, np.zeros(3), half, sharp.volume, np.zeros(3))


class MotionWorld(World):
    """Robots and bodies at N samples, with the instance's rounding."""

    def __init__(self, document: Document, rounding: float):
        self._rounding = rounding
        super().__init__(document)

    def _body_parts(self) -> list[Part]:
        parts = super()._body_parts()
        if self._rounding == 0.0:
            return parts
        return [
            Part(p.owner, p.holder, p.link, _rounded_box(p.solid.size, self._rounding), p.R, p.p)
            if p.solid.kind == "box"
            else p
            for p in parts
        ]


def motion_world(
    scene: Scene,
    opening: Mapping[str, float],
    joints: Mapping[str, np.ndarray],
    objects: Mapping[str, np.ndarray] | None = None,
    rounding: float = 0.0,
) -> MotionWorld:
    """The world at N samples.

    Args:
        scene: robots and bodies.
        opening: of each robot's gripper, m.
        joints: robot -> (N, n), rad.
        objects: body -> T_world_body (N, 7), for bodies that move.
        rounding: radius of the edges of boxes, m.
    """
    N = len(next(iter(joints.values())))
    document = Document(
        mode=str(scene.mode),
        bodies={name: _body_data(body) for name, body in scene.bodies.items()},
        robots={name: robot_data(robot) for name, robot in scene.robots.items()},
        goal=GoalData(scene.goal.object, scene.goal.pose, scene.goal.position_tolerance, scene.goal.rotation_tolerance),
        time=np.arange(N, dtype=float),
        dt=1.0,
        joints=dict(joints),
        gripper={name: np.full(N, opening[name]) for name in scene.robots},
        objects=dict(objects or {}),
        segments=(),
    )
    return MotionWorld(document, rounding)


def pairs(world: World) -> list[Pair]:
    """All pairs of parts that must not penetrate each other and can move relative to each other."""
    return PairBuilder(world, set()).build()


def nearest(world: World, among: list[Pair], cutoff: float) -> float:
    """Smallest signed distance (m) of the pairs at sample 0, at most ``cutoff``."""
    boxes = PartBoxes(world)
    gaps = boxes.gaps(*boxes.rows(among), np.zeros(len(among), int))
    for pair, gap in zip(among, gaps, strict=True):
        if gap < cutoff:
            cutoff = min(cutoff, pair.gauge.distance(world.tracks[pair.a].at(0), world.tracks[pair.b].at(0)))
    return cutoff


def clearance(
    scene: Scene,
    opening: Mapping[str, float],
    q: Mapping[str, np.ndarray],
    cutoff: float,
    touching: Collection[frozenset[str]] = (),
) -> float:
    """Smallest distance between any two parts.

    Args:
        scene: robots and bodies.
        opening: of each robot's gripper, m.
        q: robot -> configuration (n,).
        cutoff: the largest result, m.
        touching: pairs of names that are ignored; links are named ``robot/link``.

    Returns:
        The distance in m.
    """
    world = motion_world(scene, opening, {name: np.atleast_2d(value) for name, value in q.items()})
    return nearest(world, [pair for pair in pairs(world) if frozenset(pair.names) not in touching], cutoff)


def instance_world(instance: MotionInstance, joints: np.ndarray, objects: Mapping[str, np.ndarray]) -> MotionWorld:
    """The world of an instance with the robots at joints (N, n)."""
    split = {name: joints[:, instance.columns(name)] for name in instance.scene.robots}
    return motion_world(instance.scene, instance.opening, split, objects, instance.rounding)
