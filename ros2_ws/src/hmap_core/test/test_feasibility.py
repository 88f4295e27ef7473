"""Which contacts a robot can take, and how far they serve: a box on a table, with and without a wall beside it."""

from dataclasses import replace

import numpy as np
import pytest
from planner_fixtures import carry
from scipy.spatial.transform import Rotation

from hmap_core.contacts.feasibility import (
    MAX_JUMP,
    alike,
    carried,
    draw_back,
    feasible_contacts,
    ik_problem,
    reach_bounds,
    reachable,
)
from hmap_core.komo.manipulation import Manipulation
from hmap_core.komo.path_collisions import path_violations
from hmap_core.komo.segment import GRASP_RETREAT, Phase, bit, free_opening, retreated
from hmap_core.komo.shapes import body_set
from hmap_core.planner import ContactSearchQuery, local_components
from hmap_core.planner.contact_finder import contact_score
from hmap_core.planner.protocols import ContactQuery
from hmap_core.transforms import apply, distance, from_matrix, interpolate, inverse, multiply, pose
from hmap_core.types import ContactKind, ContactPoint

HALF = np.array([0.025, 0.025, 0.04])  # of the brick in planner_fixtures


def grasp(approach, closing, offset=(0.0, 0.0, 0.0)) -> ContactPoint:
    """A grasp of the brick; ``approach`` and ``closing`` are unit directions in its frame."""
    z, y = np.asarray(approach, float), np.asarray(closing, float)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.c_[np.cross(y, z), y, z], offset
    point = np.asarray(offset) + y * (HALF @ np.abs(y))
    return ContactPoint(ContactKind.GRASP, from_matrix(matrix), point, y, 0.05, np.array([0.0, 0.0, 1.0]))


FROM_ABOVE = [
    grasp((0, 0, -1), (0, 1, 0), (0, 0, 0.02)),
    grasp((0, 0, -1), (1, 0, 0), (0, 0, 0.02)),
    grasp((0, 0, -1), (0, -1, 0), (0, 0, 0.02)),
]
FROM_BELOW = grasp((0, 0, 1), (0, 1, 0), (0, 0, -0.02))
SIDEWAYS = grasp((0, 1, 0), (1, 0, 0))  # the hand comes from -y


@pytest.fixture
def scene(tmp_path):
    return carry(tmp_path)


def manipulation(scene) -> Manipulation:
    return Manipulation(scene, scene.start_state(), "arm", "brick")


def line(scene, to=(0.5, -0.3, 0.04), count=12):
    start = scene.bodies["brick"].pose
    return interpolate(start, pose(to), np.linspace(0.0, 1.0, count))


def anywhere(poses):
    """The object may be let go at every pose."""
    return np.ones(len(poses), bool)


def least_clear(task, cols, path, phase):
    """Worst violation (m) of the minimum distances of a phase at configurations."""
    masks = np.full(len(path), bit(phase), np.int64)
    return path_violations(np.ascontiguousarray(path), masks, task.model.chain, cols, -0.05)[0].max()


def test_grasps_from_above_work_and_from_below_do_not(scene):
    contacts = [*FROM_ABOVE, FROM_BELOW]
    task, poses = manipulation(scene), line(scene)
    found = feasible_contacts(task, contacts, poses, anywhere(poses), np.random.default_rng(0), 2, 4)
    assert {f.index for f in found} == {0, 1, 2}
    for f in found:
        reach = len(f.keyframes) - 1
        assert reach == len(poses) - 1
        cols = task.collisions(contacts[f.index], poses[0], poses[reach]).arrays()
        assert least_clear(task, cols, f.keyframes, Phase.HOLD) <= 1e-4
        assert np.abs(np.diff(f.keyframes, axis=0)).max() <= MAX_JUMP
        for q, T_obj in zip(f.keyframes, poses, strict=False):
            T_ee = multiply(scene.robots["arm"].base_pose, task.arm.end_effector(q))
            assert max(distance(T_ee, multiply(T_obj, contacts[f.index].T_obj_ee))) < 1e-4


def test_an_object_is_let_go_only_where_it_may_be(scene):
    task, poses = manipulation(scene), line(scene)
    release = np.arange(len(poses)) % 5 == 2  # 2, 7
    found = feasible_contacts(task, FROM_ABOVE, poses, release, np.random.default_rng(0), 2, 4)
    assert {len(f.keyframes) - 1 for f in found} == {7}
    nowhere = np.arange(len(poses)) < 2
    assert not feasible_contacts(task, FROM_ABOVE, poses, nowhere, np.random.default_rng(0), 2, 4)


