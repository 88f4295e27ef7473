"""Builds scenes in Python, with the keys, checks and errors of task files."""

import copy
import io
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Self, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike
from ruamel.yaml import YAML

from hmap_core.exceptions import Code, InputError
from hmap_core.scenes import resources
from hmap_core.scenes.bodies import build_body
from hmap_core.scenes.document import Document, Location
from hmap_core.scenes.fields import NAME_PATTERN, NAME_RULE
from hmap_core.scenes.loader import build_camera, build_robot, instantiate, read_task
from hmap_core.scenes.parameters import draw
from hmap_core.scenes.schema import (
    SCHEMA_VERSION,
    BodyEntry,
    CameraEntry,
    ExecutionTolerance,
    GoalEntry,
    RobotEntry,
    TaskFile,
)
from hmap_core.scenes.validate import Model, validate
from hmap_core.transforms import IDENTITY
from hmap_core.types import BodyKind, Goal, Scene, Shape, ShapeKind, TaskMode

YAML_WIDTH = 120  # characters of a line
GROUPS = {"fixed": BodyKind.FIXED, "movable": BodyKind.MOVABLE, "tools": BodyKind.TOOL}
NAMED = (*GROUPS, "robots")  # groups of entries that share their names
SUFFIXES = (".yaml", ".yml")

# a pose (7,) [x, y, z, qx, qy, qz, qw], a position (3,), or a mapping as in a task file
PoseLike = ArrayLike | Mapping[str, Any]


class BodyOptions(TypedDict, total=False):
    """Optional arguments of the ``add_*`` methods of bodies; see :meth:`SceneBuilder.add_body`."""

    movable: bool
    tool: bool
    removable: bool | PoseLike
    mass: float
    friction: float
    graspable: Sequence[ArrayLike]
    color: Sequence[float]


