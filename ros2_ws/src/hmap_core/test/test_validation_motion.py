"""The judge's bounds on speed, acceleration and distance between samples hold for random motions."""

from itertools import permutations

import numpy as np
import pytest
import validation_fixtures as plans
from scipy.spatial.transform import Rotation

from hmap_core.validation import document, limits, rigid
from hmap_core.validation.axes import SeparatingAxes
from hmap_core.validation.collision import Scan
from hmap_core.validation.geometry import Gauge, hull, polytope_points, solid, transform
from hmap_core.validation.pairs import PairBuilder
from hmap_core.validation.report import Findings
from hmap_core.validation.world import Track, World

SAMPLES = 12
FINE = 64  # intervals of a step
ROUNDING = 1e-6  # of second differences, m per squared step
DIRECTIONS = Rotation.random(200, random_state=4).as_matrix()[:, 0]


def panda(base: list[float], q: np.ndarray) -> dict:
    """A Panda of the plan file, without limits to speak of."""
    return {
        "urdf": "pybullet_data://franka_panda/panda.urdf",
        "base_pose": base,
        "joint_names": [f"panda_joint{i}" for i in range(1, 8)],
        "q_start": q.tolist(),
        "end_effector_link": "panda_hand",
        "T_link_ee": [0, 0, 0.105, 0, 0, 0, 1],
        "position_limits": [[-10.0] * 7, [10.0] * 7],
        "velocity_limits": [100.0] * 7,
        "acceleration_limits": [1e4] * 7,
        "gripper": {
            "joint_names": ["panda_finger_joint1", "panda_finger_joint2"],
            "per_joint": 0.5,
            "finger_links": ["panda_leftfinger", "panda_rightfinger"],
        },
    }


def wander(rng, pose: list[float], move: float, turn: float) -> np.ndarray:
    """Poses (N, 7) of a random walk."""
    p = np.array(pose[:3]) + np.cumsum(rng.uniform(-move, move, (SAMPLES, 3)), axis=0)
    R = Rotation.from_quat(pose[3:])
    turned = [R := Rotation.from_rotvec(v) * R for v in rng.uniform(-turn, turn, (SAMPLES, 3))]
    return np.column_stack([p, [r.as_quat() for r in turned]])


def carried(world: World) -> np.ndarray:
    """Poses (N, 7) of a body that the hand of the first robot carries."""
    R, p = world.state.links["one"]["panda_hand"]
    return np.column_stack([p + R @ [0.0, 0.0, 0.12], Rotation.from_matrix(R).as_quat()])


@pytest.fixture(scope="module", params=[(0.02, 0.1), (0.2, 0.4)], ids=["slow", "fast"])
def world(request):
    """Two arms, a body that the first one carries, three that move by themselves, and one that stands still."""
    step, turn = request.param
    rng = np.random.default_rng(3)
    places = {"one": plans.pose(0.0, 0.0, 0.0), "two": [1.0, 0.1, 0.0, 0.0, 0.0, 1.0, 0.0]}
    rest = np.array([0.0, 0.3, 0.0, -1.8, 0.0, 2.0, 0.8])
    joints = {name: rest + np.cumsum(rng.uniform(-step, step, (SAMPLES, 7)), axis=0) for name in places}
    bodies = [
        plans.box(name, size, (0.4, 0.1 * k, 0.5))
        for k, (name, size) in enumerate([("held", (0.05, 0.1, 0.2)), ("brick", (0.3, 0.05, 0.1))])
    ]
    bodies += [plans.box("rod", (0.02, 0.3), (0.5, 0.2, 0.4)) | {"shape": "cylinder"}]
    bodies += [plans.box("ball", (0.06,), (0.6, 0.2, 0.4)) | {"shape": "sphere"}]
    bodies += [plans.box("post", (0.1, 0.1, 0.5), (0.4, 0.3, 0.25), "fixed")]
    objects = {b["name"]: wander(rng, b["pose"], 0.1 * step, turn) for b in bodies[:-1]}
    board = plans.Storyboard((0.0, 0.0, 0.0), 0.04, bodies)
    plan = board.plan("", plans.goal("brick", (0.4, 0.1, 0.5)))
    plan["robots"] = {name: panda(at, joints[name][0]) for name, at in places.items()}
    plan["trajectory"] = {
        "time": [k * plans.DT for k in range(SAMPLES)],
        "joints": {name: q.tolist() for name, q in joints.items()},
        "gripper": {name: rng.uniform(0.0, 0.08, SAMPLES).tolist() for name in places},
        "objects": {name: poses.tolist() for name, poses in objects.items()},
    }
    end = (SAMPLES - 1) * plans.DT
    rows = {
        "start": 0.0,
        "end": end,
        "manipulator": "panda_hand",
        "object": None,
        "kind": "transit",
        "contact_pose": None,
    }
    plan["segments"] = [{**rows, "robot": name} for name in places]
    plan["trajectory"]["objects"]["held"] = carried(World(document.read(plan))).tolist()
    return World(document.read(plan))


def parts(world: World):
    """One part of each body, and of some links."""
    links = {"one": ("panda_link3", "panda_hand", "panda_leftfinger"), "two": ("panda_link0", "panda_link6")}
    arms = [world.parts_of(name, (link,))[0] for name, names in links.items() for link in names]
    return arms + [world.parts_of(name)[0] for name in world.document.bodies]


def fine(world: World, step: int):
    """The world at the ends of small intervals of a step."""
    return world.between(np.full(FINE + 1, step), np.arange(FINE + 1) / FINE)