def test_a_wall_blocks_the_side_that_it_is_on(tmp_path):
    """Between wall and box there is no room for a hand: 2 cm here, 35 cm there; both are high above the table."""
    free = manipulation(carry(tmp_path, wall=0.6, start=(0.5, 0.4, 0.3)))
    blocked = manipulation(carry(tmp_path, wall=0.6, start=(0.5, 0.055, 0.3)))
    for task, expected in ((free, True), (blocked, False)):
        place = task.scene.bodies["brick"].pose[None]
        assert (reach_bounds(task, [SIDEWAYS], place)[0] == 0) == expected
        assert reachable(task, [SIDEWAYS], place[0], np.random.default_rng(0))[0][0] <= expected
    low = manipulation(carry(tmp_path, wall=0.05, start=(0.5, 0.055, 0.04)))
    place = low.scene.bodies["brick"].pose[None]
    assert reach_bounds(low, [FROM_ABOVE[1]], place)[0] == 0  # fingers beside it, along the wall, the hand over it


def test_the_hand_alone_reaches_at_least_as_far_as_the_robot(tmp_path):
    """An upper bound: whatever the arm can do, the first filter must let through."""
    rng = np.random.default_rng(1)
    for wall in (0.05, 0.3):
        scene = carry(tmp_path, wall=wall)
        task, poses = manipulation(scene), line(scene, (0.5, 0.15, 0.04), 20)  # through the wall
        contacts = [
            grasp(R[:, 2], R[:, 1], offset)
            for R, offset in zip(random_rotations(rng, 40), rng.uniform(-0.4, 0.4, (40, 3)) * HALF, strict=True)
        ] + FROM_ABOVE
        bound = reach_bounds(task, contacts, poses)
        assert (bound < len(poses) - 1).any()
        for k, contact in enumerate(contacts):
            ok, q = reachable(task, [contact], poses[0], rng)
            if not ok[0]:
                continue
            assert bound[k] >= 0
            assert len(carried(task, contact, q[0], poses, anywhere(poses))) - 1 <= bound[k]


def random_rotations(rng, count):
    toward = [(0, 0, -1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)]
    out = []
    for _ in range(count):
        z = np.array(toward[rng.integers(5)], float)
        y = np.array([0, 0, 1.0]) if z[2] == 0 else np.array([1.0, 0, 0])
        R = np.c_[np.cross(y, z), y, z]
        out.append(Rotation.from_rotvec(rng.normal(size=3) * 0.2).as_matrix() @ R)
    return out


def test_what_is_out_of_reach_is_not_found(scene):
    task = manipulation(scene)
    far = np.array([pose((1.5, 0.0, 0.04))])
    assert not reachable(task, FROM_ABOVE, far[0], np.random.default_rng(0))[0].any()
    away = line(scene, (1.6, -0.15, 0.04), 40)
    found = feasible_contacts(task, FROM_ABOVE, away, anywhere(away), np.random.default_rng(0), 2, 4)
    assert found and all(2 <= len(f.keyframes) - 1 < 39 for f in found)


def test_the_bound_ends_where_the_arm_is_too_short(scene):
    task, away = manipulation(scene), line(scene, (1.6, -0.15, 0.04), 40)
    bound = reach_bounds(task, FROM_ABOVE, away)
    assert (bound < 39).all()
    for k, contact in enumerate(FROM_ABOVE):
        beyond = multiply(multiply(away[bound[k] + 3], contact.T_obj_ee), inverse(task.T_tip_ee))
        base = scene.robots["arm"].base_pose
        assert np.linalg.norm(beyond[:3] - apply(base, task.arm.p_joint[0])) > task.arm.span
    beside = feasible_contacts(task, FROM_ABOVE, away, anywhere(away), np.random.default_rng(0), 2, 4)
    assert all(len(found.keyframes) - 1 <= bound[found.index] for found in beside)
    assert (reach_bounds(task, FROM_ABOVE, away[-3:]) == -1).all()


def test_drawing_back_is_straight_and_free(scene):
    task, contact = manipulation(scene), FROM_ABOVE[0]
    T = scene.bodies["brick"].pose
    ok, q = reachable(task, [contact], T, np.random.default_rng(0))
    assert ok[0]
    collisions = task.coming_collisions(contact, T)
    path = draw_back(task, ik_problem(task, collisions, Phase.APPROACH), contact, T, q[0])
    base = scene.robots["arm"].base_pose
    heights = [multiply(base, task.arm.end_effector(x))[2] for x in [q[0], *path]]
    np.testing.assert_allclose(np.diff(heights), GRASP_RETREAT / 4, atol=1e-4)
    assert least_clear(task, collisions.arrays(), path, Phase.APPROACH) <= 1e-4
    assert len(draw_back(task, ik_problem(task, collisions, Phase.APPROACH), contact, pose((2, 0, 0)), q[0])) == 0