class SceneBuilder:
    """Builds a scene step by step; :meth:`build` returns the :class:`~hmap_core.types.Scene`.

    Each ``add_*`` method validates its arguments. :meth:`build` checks references between entries, such as the goal's
    object. All lengths are in metres, masses in kilograms, angles in radians, poses in the world frame.
    Every method that adds an entry returns the builder.

    A pose is an array (7,) of position and quaternion x, y, z, w; a position (3,); or a mapping as in a task file, such
    as ``{"xyz": [0.4, 0, 0.1], "rpy_deg": [0, 0, 90]}``.

    Example:
        ::

            scene = SceneBuilder("shift", mode="physical")
            scene.add_box("table", [2, 2, 0.1], pose=[0, 0, -0.05])
            scene.add_box("box", [0.05, 0.05, 0.08], pose=[0.5, -0.2, 0.04], movable=True, mass=0.3)
            scene.add_robot("arm", "panda", base_pose=[0, 0, 0])
            scene.set_goal("box", pose=[0.5, 0.2, 0.04])
            plan = hmap_core.planner.plan(scene.build())
    """

    def __init__(
        self,
        name: str = "scene",
        *,
        mode: TaskMode | str = TaskMode.PHYSICAL,
        motion: str = "auto",
        description: str = "",
        execution_tolerance: tuple[float, float] | None = None,
    ):
        """
        Args:
            name: of the task, for error messages and plans.
            mode: contact model, ``"physical"`` or ``"kinematic"``.
            motion: of the goal's object: ``"planar"``, ``"spatial"`` or ``"auto"``.
            description: text for users; :meth:`to_yaml` writes it.
            execution_tolerance: m and rad, see :class:`~hmap_core.types.Scene`; None: as for a task file.

        Raises:
            InputError: INVALID_SCENE.
        """
        self.name = str(name)
        data = {"schema": SCHEMA_VERSION, "description": description, "mode": _plain(mode), "motion": motion}
        if not description:
            del data["description"]
        if execution_tolerance is not None:
            position, rotation = execution_tolerance
            data["execution_tolerance"] = {"position": _plain(position), "rotation_deg": _degrees(rotation)}
        self._use(data)
        if execution_tolerance is not None:
            validate(ExecutionTolerance, self._document, {}, ("execution_tolerance",))

    @classmethod
    def from_yaml(cls, task: str | Path, name: str | None = None) -> Self:
        """Creates a builder from a task; its parameters and expressions are kept.

        Args:
            task: a name of :func:`~hmap_core.scenes.list_tasks`, or the path of a task file.
            name: of the new task; by default the name of ``task``.

        Raises:
            InputError: as :func:`~hmap_core.scenes.load_scene`.
        """
        document = read_task(task)
        instantiate(document, str(task))  # errors name the file and the line
        builder = cls(str(task) if name is None else name)
        builder._use(_absolute(copy.deepcopy(document.data), document.path.parent.absolute()))
        return builder

    def add_box(self, name: str, size: ArrayLike, pose: PoseLike, **options: Unpack[BodyOptions]) -> Self:
        """Add a box.

        Args:
            size: (3,) full extents x, y, z in m.
            pose: of its centre.
            options: as of :meth:`add_body`.

        Raises:
            InputError: as :meth:`add_body`.
        """
        return self.add_body(name, [_shape(ShapeKind.BOX, size)], pose, **options)

    def add_cylinder(
        self, name: str, radius: float, height: float, pose: PoseLike, **options: Unpack[BodyOptions]
    ) -> Self:
        """Add a cylinder along z, with its centre at ``pose``. Options and errors as of :meth:`add_body`."""
        return self.add_body(name, [_shape(ShapeKind.CYLINDER, [radius, height])], pose, **options)

    def add_sphere(self, name: str, radius: float, pose: PoseLike, **options: Unpack[BodyOptions]) -> Self:
        """Add a sphere. Options and errors as of :meth:`add_body`."""
        return self.add_body(name, [_shape(ShapeKind.SPHERE, [radius])], pose, **options)

    def add_capsule(
        self, name: str, radius: float, height: float, pose: PoseLike, **options: Unpack[BodyOptions]
    ) -> Self:
        """Add a capsule along z; ``height`` (m) is that of its cylindrical part. Otherwise as :meth:`add_body`."""
        return self.add_body(name, [_shape(ShapeKind.CAPSULE, [radius, height])], pose, **options)

    def add_mesh(
        self,
        name: str,
        file: str | Path,
        pose: PoseLike,
        *,
        scale: ArrayLike = (1.0, 1.0, 1.0),
        convex_hull: bool = False,
        decompose: bool = False,
        **options: Unpack[BodyOptions],
    ) -> Self:
        """Add the convex hull of a mesh, or its convex parts.

        Args:
            file: a path, or ``<package>://<path>``.
            pose: of the mesh's frame.
            scale: (3,) in x, y, z; 0.001 for a file in millimetres.
            convex_hull: use the hull of a concave mesh, which is an error otherwise.
            decompose: split a concave mesh into convex parts, once; they are kept in the user's cache.
            options: as of :meth:`add_body`.

        Raises:
            InputError: as :meth:`add_body`.
        """
        mesh = {"mesh": _uri(file), "convex_hull": convex_hull, "decompose": decompose}
        return self.add_body(name, [_shape(ShapeKind.MESH, scale) | mesh], pose, **options)

    def add_object(
        self,
        name: str,
        object: str | Path,
        pose: PoseLike,
        *,
        values: Mapping[str, float] | None = None,
        **options: Unpack[BodyOptions],
    ) -> Self:
        """Add a reusable object.

        Args:
            object: a name of :func:`~hmap_core.scenes.list_objects`, or the path of an object file.
            pose: of its frame.
            values: of its parameters; the others are as in its file.
            options: as of :meth:`add_body`; they override the values of its file.

        Raises:
            InputError: as :meth:`add_body`.
        """
        entry = {"object": _named(object)} | ({} if values is None else {"with": _plain(dict(values))})
        return self._add_entry(name, entry, pose, **options)

    def add_body(
        self, name: str, shapes: Sequence[Shape | Mapping[str, Any]], pose: PoseLike, **options: Unpack[BodyOptions]
    ) -> Self:
        """Add a body of one or several convex shapes.

        Args:
            name: letters, digits and ``_``, a letter first; unique among bodies and robots.
            shapes: in the body frame; each a :class:`~hmap_core.types.Shape`, or a mapping as in a task file.
            pose: T_world_body.
            options:

                - ``movable``: the body may be moved by contact; else it is fixed.
                - ``tool``: the body is movable and may serve as a manipulator.
                - ``removable``: the planner may move it out of the way, to the given pose; True: to any pose.
                - ``mass``: kg; required for movable bodies.
                - ``friction``: lateral Coulomb coefficient, 0.6 by default.
                - ``graspable``: boxes (2, 3) [lower, upper] in the body frame that may have contacts.
                - ``color``: (4,) red, green, blue and alpha in [0, 1].

        Raises:
            InputError: INVALID_SCENE, INVALID_POSE or UNKNOWN_OBJECT.
        """
        parts = [_shape_entry(shape) for shape in shapes]
        if len(parts) == 1 and "pose" not in parts[0]:
            return self._add_entry(name, parts[0], pose, **options)
        return self._add_entry(name, {"parts": parts}, pose, **options)

    def add_robot(
        self, name: str, model: str | Path, base_pose: PoseLike = (0.0, 0.0, 0.0), q: ArrayLike | None = None
    ) -> Self:
        """Add a robot.

        Args:
            name: of the robot; unique among bodies and robots.
            model: a name of :func:`~hmap_core.scenes.list_robots`, or the path of a robot file.
            base_pose: T_world_base.
            q: (n,) start configuration, rad or m; by default the home configuration of the model.

        Raises:
            InputError: UNKNOWN_ROBOT, INVALID_SCENE or INVALID_POSE.
        """
        entry = {"model": _named(model), "base": self._pose(("robots", name, "base"), base_pose)}
        if q is not None:
            entry["q"] = _plain(q)
        return self._add("robots", name, entry, RobotEntry, lambda robot: build_robot(self._document, name, robot))

    def add_camera(
        self,
        name: str,
        position: ArrayLike,
        look_at: ArrayLike,
        *,
        up: ArrayLike = (0.0, 0.0, 1.0),
        fov_y: float = float(np.deg2rad(42.0)),
        width: int = 640,
        height: int = 480,
    ) -> Self:
        """Add a pinhole camera.

        Args:
            position, look_at: (3,) m, position and a point on the optical axis.
            up: (3,) direction that points up in the picture.
            fov_y: vertical field of view, rad.
            width, height: pixels.

        Raises:
            InputError: INVALID_SCENE.
        """
        entry = {"position": _plain(position), "look_at": _plain(look_at), "up": _plain(up)}
        entry |= {"fov_y_deg": _degrees(fov_y), "width": _plain(width), "height": _plain(height)}
        return self._add("cameras", name, entry, CameraEntry, lambda c: build_camera(self._document, name, c))

    def set_goal(
        self,
        object: str,
        pose: PoseLike,
        *,
        position_tolerance: float = Goal.position_tolerance,
        rotation_tolerance: float = Goal.rotation_tolerance,
    ) -> Self:
        """Set the goal; a second call replaces the first.

        Args:
            object: a movable body or a tool; :meth:`build` checks that it exists.
            pose: T_world_object.
            position_tolerance: m.
            rotation_tolerance: rad.

        Raises:
            InputError: INVALID_SCENE or INVALID_POSE.
        """
        entry = {"object": object, "pose": self._pose(("goal", "pose"), pose)}
        entry |= {"position_tolerance": _plain(position_tolerance)}
        entry |= {"rotation_tolerance_deg": _degrees(rotation_tolerance)}
        before = dict(self._data)
        self._data["goal"] = entry
        try:
            validate(GoalEntry, self._document, self._parameters(), ("goal",))
        except InputError:
            self._use(before)
            raise
        return self

    def remove(self, name: str) -> Self:
        """Remove a body, a robot or a camera.

        Raises:
            InputError: UNKNOWN_OBJECT; no entry has that name.
        """
        groups = [group for group in (*NAMED, "cameras") if name in self._data.get(group, {})]
        if not groups:
            raise InputError(f"{self._document.origin}: there is no {name!r} in it", Code.UNKNOWN_OBJECT)
        for group in (*groups, "removable"):
            self._data.get(group, {}).pop(name, None)
        return self

    def build(self, seed: int | None = None) -> Scene:
        """Build the scene.

        Args:
            seed: 0 or larger, for the parameters of the task; None: the seed of the task, or 0.

        Raises:
            InputError: as :func:`~hmap_core.scenes.load_scene`; errors name the scene and the key.
        """
        return instantiate(self._document, self.name, seed)

    def to_yaml(self) -> str:
        """The text of a task file for the same scene, for :func:`~hmap_core.scenes.load_scene`.

        Paths of meshes, objects and robots are absolute, except for files that come with hmap.
        """
        order = [field.alias or name for name, field in TaskFile.model_fields.items()]
        data = {key: self._data[key] for key in order if self._data.get(key) not in (None, {})}
        yaml = YAML()
        yaml.width, yaml.default_flow_style = YAML_WIDTH, None
        text = io.StringIO()
        yaml.dump(data, text)
        return text.getvalue()

    def save(self, path: str | Path) -> Path:
        """Write a task file for ``hmap plan``, and return its path.

        Raises:
            InputError: the scene is incomplete (as :meth:`build`), the name does not end in .yaml, or the file cannot
                be written.
        """
        path = Path(path)
        if path.suffix not in SUFFIXES:
            raise InputError(f"{path}: the name of a task file ends in .yaml")
        self.build()
        try:
            path.write_text(self.to_yaml(), encoding="utf-8")
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error
        return path

    def _use(self, data: dict[str, Any]) -> None:
        self._data = data
        self._document = Document(Path("scene"), data, origin=f"scene {self.name!r}")

    def _parameters(self) -> dict[str, float]:
        return draw(self._document, seed=0)

    def _add_entry(
        self,
        name: str,
        entry: dict[str, Any],
        pose: PoseLike,
        movable: bool = False,
        tool: bool = False,
        removable: bool | PoseLike = False,
        **material: Any,
    ) -> Self:
        """Add a body whose shape is in ``entry``; ``material`` is mass, friction, graspable and color."""
        group = "tools" if tool else "movable" if movable else "fixed"
        here = (group, name)
        entry = entry | {"pose": self._pose((*here, "pose"), pose)} | _material(**material)
        aside = not (isinstance(removable, bool) and not removable)
        if aside and group == "fixed":
            raise self._document.error(here, "what is removable has to be movable or a tool")
        place = self._pose(("removable", name), removable) if aside and removable is not True else None
        self._add(
            group, name, entry, BodyEntry, lambda b: build_body(self._document, here, name, GROUPS[group], b, seed=0)
        )
        if aside:
            self._data.setdefault("removable", {})[name] = place
        return self

    def _add(
        self, group: str, name: str, entry: dict[str, Any], model: type[Model], check: Callable[[Model], Any]
    ) -> Self:
        """Add an entry if it is valid."""
        here = (group, name)
        if not isinstance(name, str) or not re.fullmatch(NAME_PATTERN, name):
            raise self._document.error(here, NAME_RULE)
        for other in NAMED if group in NAMED else (group,):
            if name in self._data.get(other, {}):
                what = {"robots": "robot", "cameras": "camera"}.get(other, "body")
                raise self._document.error(here, f"a {what} has this name already")
        self._data.setdefault(group, {})[name] = entry
        try:
            check(validate(model, self._document, self._parameters(), here))
        except InputError:
            del self._data[group][name]
            raise
        return self

    def _pose(self, location: Location, value: PoseLike) -> dict[str, Any]:
        """A pose as in a task file."""
        plain = _plain(value)
        if isinstance(plain, dict):
            return plain
        if isinstance(plain, list) and len(plain) == 3:
            return {"xyz": plain}
        if isinstance(plain, list) and len(plain) == 7:
            return {"xyz": plain[:3], "quaternion": plain[3:]}
        problem = f"{plain!r} is no pose: it must be [x, y, z], [x, y, z, qx, qy, qz, qw], or a mapping with xyz"
        raise self._document.error(location, problem, Code.INVALID_POSE)


