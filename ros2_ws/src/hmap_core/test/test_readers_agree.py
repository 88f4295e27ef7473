"""The planner's reader of robot descriptions, the judge's own, and the simulation give the same robots."""

import math
import re

import mesh_fixtures as meshes
import numpy as np
import pytest
from robot_fixtures import write

from hmap_core.collision.convex import hull_vertices
from hmap_core.exceptions import Code, InputError
from hmap_core.robot_description import RobotDescription, cleaned_urdf, load_robot_description
from hmap_core.simulation.client import BulletClient
from hmap_core.transforms import apply, to_matrix
from hmap_core.validation import rigid
from hmap_core.validation import urdf as judge

DESCRIPTIONS = 100
MESHES = ("unused.obj", "unused.ply", "millimetres.dae", "scene.glb", "inverted.stl", "plain.stl")
KINDS = ("revolute", "continuous", "prismatic", "fixed", "planar", "floating")
TOLERANCE = 1e-9  # m and rad


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A package with meshes, and five folders below it for the descriptions."""
    package = tmp_path_factory.mktemp("index") / "robot_package"
    (package / "meshes").mkdir(parents=True)
    files = {name: package / "meshes" / name for name in MESHES}
    meshes.with_unused_vertex(files["unused.obj"])
    meshes.with_unused_vertex(files["unused.ply"])
    meshes.in_millimetres(files["millimetres.dae"])
    meshes.scene_of_boxes(files["scene.glb"])
    inside_out = meshes.box()
    inside_out.invert()
    meshes.save(inside_out, files["inverted.stl"])
    meshes.save(meshes.box(), files["plain.stl"])
    below = package / "a" / "b" / "c" / "d" / "e"
    below.mkdir(parents=True)
    return below


class Writer:
    """Writes a random description."""

    def __init__(self, seed: int):
        self.rng = np.random.default_rng(seed)

    def numbers(self, size: float, count: int = 3) -> str:
        return " ".join(f"{x:.6g}" for x in self.rng.uniform(-size, size, count))

    def positive(self, count: int = 1) -> str:
        return " ".join(f"{x:.6g}" for x in self.rng.uniform(0.02, 0.2, count))

    def origin(self) -> str:
        choices = ("", f'<origin xyz="{self.numbers(0.5)}"/>', f'<origin rpy="{self.numbers(3)}"/>')
        return str(self.rng.choice([*choices, f'<origin xyz="{self.numbers(0.5)}" rpy="{self.numbers(3)}"/>']))

    def geometry(self) -> str:
        kind = self.rng.choice(["box", "sphere", "cylinder", "capsule", "mesh", "mesh"])
        if kind == "box":
            return f'<box size="{self.positive(3)}"/>'
        if kind == "sphere":
            return f'<sphere radius="{self.positive()}"/>'
        if kind in ("cylinder", "capsule"):
            return f'<{kind} radius="{self.positive()}" length="{self.positive()}"/>'
        name = self.rng.choice(MESHES)
        place = self.rng.choice(["package://robot_package/meshes/", "package://renamed/meshes/", "meshes/"])
        scale = self.rng.choice(["", 'scale="1 2 0.5"', 'scale="-1 1 1"'])
        return f'<mesh filename="{place}{name}" {scale}/>'

    def link(self, name: str) -> str:
        shapes = range(self.rng.integers(3))
        inside = "".join(
            f"<collision>{self.origin()}<geometry>{self.geometry()}</geometry></collision>" for _ in shapes
        )
        return f'<link name="{name}">{inside}</link>'

    def joint(self, number: int, before: list[str]) -> str:
        kind = self.rng.choice(KINDS, p=(0.4, 0.15, 0.2, 0.15, 0.05, 0.05))
        axis = self.rng.choice(["", f'<axis xyz="{self.numbers(3)}"/>', '<axis xyz="0 0 2"/>', '<axis xyz="0 -1 0"/>'])
        low, high = np.sort(self.rng.uniform(-2, 2, 2))
        keys = [f'lower="{low:.4f}"', f'upper="{high:.4f}"', 'velocity="1.5"', 'effort="50"', 'effort="0"']
        kept = [key for key in keys if self.rng.random() < 0.8]
        if kept.count('effort="50"') and kept.count('effort="0"'):
            kept.remove('effort="0"')
        if 'lower="' in " ".join(kept) and low > 0 and keys[1] not in kept:
            kept.append(keys[1])  # an upper limit of 0 would be below
        if 'upper="' in " ".join(kept) and high < 0 and keys[0] not in kept:
            kept.append(keys[0])
        limit = f"<limit {' '.join(kept)}/>" if kind in ("revolute", "prismatic") or self.rng.random() < 0.5 else ""
        mimic = ""
        if before and self.rng.random() < 0.25:
            mimic = (
                f'<mimic joint="{self.rng.choice(before)}" multiplier="{self.rng.uniform(-2, 2):.3f}" offset="0.1"/>'
            )
        parent = f"link{self.rng.integers(number)}"
        ends = f'<parent link="{parent}"/><child link="link{number}"/>'
        return f'<joint name="joint{number}" type="{kind}">{ends}{self.origin()}{axis}{limit}{mimic}</joint>'

    def robot(self) -> str:
        count = int(self.rng.integers(2, 9))
        links = [self.link(f"link{i}") for i in range(count)]
        joints = [self.joint(i, [f"joint{k}" for k in range(1, i)]) for i in range(1, count)]
        elements = [*links, *joints]
        self.rng.shuffle(elements)
        return f'<robot name="random">{"".join(elements)}</robot>'

    def values(self, description: RobotDescription) -> dict[str, float]:
        """Values of the joints that move by themselves."""
        free = [joint.name for joint in description.joints.values() if joint.moves and joint.mimic is None]
        return {name: float(self.rng.uniform(-1, 1)) for name in free}


def judged_frames(tree: judge.Urdf, values: dict[str, float]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Link frames by the judge's reading: rotation (3, 3) and position (3,)."""
    by_name = {joint.name: joint for joint in tree.joints}

    def value(name: str) -> float:
        joint = by_name[name]
        if joint.kind not in judge.MOVING:
            return 0.0
        if joint.mimic is None:
            return values[name]
        return joint.mimic[1] * value(joint.mimic[0]) + joint.mimic[2]

    frames = {tree.root: (np.eye(3), np.zeros(3))}
    for joint in tree.joints:
        R, p = frames[joint.parent]
        R, p = R @ joint.origin_R, p + R @ joint.origin_p
        if joint.kind in ("revolute", "continuous"):
            R = rigid.rotated(R[None], joint.axis, np.array([value(joint.name)]))[0]
        elif joint.kind == "prismatic":
            p = p + R @ joint.axis * value(joint.name)
        frames[joint.child] = R, p
    return frames


