"""Loads tasks: builds a scene from a task name or file and a seed."""

from pathlib import Path

import numpy as np

from hmap_core import transforms
from hmap_core.arguments import checked_seed
from hmap_core.exceptions import Code, InputError
from hmap_core.scenes import resources
from hmap_core.scenes.bodies import build_body
from hmap_core.scenes.document import Document, read
from hmap_core.scenes.fields import did_you_mean
from hmap_core.scenes.parameters import draw
from hmap_core.scenes.robots import load_robot_model
from hmap_core.scenes.schema import CameraEntry, GoalEntry, RobotEntry, TaskFile
from hmap_core.scenes.tasks import list_tasks
from hmap_core.scenes.validate import validate
from hmap_core.types import DEFAULT_EXECUTION_TOLERANCE, JOINT_TOLERANCE, Body, BodyKind, Camera, Goal, Robot, Scene

MIN_VIEW_ANGLE = np.deg2rad(0.1)  # smallest angle between a camera's viewing direction and its up direction


def load_scene(task: str | Path, seed: int | None = None) -> Scene:
    """Loads a task and randomises it.

    Args:
        task: a name of :func:`list_tasks`, or the path of a task file.
        seed: 0 or larger. None selects the seed of the task file, whose default is 0. The same seed gives the same
            scene.

    Returns:
        The scene.

    Raises:
        InputError: UNKNOWN_TASK, UNKNOWN_OBJECT, UNKNOWN_ROBOT, INVALID_SCENE, INVALID_POSE or INVALID_INPUT (seed).
    """
    return instantiate(read_task(task), str(task), seed)


def read_task(task: str | Path) -> Document:
    """Reads the file of a task.

    Args:
        task: a name of :func:`list_tasks`, or the path of a task file.

    Returns:
        Its content, not yet validated.

    Raises:
        InputError: UNKNOWN_TASK, or INVALID_SCENE if the file is no task file.
    """
    return read(_task_path(task))


def instantiate(document: Document, task: str, seed: int | None = None) -> Scene:
    """Builds the scene that a task's document describes, and randomises it.

    Args:
        document: the content of a task file.
        task: name of the task.
        seed: see :func:`load_scene`.

    Returns:
        The scene.

    Raises:
        InputError: as :func:`load_scene`.
    """
    if seed is not None:
        checked_seed(seed)
    else:
        default = document.data.get("seed", 0)
        seed = default if type(default) is int and default >= 0 else 0  # validate reports an invalid one
    entry = validate(TaskFile, document, draw(document, int(seed)))
    return _build(document, entry, task, int(seed))


def _task_path(task: str | Path) -> Path:
    if isinstance(task, Path) or str(task).endswith((".yaml", ".yml")):
        path = Path(task).expanduser()
        try:
            if path.is_file():
                return path
        except (OSError, ValueError):
            pass
        raise InputError(f"no task file {str(task)!r}", Code.UNKNOWN_TASK)
    known = list_tasks()
    if task not in known:
        suggestion = did_you_mean(str(task), known)
        raise InputError(
            f"unknown task {str(task)!r}.{suggestion} Known: {', '.join(known)}, or the path of a .yaml file",
            Code.UNKNOWN_TASK,
        )
    return resources.package_path("hmap_scenes") / "tasks" / f"{task}.yaml"


def _build(document: Document, entry: TaskFile, task: str, seed: int) -> Scene:
    bodies = _bodies(document, entry, seed)
    return Scene(
        task=task,
        seed=seed,
        mode=entry.mode,
        bodies=bodies,
        robots=_robots(document, entry, bodies),
        cameras={name: build_camera(document, name, camera) for name, camera in entry.cameras.items()},
        goal=_goal(document, entry.goal, bodies),
        motion=entry.motion,
        removable=_removable(document, entry, bodies),
        execution_tolerance=_execution_tolerance(entry),
    )


def _execution_tolerance(entry: TaskFile) -> tuple[float, float]:
    """Execution tolerance in m and rad: as given, else the default or the goal's tolerance, whichever is larger."""
    given, goal = entry.execution_tolerance, entry.goal
    position, rotation = DEFAULT_EXECUTION_TOLERANCE
    return (
        given.position or max(position, goal.position_tolerance),
        float(np.deg2rad(given.rotation_deg or max(np.rad2deg(rotation), goal.rotation_tolerance_deg))),
    )


