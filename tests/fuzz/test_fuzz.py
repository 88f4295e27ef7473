"""Random faults in everything that comes from outside: a coded error or a result, never INTERNAL, a hang or a crash.

``HMAP_FUZZ_SECONDS`` sets the time for each kind (``make fuzz``), ``HMAP_FUZZ_SEED`` the first seed. A failure names
its seed; ``KEPT`` holds seeds that once failed.
"""

import copy
import json
import os
import random
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from mutate import damaged_bytes, mutated
from ruamel.yaml import YAML

from hmap.conversions import (
    body_from_message,
    plan_from_message,
    plan_to_message,
    scene_from_message,
    scene_to_message,
    state_from_message,
    state_to_message,
)
from hmap_core import plan_file, planner
from hmap_core.exceptions import HmapError
from hmap_core.mesh_files import read_hull
from hmap_core.planner.preconditions import check_bodies
from hmap_core.robot_description import load_robot_description
from hmap_core.scenes import load_scene
from hmap_core.scenes.resources import package_path
from hmap_core.validation import check
from hmap_core.validation.files import mesh_points
from hmap_core.validation.geometry import hull
from hmap_msgs.msg import Body as BodyMessage
from hmap_msgs_py.bodies import body_to_message
from hmap_msgs_py.checks import ConversionError

SECONDS = float(os.environ.get("HMAP_FUZZ_SECONDS", "8"))  # for each kind
FIRST = int(os.environ.get("HMAP_FUZZ_SEED", "0"))
SCENES = package_path("hmap_scenes")
LIMIT, WALL_LIMIT = 5, 60  # s of CPU time for one document, and by the clock: other work on the machine does not count
KEPT: dict[str, tuple[int, ...]] = {"mesh files": (9771,)}
TASKS = ("tunnel", "bookshelf_mini", "puck_around", "published/tunnel_tool")
ERRORS = (HmapError, ConversionError)


class Hang(Exception):
    """One document took longer than LIMIT."""


def hang(*_: object) -> None:
    raise Hang


def fuzz(kind: str, attempt: Callable[[random.Random], object]) -> None:
    """Call an attempt with one seed after the other until the time is up."""
    until, seed, codes = time.monotonic() + SECONDS, FIRST, set()
    seeds = [*KEPT.get(kind, ())]
    previous = {number: signal.signal(number, hang) for number in (signal.SIGPROF, signal.SIGALRM)}
    try:
        while seeds or time.monotonic() < until:
            number = seeds.pop() if seeds else seed
            seed += 1
            signal.setitimer(signal.ITIMER_PROF, LIMIT)
            signal.alarm(WALL_LIMIT)
            try:
                attempt(random.Random(number))
            except ERRORS as error:
                code = getattr(error, "code", None)
                assert code is None or code.name != "INTERNAL", f"{kind}, seed {number}: {error}"
                assert str(error).strip(), f"{kind}, seed {number}: an error without a reason"
                codes.add(code)
            except Exception as error:
                pytest.fail(f"{kind}, seed {number}: {type(error).__name__}: {error}")
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0)
                signal.alarm(0)
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
    assert codes, f"{kind}: no document was refused, so the faults reached nothing"


def yaml_of(path: Path) -> Any:
    return YAML(typ="safe").load(path)


def written(path: Path, document: Any) -> Path:
    with path.open("w") as stream:
        YAML(typ="safe").dump(document, stream)
    return path


@pytest.fixture(scope="module")
def plan() -> dict:
    return json.loads(json.dumps(plan_file.to_dict(planner.plan(load_scene("published/tunnel_tool"), seed=0))))


def test_task_files(tmp_path):
    documents = [yaml_of(SCENES / "tasks" / f"{task}.yaml") for task in TASKS]

    def attempt(rng):
        file = written(tmp_path / "task.yaml", mutated(rng.choice(documents), rng))
        scene = load_scene(file, 0)
        check_bodies(scene, scene.goal)

    fuzz("task files", attempt)


def test_robot_files(tmp_path):
    documents = [yaml_of(SCENES / "robots" / f"{name}.yaml") for name in ("panda", "iiwa", "xarm6", "ur5e_2f85")]
    task = yaml_of(SCENES / "tasks" / "tunnel.yaml")

    def attempt(rng):
        robot = written(tmp_path / "robot.yaml", mutated(rng.choice(documents), rng))
        scene = copy.deepcopy(task)
        for entry in scene["robots"].values():
            entry["model"] = str(robot)
        load_scene(written(tmp_path / "task.yaml", scene), 0)

    fuzz("robot files", attempt)


