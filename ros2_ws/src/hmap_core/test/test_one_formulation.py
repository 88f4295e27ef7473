"""The planner and the benchmark solve the same formulation: for the same motion they build the same problem."""

from collections import Counter

import numpy as np
import pytest
from planner_fixtures import carry
from skeleton_fixtures import TIP, contact

from hmap_core.benchmark import hmap_side
from hmap_core.benchmark.instances import Attachment, MotionInstance, Target
from hmap_core.komo.clearances import VERIFIED_ONLY, Clearances
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.segment import (
    APPROACH_STEPS,
    Phase,
    approach_skeleton,
    free_opening,
    retreated,
    segment_skeleton,
)
from hmap_core.komo.skeleton_problem import SkeletonProblem
from hmap_core.komo.transcription import KomoProblem
from hmap_core.planner import plan
from hmap_core.planner.interfaces import RobotContact
from hmap_core.planner.segments.contact_segment import ContactSegment
from hmap_core.transforms import interpolate, multiply, pose
from hmap_core.types import ContactKind

TRANSIT_STEPS = 9
HEIGHT = 0.08  # m of the brick
CONTACTS = {
    "grasp": contact(ContactKind.GRASP, (0, 0, -1), (0, 1, 0), (0, 0, 0.02), 0.05),
    "touch": contact(ContactKind.TOUCH, (0, 0, -1), (0, 1, 0), (0, 0, HEIGHT / 2 + TIP), 0.0),
}


@pytest.fixture
def scene(tmp_path):
    return carry(tmp_path)


def object_path(scene, count=7):
    """Dense poses (count, 7) of the brick, away from the wall."""
    return interpolate(scene.bodies["brick"].pose, pose((0.5, -0.3, 0.04)), np.linspace(0.0, 1.0, count))


def planners(scene, kind: str) -> ContactSegment:
    poses = object_path(scene)
    keyframes = np.tile(scene.robots["arm"].q, (len(poses), 1))
    robot_contact = RobotContact("arm", CONTACTS[kind], len(poses) - 1, keyframes)
    return ContactSegment(scene, scene.start_state(), "brick", robot_contact, poses)


def instance(scene, kind: str, object_poses: np.ndarray) -> MotionInstance:
    """The same motion as the benchmark says it: where the hand is at each step after the transit."""
    own = CONTACTS[kind]
    shares = np.arange(APPROACH_STEPS, -1, -1) / APPROACH_STEPS
    back = [multiply(object_poses[0], retreated(own, share)) for share in shares]
    targets = [Target("arm", Phase.TRANSIT, back[0])]
    targets += [Target("arm", Phase.APPROACH, T, APPROACH_STEPS - k) for k, T in enumerate(back[1:], 1)]
    steps = (TRANSIT_STEPS, APPROACH_STEPS)
    if len(object_poses) > 1:
        count = len(object_poses) - 1
        targets += [
            Target("arm", Phase.HOLD, multiply(T, own.T_obj_ee), count - k) for k, T in enumerate(object_poses[1:], 1)
        ]
        steps = (*steps, count)
    held = Attachment("arm", "brick", Phase.APPROACH.end, own.T_obj_ee, contact=own)
    opening = {"arm": free_opening(scene.robots["arm"], own)}
    attachments = (held,) if len(object_poses) > 1 else ()
    return MotionInstance(scene, opening, steps, tuple(targets), attachments)


def benchmarks(scene, kind: str, object_poses: np.ndarray) -> SkeletonProblem:
    asked = instance(scene, kind, object_poses)
    return hmap_side.problem(asked, hmap_side.prepare(asked))


def rounded(hull) -> tuple[bytes, float]:
    """Vertices and radius of a shape, so that equal ones compare equal."""
    return (np.round(hull[0], 7) + 0.0).tobytes(), hull[1]


def pairs(problem: KomoProblem) -> dict[int, Counter]:
    """Phase, or VERIFIED_ONLY -> the pairs that count there: parts, frames, shapes, minimum distances."""
    model, found = problem.collisions, {}
    for a, b, min_distance, phases in model.pairs:
        shapes = tuple(
            (model.names[s], model.frames[s], np.round(model.hulls[s][0], 9).tobytes(), model.hulls[s][1])
            for s in (a, b)
        )
        for bit in (*range(len(problem.steps_per_phase)), VERIFIED_ONLY):
            if phases & (bit if bit == VERIFIED_ONLY else 1 << bit):
                found.setdefault(bit, Counter())[*shapes, round(min_distance, 12)] += 1
    return found


