"""Whether grippers can hold a body at all, by widths alone, and in words why not."""

from collections.abc import Iterable

from hmap_core.contacts.grasp import WIDTH_CLEARANCE
from hmap_core.types import Body, Robot, Scene, Shape, ShapeKind, TaskMode


def narrowest(body: Body) -> float | None:
    """The smallest width in m of a body between opposite faces; None with a mesh, which may be narrow anywhere."""
    widths = [_width(shape) for shape in body.shapes]
    known = [width for width in widths if width is not None]
    return min(known) if len(known) == len(widths) else None


def grip_problem(scene: Scene, object: str, robots: Iterable[str]) -> str:
    """Why none of the robots can grip a body, whatever is around.

    Args:
        scene: the task.
        object: name of the body.
        robots: names of robots.

    Returns:
        The reason; empty if a robot may be able to, or if the task is kinematic and needs no grips.
    """
    width = narrowest(scene.bodies[object])
    limits = [_limit(name, scene.robots[name], width) for name in robots]
    if scene.mode == TaskMode.KINEMATIC or not limits or not all(limits):
        return ""
    wide = "" if width is None else f", which is {1e3 * width:.0f} mm wide where it is narrowest"
    return f"no gripper holds '{object}'{wide}: {'; '.join(limits)}"


def _limit(name: str, robot: Robot, width: float | None) -> str:
    """Why a robot cannot grip a body of a width in m; empty if it may be able to."""
    gripper = robot.model.gripper
    if gripper is None:
        return f"'{name}' has no gripper"
    if width is None or width <= gripper.max_opening - WIDTH_CLEARANCE:
        return ""
    return f"the gripper of '{name}' opens {1e3 * gripper.max_opening:.0f} mm"


def _width(shape: Shape) -> float | None:
    """Smallest width of a shape in m between parallel tangent planes on its surface; None for a mesh."""
    size = shape.size
    if shape.kind == ShapeKind.BOX:
        return min(size)
    if shape.kind == ShapeKind.CYLINDER:
        return min(2.0 * size[0], size[1])
    return 2.0 * size[0] if shape.kind in (ShapeKind.SPHERE, ShapeKind.CAPSULE) else None