def test_no_point_is_faster_or_bends_more_than_the_bounds(world):
    rng = np.random.default_rng(5)
    loose = []
    for frame, part in permutations(parts(world), 2):
        bound = world.relative_motion(frame, part)
        for step in rng.choice(SAMPLES - 1, 2, replace=False):
            R, p = rigid.relative(*frame.place(fine(world, step)), *part.place(fine(world, step)))
            points = rng.normal(size=(40, 3))
            points *= part.reach / np.linalg.norm(points, axis=1, keepdims=True)
            seen = np.einsum("nij,vj->nvi", R, points) + p[:, None]
            speed = FINE * np.linalg.norm(np.diff(seen, axis=0), axis=2).max()
            bend = FINE**2 * np.linalg.norm(np.diff(seen, 2, axis=0), axis=2).max()
            assert speed <= bound.speed[step] + ROUNDING
            assert bend <= bound.bend[step] + ROUNDING
            loose.append(bound.bend[step] / max(bend, ROUNDING) if bend > ROUNDING else 1.0)
    assert np.median(loose) < 8.0


def test_no_point_is_faster_or_bends_more_than_the_bounds_in_the_world(world):
    rng = np.random.default_rng(6)
    for part in parts(world):
        speed, bend = world.motion(part).speed(part.reach), world.motion(part).acceleration(part.reach)
        for step in range(SAMPLES - 1):
            R, p = part.place(fine(world, step))
            points = rng.normal(size=(20, 3))
            points *= part.reach / np.linalg.norm(points, axis=1, keepdims=True)
            seen = np.einsum("nij,vj->nvi", R, points) + p[:, None]
            assert FINE * np.linalg.norm(np.diff(seen, axis=0), axis=2).max() <= speed[step] + ROUNDING
            assert FINE**2 * np.linalg.norm(np.diff(seen, 2, axis=0), axis=2).max() <= bend[step] + ROUNDING


def test_separating_axes_bound_the_distance_between_samples(world):
    """With the normal that is measured at a sample, and with any other direction."""
    rng = np.random.default_rng(7)
    tight = []
    for a, b in permutations(parts(world), 2):
        gauge, axes = Gauge(a.solid, b.solid), SeparatingAxes(world, a, b)
        for step in rng.choice(SAMPLES - 1, 2, replace=False):
            one, other = Track(a, fine(world, step)), Track(b, fine(world, step))
            distance = min(gauge.distance(one.at(k), other.at(k)) for k in range(0, FINE + 1, 4))
            _, _, _, normal = gauge.witness(one.at(0), other.at(0))
            for direction in (normal, *rng.normal(size=(3, 3)) * 0.6):
                assert axes.bounds(direction, step, step, step + 1)[0] <= distance + ROUNDING
            tight.append(distance - axes.bounds(normal, step, step, step + 1)[0])
    assert np.median(tight) < 0.1


@pytest.mark.parametrize("normal", [(0.0, 0.0, 0.0), (np.nan, 0.0, 1.0)])
def test_a_direction_without_length_bounds_nothing(world, normal):
    a, b = parts(world)[-2:]
    assert np.all(SeparatingAxes(world, a, b).bounds(np.array(normal), 0, 0, 3) == -np.inf)


SOLIDS = {
    "box": solid("box", (0.1, 0.2, 0.3)),
    "cylinder": solid("cylinder", (0.05, 0.2)),
    "sphere": solid("sphere", (0.07,)),
    "capsule": solid("capsule", (0.04, 0.1)),
    "hull": hull(np.random.default_rng(5).normal(size=(40, 3)) * [0.03, 0.05, 0.08], "hull"),
}


@pytest.mark.parametrize("name", list(SOLIDS))
def test_support_along_a_direction_is_that_of_the_exact_shape(name):
    """No vertex reaches farther, and a ball that touches the shape there from outside is as far as that says."""
    shape, far = SOLIDS[name], 100.0
    reach = shape.support(DIRECTIONS)
    assert np.all((polytope_points(shape, np.eye(3), np.zeros(3)) @ DIRECTIONS.T).max(axis=0) <= reach + 1e-12)
    wall = solid("box", (far, far, 0.01))
    gauge = Gauge(shape, wall)
    for direction, expected in zip(DIRECTIONS[:40], reach, strict=False):
        R = Rotation.align_vectors([direction], [[0.0, 0.0, 1.0]])[0].as_matrix()
        at = transform(R, direction * 0.505)
        distance = gauge.distance(transform(np.eye(3), np.zeros(3)), at)
        assert 0.5 - distance == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("made", [plans.carry, plans.push, plans.tool_use])
def test_what_is_carried_or_slides_is_measured_at_few_samples(made, tmp_path):
    """One direction bounds the distance of bodies that touch while they move, also between the samples."""
    found = World(document.read(made(plans.write_gantry(tmp_path))))
    pairs = PairBuilder(found, set()).build()
    scan = Scan(found, Findings())
    measured = 0
    for pair in pairs:
        distance = pair.gauge.distance

        def count(*at, distance=distance):
            nonlocal measured
            measured += 1
            return distance(*at)

        pair.gauge.distance = count
    scan.run(pairs)
    assert scan.subdivisions == [] and not scan.findings.violations()
    assert measured < 15 * len(pairs) and measured < 2 * found.samples
    moving = [pair for pair in pairs if pair.motion.max() > limits.MOTION_BOUND]
    assert moving