def objectives(problem: KomoProblem, path: np.ndarray, start: np.ndarray) -> list[tuple]:
    """Step, component, feature, type, value and Jacobian of every component, by step."""
    linear = problem.linearise(path, start)
    rows = [
        (step, component, problem.objectives[k].feature.name, problem.objectives[k].type, value, row)
        for (k, step, component), value, row in zip(linear.rows, linear.values, linear.jacobian, strict=True)
    ]
    return sorted(rows, key=lambda row: row[:2])


def assert_same(ours: SkeletonProblem, theirs: SkeletonProblem) -> None:
    assert tuple(ours.steps_per_phase) == tuple(theirs.steps_per_phase)
    assert pairs(ours) == pairs(theirs)
    rng, start = np.random.default_rng(0), ours.workspace.start
    path = start + rng.uniform(-0.3, 0.3, (ours.steps, len(start)))
    for a, b in zip(objectives(ours, path, start), objectives(theirs, path, start), strict=True):
        assert a[:4] == b[:4]
        assert a[4] == pytest.approx(b[4], abs=1e-9)
        np.testing.assert_allclose(a[5], b[5], atol=1e-9)


@pytest.mark.parametrize("kind", CONTACTS)
def test_a_segment_is_the_same_problem_for_planner_and_benchmark(scene, kind):
    """Up to where the object is let go; the retreat follows no target of the benchmark."""
    own = planners(scene, kind)
    skeleton = segment_skeleton("arm", "brick", own.contact, own.poses, leaves=False)
    ours = own.problem(skeleton, TRANSIT_STEPS)
    theirs = benchmarks(scene, kind, own.poses)
    assert len(pairs(ours)) == len(ours.steps_per_phase) + 1  # each phase, and what counts in verification only
    assert_same(ours, theirs)


def test_the_way_to_a_contact_is_the_beginning_of_the_segment(scene):
    own = planners(scene, "grasp")
    whole = own.problem(segment_skeleton("arm", "brick", own.contact, own.poses), TRANSIT_STEPS)
    way = own.problem(approach_skeleton("arm", "brick", own.contact, own.T_start), TRANSIT_STEPS)
    assert way.steps_per_phase == whole.steps_per_phase[:2]
    path = np.tile(whole.workspace.start, (whole.steps, 1))
    start = whole.workspace.start
    first = [row for row in objectives(whole, path, start) if row[0] < way.steps]
    for a, b in zip(first, objectives(way, path[: way.steps], start), strict=True):
        assert a[:4] == b[:4]
        assert a[4] == pytest.approx(b[4], abs=1e-9)
    own_pairs, all_pairs = pairs(way), pairs(whole)
    assert all(own_pairs[k] == all_pairs[k] for k in (Phase.TRANSIT, Phase.APPROACH))


@pytest.mark.parametrize("kind", CONTACTS)
def test_shared_models_say_what_the_whole_segment_says(scene, kind):
    """Contact checks use parts of the collision model of the segment, each in its own phases."""
    poses, own = object_path(scene), CONTACTS[kind]
    manipulation = Manipulation(scene, scene.start_state(), "arm", "brick")
    whole = manipulation.problem(segment_skeleton("arm", "brick", own, poses), (4, 4, len(poses) - 1, 4), None)
    expected = pairs(whole)
    parts = {
        Phase.TRANSIT: manipulation.coming_collisions(own, poses[0]),
        Phase.APPROACH: manipulation.coming_collisions(own, poses[0]),
        Phase.HOLD: manipulation.carrying_collisions(own),
        Phase.RETREAT: manipulation.leaving_collisions(own, poses[-1]),
    }
    for phase, model in parts.items():
        assert pairs(whole.among(model))[phase] == expected[phase]
    assert pairs(whole.among(manipulation.collisions(own, poses[0], poses[-1]))) == expected


def test_every_motion_of_a_plan_is_solved_as_a_skeleton(scene, monkeypatch):
    solved, solve = [], KomoProblem.solve

    def record(problem, *arguments, **options):
        solved.append(problem)
        return solve(problem, *arguments, **options)

    monkeypatch.setattr(KomoProblem, "solve", record)
    plan(scene, seed=1)
    assert solved and all(isinstance(problem, SkeletonProblem) for problem in solved)
    for problem in solved:
        derived = problem.among(Clearances(problem.timeline).model())
        assert pairs(problem) == pairs(derived)