def test_collision_pairs_say_what_may_touch_in_each_phase(scene):
    """The fingers may be at the box while they hold it, and must keep away in transit."""
    task, contact = manipulation(scene), FROM_ABOVE[0]
    T = scene.bodies["brick"].pose
    cols = task.collisions(contact, T, T)
    fingers = [f"arm/{link}" for link in ("panda_leftfinger", "panda_rightfinger")]
    phases = {}
    for a, b, _, mask in cols.pairs:
        names = {cols.names[a], cols.names[b]}
        if "brick" in names:
            phases[(names - {"brick"}).pop()] = phases.get((names - {"brick"}).pop(), 0) | mask
    assert all(phases[f] & bit(Phase.TRANSIT, Phase.APPROACH) for f in fingers)
    assert all(not phases[f] & bit(Phase.HOLD) for f in fingers)
    assert phases["arm/panda_link5"] & bit(Phase.HOLD)
    assert not phases["table"] & bit(*Phase)  # the carried object counts where paths are verified, only there
    assert free_opening(scene.robots["arm"], contact) == pytest.approx(0.066)
    np.testing.assert_allclose(
        apply(inverse(contact.T_obj_ee), retreated(contact)[:3]), (0, 0, -GRASP_RETREAT), atol=1e-12
    )


def test_what_is_held_moves_no_faster_than_the_model_says(tmp_path):
    """A motion bound that forgot the attached object would skip checks of it."""
    rng = np.random.default_rng(2)
    task = manipulation(carry(tmp_path))
    contact = grasp((0, 0, -1), (0, 1, 0), (0.4, 0, 0))  # as if it were long
    T = task.scene.bodies["brick"].pose
    cols = task.collisions(contact, T, T).arrays()
    held = [s for s in range(len(cols.frame)) if cols.frame[s] == task.tip and cols.speed[s] > 1.0]
    assert len(held) == len(body_set(task.scene.bodies["brick"]))
    chain = task.model.chain
    for k in range(200):
        q = rng.uniform(chain.lower, chain.upper)
        dq = 0.01 * (np.eye(7)[k % 7] if k % 2 else rng.normal(size=7))
        (Ra, pa), (Rb, pb) = task.arm.frames(q), task.arm.frames(q + dq)
        for s in range(len(cols.frame)):
            f, V = cols.frame[s], cols.vertices[cols.start[s] : cols.start[s + 1]]
            if f:
                moved = np.linalg.norm(V @ (Rb[f] - Ra[f]).T + pb[f] - pa[f], axis=1).max()
                assert moved <= cols.speed[s] * (chain.reach @ np.abs(dq)) + 1e-12


def test_contacts_that_open_alike_share_a_model():
    narrow = grasp((0, 0, -1), (0, 1, 0))
    wide = ContactPoint(ContactKind.GRASP, narrow.T_obj_ee, narrow.point, narrow.normal, 0.06, narrow.approach)
    assert sorted(map(tuple, alike([narrow, wide, narrow]))) == [(0, 2), (1,)]


def test_contacts_are_found_with_the_highest_score_first(scene):
    finder = local_components().contacts
    query = ContactSearchQuery(scene, scene.start_state(), "brick", line(scene), ("arm",), None, 10, 3)
    found = finder.find_contacts(query)
    assert found
    values = [contact_score(scene, c) for c in found]
    assert values == sorted(values, reverse=True)
    again = finder.find_contacts(query)
    assert [c.reach for c in found] == [c.reach for c in again]
    for a, b in zip(found, again, strict=True):
        np.testing.assert_array_equal(a.keyframes, b.keyframes)


def test_a_push_ends_where_the_object_leaves_its_support(scene):
    """A level path of the object alone may lead over a gap, where it cannot be pushed."""
    task, poses = manipulation(scene), line(scene, (0.5, -0.05, 0.04))
    query = ContactQuery(scene, task.state, "brick", poses, "arm", np.random.default_rng(0))
    proposed = [c for batch in local_components().proposer.propose(query) for c in batch.contacts]
    pushes = [contact for contact in proposed if contact.kind == ContactKind.PUSH]
    assert reach_bounds(task, pushes, poses).max() == len(poses) - 1
    table = scene.bodies["table"]
    edge = pose((*table.pose[:1], poses[5, 1] - 1.2, table.pose[2]))  # the middle of the brick passes it at pose 5
    cut = replace(scene, bodies=scene.bodies | {"table": replace(table, pose=edge)})
    assert 0 < reach_bounds(manipulation(cut), pushes, poses).max() <= 5


def test_a_far_swing_is_replaced_by_a_configuration_near_the_arm(scene):
    poses = line(scene)
    task = manipulation(scene)

    def found() -> np.ndarray:
        contacts = feasible_contacts(task, FROM_ABOVE[2:], poses, anywhere(poses), np.random.default_rng(0), 2, 1)
        return contacts[0].keyframes

    from_home = found()
    others = (reachable(task, FROM_ABOVE[2:], poses[0], np.random.default_rng(k), from_home=False) for k in range(20))
    far = (q[0] for ok, q in others if ok[0] and np.abs(q[0] - from_home[0]).max() > 2.0)
    task.state.q["arm"] = next(
        q for q in far if len(carried(task, FROM_ABOVE[2], q, poses, anywhere(poses))) == len(poses)
    )
    nearer = found()
    assert len(nearer) == len(from_home) == len(poses)
    assert np.abs(nearer[0] - task.state.q["arm"]).max() < 0.5
    hands = [task.arm.end_effector(q) for q in (nearer[0], from_home[0])]
    np.testing.assert_allclose(hands[0], hands[1], atol=1e-3)