def _bodies(document: Document, entry: TaskFile, seed: int) -> dict[str, Body]:
    bodies: dict[str, Body] = {}
    groups = {"fixed": BodyKind.FIXED, "movable": BodyKind.MOVABLE, "tools": BodyKind.TOOL}
    for group, kind in groups.items():
        for name, body in getattr(entry, group).items():
            if name in bodies:
                raise document.error((group, name), f"a {bodies[name].kind.value} body has this name already")
            bodies[name] = build_body(document, (group, name), name, kind, body, seed)
    return bodies


def _robots(document: Document, entry: TaskFile, bodies: dict[str, Body]) -> dict[str, Robot]:
    for name in entry.robots:
        if name in bodies:
            raise document.error(("robots", name), "a body has this name already")
    return {name: build_robot(document, name, robot) for name, robot in entry.robots.items()}


def build_robot(document: Document, name: str, entry: RobotEntry) -> Robot:
    """The robot ``name`` of a task's document.

    Raises:
        InputError: UNKNOWN_ROBOT or INVALID_SCENE.
    """
    here = ("robots", name)
    try:
        model = load_robot_model(entry.model, document.path.parent)
    except InputError as error:
        raise document.error((*here, "model"), error.reason, error.code) from error
    q = model.home.copy() if entry.q is None else np.array(entry.q)
    if len(q) != len(model.joint_names):
        raise document.error((*here, "q"), f"must have {len(model.joint_names)} numbers, one for each joint")
    lower, upper = model.position_limits
    for i in np.flatnonzero((q < lower - JOINT_TOLERANCE) | (q > upper + JOINT_TOLERANCE)):
        limits = f"[{lower[i]:g}, {upper[i]:g}]"
        raise document.error((*here, "q", int(i)), f"must be within the joint's limits {limits}")
    return Robot(name, model, entry.base.vector(), q)


def build_camera(document: Document, name: str, entry: CameraEntry) -> Camera:
    """The camera ``name`` of a task's document.

    Raises:
        InputError: INVALID_SCENE; its view has no direction, or goes along ``up``.
    """
    forward = np.subtract(entry.look_at, entry.position)
    right = np.cross(forward, entry.up)
    if np.linalg.norm(right) <= np.sin(MIN_VIEW_ANGLE) * np.linalg.norm(forward) * np.linalg.norm(entry.up):
        raise document.error(
            ("cameras", name), "look_at must differ from position, and up must not be along the view; try up: [0, 1, 0]"
        )
    forward, right = forward / np.linalg.norm(forward), right / np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack([right, np.cross(forward, right), forward])
    matrix[:3, 3] = entry.position
    return Camera(name, transforms.from_matrix(matrix), entry.width, entry.height, float(np.deg2rad(entry.fov_y_deg)))


def _movable(document: Document, location: tuple, name: str, bodies: dict[str, Body]) -> None:
    """Checks that ``name`` is a body that may move.

    Raises:
        InputError: UNKNOWN_OBJECT or INVALID_SCENE.
    """
    movable = [body.name for body in bodies.values() if body.kind is not BodyKind.FIXED]
    if name not in bodies:
        problem = f"unknown object {name!r}.{did_you_mean(name, movable)} Known: {', '.join(movable)}"
        raise document.error(location, problem, Code.UNKNOWN_OBJECT)
    if name not in movable:
        raise document.error(location, f"{name!r} is fixed; movable: {', '.join(movable)}")


def _goal(document: Document, entry: GoalEntry, bodies: dict[str, Body]) -> Goal:
    _movable(document, ("goal", "object"), entry.object, bodies)
    tolerance = float(np.deg2rad(entry.rotation_tolerance_deg))
    return Goal(entry.object, entry.pose.vector(), entry.position_tolerance, tolerance)


def _removable(document: Document, entry: TaskFile, bodies: dict[str, Body]) -> dict[str, np.ndarray | None]:
    for name in entry.removable:
        _movable(document, ("removable", name), name, bodies)
        if name == entry.goal.object:
            raise document.error(("removable", name), "is the goal's object")
    return {name: pose.vector() if pose else None for name, pose in entry.removable.items()}