def _material(graspable: Sequence[ArrayLike] | None = None, **others: Any) -> dict[str, Any]:
    """The given ones of mass, friction, graspable and color; the schema rejects unknown keys."""
    regions = None if graspable is None else [_region(region) for region in graspable]
    given = {"graspable": regions} | {key: _plain(value) for key, value in others.items()}
    return {key: value for key, value in given.items() if value is not None}


def _region(region: Any) -> Any:
    """A box [lower, upper] as in a task file; the schema rejects other values."""
    plain = _plain(region)
    return {"lower": plain[0], "upper": plain[1]} if isinstance(plain, list) and len(plain) == 2 else plain


def _shape(kind: ShapeKind, size: ArrayLike) -> dict[str, Any]:
    return {"shape": kind.value, "size": _plain(size)}


def _shape_entry(shape: Shape | Mapping[str, Any]) -> dict[str, Any]:
    if not isinstance(shape, Shape):
        return _plain(dict(shape))
    entry = {"shape": str(shape.kind), "size": _plain(shape.size)}
    if shape.mesh is not None:
        entry["mesh"] = _uri(shape.mesh)
    if not np.array_equal(shape.pose, IDENTITY):
        pose = _plain(shape.pose)
        entry["pose"] = {"xyz": pose[:3], "quaternion": pose[3:]}
    return entry