def extents(points: np.ndarray, radius: float) -> np.ndarray:
    """Extents (D,) of a swept hull along some directions."""
    directions = np.random.default_rng(0).normal(size=(40, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    return (points @ directions.T).max(axis=0) + radius


@pytest.mark.parametrize("seed", range(DESCRIPTIONS))
def test_frames_shapes_and_limits_are_the_same(folder, seed):
    writer = Writer(seed)
    file = write(folder, writer.robot(), f"robot{seed}.urdf")
    ours = load_robot_description(file).require_valid()
    theirs = judge.load(str(file))
    assert theirs.root == ours.root and set(theirs.links) == set(ours.links)
    assert {joint.name for joint in theirs.joints} == set(ours.joints)
    for joint in theirs.joints:
        own = ours.joints[joint.name]
        assert (joint.kind, joint.parent, joint.child) == (own.kind, own.parent, own.child)
        if own.moves:
            np.testing.assert_allclose(joint.axis, own.axis, atol=TOLERANCE)
            assert (joint.lower, joint.upper, joint.velocity) == (own.lower, own.upper, own.velocity)
            assert joint.mimic == own.mimic
    values = writer.values(ours)
    frames = judged_frames(theirs, values)
    for link in ours.links:
        expected = ours.tree.pose(link, values)
        np.testing.assert_allclose(frames[link][0], expected[:3, :3], atol=TOLERANCE)
        np.testing.assert_allclose(frames[link][1], expected[:3, 3], atol=TOLERANCE)
    for link, description in ours.links.items():
        shapes = [shape for shape in theirs.shapes if shape.link == link]
        assert len(shapes) == len(description.shapes)
        for judged, shape in zip(shapes, description.shapes, strict=True):
            points, radius = hull_vertices(shape)
            seen = judged.solid.points @ judged.R.T + judged.p
            # circles are polygons in both readers, circumscribed in one and inscribed in the other
            slack = 2e-3 if shape.kind == "cylinder" else 1e-7
            np.testing.assert_allclose(extents(points, radius), extents(seen, judged.solid.ball), atol=slack)


@pytest.mark.parametrize("seed", range(0, DESCRIPTIONS, 5))
def test_the_simulation_has_the_same_frames(folder, seed):
    writer = Writer(seed)
    ours = load_robot_description(write(folder, writer.robot(), f"robot{seed}.urdf")).require_valid()
    values = writer.values(ours)
    client = BulletClient()
    body = client.loadURDF(str(cleaned_urdf(ours)), useFixedBase=True)
    names = {}
    for j in range(client.getNumJoints(body)):
        info = client.getJointInfo(body, j)
        names[j] = info[12].decode()
        joint = ours.joints[info[1].decode()]
        if joint.moves:
            client.resetJointState(body, j, ours.tree.value(joint.name, values))
    assert client.getBodyInfo(body)[0].decode() == ours.root and len(names) == len(ours.links) - 1
    for j, link in names.items():
        state = client.getLinkState(body, j, computeForwardKinematics=True)
        T = ours.tree.pose(link, values)
        np.testing.assert_allclose(state[4], T[:3, 3], atol=1e-5)
        np.testing.assert_allclose(to_matrix(np.array([*state[4], *state[5]]))[:3, :3], T[:3, :3], atol=1e-5)


def test_the_judge_refuses_what_is_no_tree_without_running_on(folder):
    joint = '<joint name="{}" type="fixed"><parent link="{}"/><child link="{}"/></joint>'
    cases = {
        "a b, b a": "links without a parent",
        "a b, c d, d c": "joints joint1, joint2 form a loop",
        "a b, b c, d c": "child link c is there twice",
        "a b, b e": "joints name the links e, which are missing",
    }
    for i, (ends, says) in enumerate(cases.items()):
        joints = "".join(joint.format(f"joint{k}", *pair.split()) for k, pair in enumerate(ends.split(", ")))
        links = "".join(f'<link name="{name}"/>' for name in "abcd" if name in ends)
        file = write(folder, f'<robot name="r">{links}{joints}</robot>', f"no_tree{i}.urdf")
        with pytest.raises(Exception, match=says):
            judge.load(str(file))


def test_names_and_numbers_may_have_spaces_and_tags_prefixes(folder):
    """Tags with a prefix that is not declared are no XML with namespaces, and common; PyBullet reads them."""
    text = (
        '\n<?xml version="1.0"?>\n<robot name="r"><link name=" a "/><link name="b"/><sensor:camera name="c"/>'
        '<joint name="j " type=" revolute "><parent link="a"/><child link=" b"/><axis xyz="  0 0   2 "/>'
        '<limit lower=" -1" upper="+1." velocity="1e0" effort="1"/></joint></robot>'
    )
    file = write(folder, text, "spaces.urdf")
    ours, theirs = load_robot_description(file).require_valid(), judge.load(str(file))
    assert tuple(ours.links) == theirs.links == ("a", "b")
    (joint,) = theirs.joints
    assert (joint.name, joint.kind, joint.lower, joint.upper) == ("j", "revolute", -1.0, 1.0)
    assert tuple(ours.joints) == ("j",) and load_robot_description(cleaned_urdf(ours)).findings == ()


def test_shapes_are_placed_alike(folder):
    """Of a mesh with a scale that mirrors it, in a frame that is turned."""
    mesh = '<mesh filename="package://robot_package/meshes/plain.stl" scale="-1 1 1"/>'
    origin = '<origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/>'
    collision = f"<collision>{origin}<geometry>{mesh}</geometry></collision>"
    text = f'<robot name="r"><link name="a">{collision}</link></robot>'
    file = write(folder, text, "one.urdf")
    (shape,) = load_robot_description(file).links["a"].shapes
    points, _ = hull_vertices(shape)
    expected = apply(shape.pose, np.array([[-0.1, 0, 0], [0, 0.2, 0.3]]))
    np.testing.assert_allclose(points.min(axis=0), expected.min(axis=0), atol=1e-6)
    (judged,) = judge.load(str(file)).shapes
    seen = judged.solid.points @ judged.R.T + judged.p
    np.testing.assert_allclose(seen.max(axis=0), [1.0, 0.0, 0.3], atol=1e-6)
    np.testing.assert_allclose(math.pi / 2, 2 * math.acos(shape.pose[6]), atol=1e-9)


JUNK = ("nan", "inf", "-1", "0", "", "1e309", "1,5", "${x}", "0 0", "1 2 3 4", "joint1", "link1", "1_0", "..", "planar")
FAULTS = 120
FAULTY = re.compile(r' \w+="([^"]*)"|<(link|joint|collision|limit|origin|geometry|mimic)\b.*?(</\2>|/>)')


@pytest.mark.parametrize("seed", range(FAULTS))
def test_what_the_planner_accepts_the_judge_reads_and_nothing_else_happens(folder, seed):
    """Random faults: attributes with other values, and attributes or elements left out or doubled."""
    writer = Writer(seed)
    text = writer.robot()
    for _ in range(writer.rng.integers(1, 4)):
        found = list(FAULTY.finditer(text))
        match = found[writer.rng.integers(len(found))]
        part = match.group()
        value = match.group(1)
        junk = "" if value is None else part.replace(f'"{value}"', f'"{writer.rng.choice(JUNK)}"')
        text = text[: match.start()] + str(writer.rng.choice(["", junk, part * 2])) + text[match.end() :]
    file = write(folder, text, f"faulty{seed}.urdf")
    description = load_robot_description(file)
    judged: judge.Urdf | None = None
    try:
        judged = judge.load(str(file))
    except InputError as error:
        assert error.code == Code.INVALID_PLAN_FILE
    if not description.errors:
        assert judged is not None
        cleaned_urdf(description)
