"""The moves of a task that are given to a method: which robot moves which object, in which order, and where to."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from hmap_core.exceptions import Code, InputError
from hmap_core.scenes.document import Document, read
from hmap_core.scenes.fields import Name, Strict
from hmap_core.scenes.schema import Pose
from hmap_core.scenes.validate import validate
from hmap_core.types import BodyKind, Scene

BUILT_IN = Path(__file__).parent / "skeletons.yaml"


class MoveEntry(Strict):
    """A move as it stands in the file."""

    robot: Name
    object: Name
    slides_on: Name | None = None
    through: list[Pose] = []
    to: Literal["goal", "removal"] | Pose


@dataclass(frozen=True)
class Move:
    """One contact of a robot with an object, and where it brings the object.

    Attributes:
        robot, object: names.
        T_end: (7,) where the object is released, world frame.
        slides_on: the body on which the object stays; None: it may be lifted.
        through: (m, 7) poses that it takes on the way.
        intermediate: the place of release follows neither from the goal nor from the removal poses of the task.
    """

    robot: str
    object: str
    T_end: np.ndarray
    slides_on: str | None
    through: np.ndarray
    intermediate: bool


def given_moves(scene: Scene, file: str = "") -> list[Move]:
    """The moves that a file gives for a task.

    Args:
        scene: the task.
        file: path of the file; empty: ``baselines/skeletons.yaml``.

    Raises:
        InputError: the file cannot be read, has no moves for the task, or names what the scene does not have.
    """
    document = read(Path(file) if file else BUILT_IN)
    if scene.task not in document.data:
        known = ", ".join(document.data)
        raise InputError(
            f"{document.path}: no skeleton is given for task '{scene.task}'; there are {known}. Give a file of your "
            "own after the method's name and a colon",
            Code.UNKNOWN_TASK,
        )
    entries = document.value((scene.task,))
    if not isinstance(entries, list) or not entries:
        raise document.error((scene.task,), "must be a list of one move or more", Code.INVALID_INPUT)
    return [_move(scene, document, k) for k in range(len(entries))]


def _move(scene: Scene, document: Document, k: int) -> Move:
    location = (scene.task, k)
    entry = validate(MoveEntry, document, {}, location)
    if entry.robot not in scene.robots:
        known = ", ".join(scene.robots)
        raise document.error((*location, "robot"), f"no such robot; there are {known}", Code.UNKNOWN_ROBOT)
    movable = [name for name, body in scene.bodies.items() if body.kind != BodyKind.FIXED]
    if entry.object not in movable:
        known = ", ".join(movable)
        raise document.error(
            (*location, "object"), f"no body that can be moved; there are {known}", Code.UNKNOWN_OBJECT
        )
    if entry.slides_on is not None and entry.slides_on not in scene.bodies:
        known = ", ".join(scene.bodies)
        raise document.error((*location, "slides_on"), f"no such body; there are {known}", Code.UNKNOWN_OBJECT)
    through = np.array([pose.vector() for pose in entry.through]).reshape(-1, 7)
    T_end = _end(scene, document, location, entry)
    return Move(entry.robot, entry.object, T_end, entry.slides_on, through, isinstance(entry.to, Pose))


def _end(scene: Scene, document: Document, location: tuple[str | int, ...], entry: MoveEntry) -> np.ndarray:
    if isinstance(entry.to, Pose):
        return entry.to.vector()
    if entry.to == "goal":
        if entry.object != scene.goal.object:
            problem = f"only '{scene.goal.object}' has a goal; allowed: removal, or a pose"
            raise document.error((*location, "to"), problem, Code.INVALID_INPUT)
        return scene.goal.pose
    T_removal = scene.removable.get(entry.object)
    if T_removal is None:
        known = ", ".join(name for name, T in scene.removable.items() if T is not None) or "none"
        raise document.error((*location, "to"), f"'{entry.object}' has no removal pose; with one: {known}")
    return T_removal