def _plain(value: Any) -> Any:
    """Converts arrays, tuples, paths and enumerations to YAML types; the schema rejects other values."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, str):
        return str(value)
    if isinstance(value, Path):
        return _uri(value)
    if isinstance(value, Mapping):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, Sequence):
        return [_plain(entry) for entry in value]
    return value


def _degrees(angle: Any) -> Any:
    """An angle (rad) in degrees; the schema rejects other values."""
    plain = _plain(angle)
    return float(np.rad2deg(plain)) if isinstance(plain, int | float) and not isinstance(plain, bool) else plain


def _uri(file: str | Path, base: Path | None = None) -> str:
    """A file as a URI or an absolute path."""
    if "://" in str(file):
        return str(file)
    return resources.portable((base or Path.cwd()) / Path(file).expanduser())


def _named(name: str | Path, base: Path | None = None) -> str:
    """The name of an item that comes with hmap unchanged; the path of a file made absolute."""
    return _uri(name, base) if str(name).endswith(SUFFIXES) else str(name)


def _absolute(data: dict[str, Any], base: Path) -> dict[str, Any]:
    """The data of a task with absolute paths."""
    for group in GROUPS:
        for body in data.get(group, {}).values():
            if "object" in body:
                body["object"] = _named(body["object"], base)
            for part in (body, *body.get("parts", [])):
                if "mesh" in part:
                    part["mesh"] = _uri(part["mesh"], base)
    for robot in data.get("robots", {}).values():
        robot["model"] = _named(robot["model"], base)
    return data