def test_robot_descriptions(tmp_path):
    text = (SCENES / "urdf" / "fr3.urdf").read_text()

    def attempt(rng):
        damaged = text
        for _ in range(rng.randint(1, 3)):
            start = rng.randrange(len(damaged))
            end = start + rng.randint(0, 60)
            piece = rng.choice(
                ("", " ", "nan", "0 0 0", '"', "<", "/>", "${x}", "-1", "1e400", damaged[end : end + 80])
            )
            damaged = damaged[:start] + piece + damaged[end:]
        file = tmp_path / "robot.urdf"
        file.write_text(damaged)
        load_robot_description(file).require_valid()

    fuzz("robot descriptions", attempt)


# a textured prism beside a tetrahedron with indices from behind, as several programs write them
OBJ = b"""# two bodies
mtllib none.mtl
o prism
v 0 0 0
v 0.1 0 0 0.2 0.2 0.2
v 0.1 0.2 0
v 0 0.2 0
v 0 0 3e-1
v 0.1 0 0.3
vt 0 0
vt 1 0
vn 0 0 -1
usemtl stone
f 1/1/1 4/2/1 3/1/1 2/2/1
f 1//1 2//1 6//1 5//1
f 4 5 6 3
f 1 5 4 # a triangle
f 2 3 \\
6
o tip
v 1 1 1
v 1.1\t1 1
v 1 1.1 1
v 1 1 1.2
f -4 -3 -2
f -4 -2 -1
f\t-3 -1 -2
f -4 -1 -3
"""


def test_mesh_files(tmp_path):
    ball = trimesh.creation.icosphere(1, 0.1)
    contents = {kind: ball.export(file_type=kind) for kind in ("stl", "stl_ascii", "ply", "dae", "glb", "off")}
    contents = {kind: data.encode() if isinstance(data, str) else data for kind, data in contents.items()}
    contents |= {"obj": OBJ, "obj_ball": ball.export(file_type="obj").encode()}

    def attempt(rng):
        kind = rng.choice((*contents, "obj", "obj"))  # of OBJ files the two readers are all our own
        file = tmp_path / f"mesh.{kind.partition('_')[0]}"
        file.write_bytes(damaged_bytes(contents[kind], rng))
        planned = read_hull(file).vertices
        try:
            judged = hull(mesh_points(file), file.name).points
        except ERRORS as error:
            raise AssertionError(f"{kind}: only the judge refuses it: {error}") from error
        ends = [[points.min(axis=0), points.max(axis=0)] for points in (planned, judged)]
        np.testing.assert_allclose(*ends, rtol=1e-5, atol=1e-7, err_msg=kind)

    fuzz("mesh files", attempt)


def test_plan_files_for_the_judge(plan):
    fuzz("plan files, judged", lambda rng: check(mutated(plan, rng)))


def test_plan_files_for_the_planner(plan):
    fuzz("plan files, read", lambda rng: plan_file.from_dict(mutated(plan, rng)))


def test_messages(plan):
    scene = load_scene("tunnel", 0)
    whole = scene_to_message(scene)
    state = state_to_message(scene, scene.start_state(), whole.header.stamp if hasattr(whole, "header") else None)
    body = body_to_message(next(iter(scene.bodies.values())))
    result = plan_to_message(plan_file.from_dict(plan))

    def attempt(rng):
        kind = rng.randrange(4)
        if kind == 0:
            state_from_message(scene, damaged_message(state, rng))
        elif kind == 1:
            body_from_message(damaged_message(body, rng))
        elif kind == 2:
            plan_from_message(damaged_message(result, rng))
        else:
            scene_from_message(damaged_message(whole, rng))

    assert isinstance(body, BodyMessage)
    fuzz("messages", attempt)


def damaged_message(message: Any, rng: random.Random) -> Any:
    """A copy with one to three fields changed, to values that their types allow."""
    message = copy.deepcopy(message)
    for _ in range(rng.randint(1, 3)):
        node = message
        while True:
            name = rng.choice(list(node.get_fields_and_field_types()))
            value = getattr(node, name)
            if hasattr(value, "get_fields_and_field_types"):
                node = value
                continue
            if isinstance(value, list) and value and hasattr(value[0], "get_fields_and_field_types"):
                if rng.random() < 0.3:
                    setattr(node, name, rng.choice(([], value[:-1], value + value[:1])))
                    break
                node = rng.choice(value)
                continue
            setattr(node, name, damaged_value(value, rng))
            break
    return message


def damaged_value(value: Any, rng: random.Random) -> Any:
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return rng.choice((0, 1, 2, 7))
    if isinstance(value, float):
        return rng.choice((0.0, -1.0, 1e-9, 1e9, float("nan"), float("inf"), -value))
    if isinstance(value, str):
        cut = rng.randrange(len(value) + 1)
        return rng.choice(("", "nothing", value[:cut], value[:cut] + "\x01" + value[cut:], value + value))
    if len(value) == 0:
        return value
    if isinstance(value, np.ndarray):  # of fixed length
        return np.roll(value, 1)
    return rng.choice((value[:-1], value + value[:1], value[::-1]))
