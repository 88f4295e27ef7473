"""Builds the bodies of a scene from their entries in a task file and from reusable object files."""

from pathlib import Path

import numpy as np

from hmap_core.exceptions import Code, InputError
from hmap_core.scenes import meshes, resources
from hmap_core.scenes.convex_parts import convex_parts
from hmap_core.scenes.document import Document, Location, read
from hmap_core.scenes.fields import did_you_mean
from hmap_core.scenes.parameters import draw
from hmap_core.scenes.schema import BodyEntry, Geometry, ObjectFile, Part
from hmap_core.scenes.validate import validate
from hmap_core.types import Body, BodyKind, Shape, ShapeKind

DEFAULT_FRICTION = 0.6  # lateral Coulomb coefficient of wood or plastic on a table
MIN_MASS = 1e-3  # kg, of a movable body; a smaller one is probably a wrong unit and makes the simulation unstable
UNIT_SCALE = (1.0, 1.0, 1.0)


def list_objects() -> list[str]:
    """Names of the reusable objects that come with hmap."""
    return sorted(path.stem for path in (resources.package_path("hmap_scenes") / "objects").glob("*.yaml"))


def build_body(document: Document, location: Location, name: str, kind: BodyKind, entry: BodyEntry, seed: int) -> Body:
    """Builds a body.

    Args:
        document: the task file.
        location: location of the entry in the task file.
        name: of the body.
        kind: of the body.
        entry: the entry.
        seed: seed of the randomised parameters of an object file.

    Returns:
        The body.

    Raises:
        InputError: UNKNOWN_OBJECT, INVALID_SCENE or INVALID_POSE; the reason names the file, line, key and value.
    """
    source: Geometry = entry
    source_document, source_location = document, location
    if entry.object is not None:
        source_document, source = _object(document, (*location, "object"), name, entry, seed)
        source_location = ()
    mass, friction, color, graspable = (
        mine if (mine := getattr(entry, key)) is not None else getattr(source, key)
        for key in ("mass", "friction", "color", "graspable")
    )
    if kind is not BodyKind.FIXED and (mass is None or mass < MIN_MASS):
        given = "none is given" if mass is None else f"it is {mass:g} kg"
        raise document.error(
            location, f"the {kind.value} body {name!r} needs a mass of at least {MIN_MASS:g} kg; {given}"
        )
    return Body(
        name=name,
        kind=kind,
        shapes=_shapes(source_document, source_location, source),
        pose=entry.pose.vector(),
        mass=0.0 if kind is BodyKind.FIXED else mass,
        friction=DEFAULT_FRICTION if friction is None else friction,
        graspable=tuple(np.array([region.lower, region.upper]) for region in graspable or ()),
        color=color,
    )


def _object(
    document: Document, location: Location, name: str, entry: BodyEntry, seed: int
) -> tuple[Document, ObjectFile]:
    """Reads the object file that ``entry`` names and draws its parameters."""
    path = _object_path(document, location, entry.object or "")
    source = read(path)
    declared = source.data.get("parameters") or {}
    given = entry.values or {}
    for key in given:
        if key not in declared:
            known = ", ".join(declared) or "none"
            raise document.error(
                (*location[:-1], "with", key),
                f"the object {entry.object!r} has no such parameter.{did_you_mean(key, list(declared))} Known: {known}",
            )
    try:
        return source, validate(ObjectFile, source, draw(source, seed, scope=name, given=given))
    except InputError as error:
        raise document.error(location, f"with the values given here, {error.reason}", error.code) from error


def _object_path(document: Document, location: Location, name: str) -> Path:
    if name.endswith((".yaml", ".yml")):
        try:
            return resources.resolve(name, document.path.parent)
        except InputError as error:
            raise document.error(location, error.reason, Code.UNKNOWN_OBJECT) from error
    known = list_objects()
    if name not in known:
        problem = f"unknown object.{did_you_mean(name, known)} Known: {', '.join(known)}, or the path of a .yaml file"
        raise document.error(location, problem, Code.UNKNOWN_OBJECT)
    return resources.package_path("hmap_scenes") / "objects" / f"{name}.yaml"


def _shapes(document: Document, location: Location, source: Geometry) -> tuple[Shape, ...]:
    if source.parts is None:
        part = Part.model_construct(
            shape=source.shape,
            size=source.size,
            mesh=source.mesh,
            convex_hull=source.convex_hull,
            decompose=source.decompose,
        )
        return _part(document, location, part)
    parts = [_part(document, (*location, "parts", i), part) for i, part in enumerate(source.parts)]
    return tuple(shape for part in parts for shape in part)


def _part(document: Document, location: Location, part: Part) -> tuple[Shape, ...]:
    """The shape of an entry, or the convex parts of a mesh that is decomposed."""
    size = tuple(part.size or UNIT_SCALE)
    if part.shape is not ShapeKind.MESH:
        return (Shape(part.shape, size, part.pose.vector()),)
    try:
        path = resources.resolve(part.mesh or "", document.path.parent)
        paths: tuple[Path, ...] = (path,)
        if part.decompose:
            paths = convex_parts(path)
        else:
            meshes.check_convex(path, part.convex_hull)
    except InputError as error:
        raise document.error((*location, "mesh"), error.reason) from error
    return tuple(Shape(part.shape, size, part.pose.vector(), mesh=each) for each in paths)
