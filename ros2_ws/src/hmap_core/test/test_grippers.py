"""Grippers that slide, turn and follow: where the planner, the judge and PyBullet have them, and what they do."""

from dataclasses import replace

import numpy as np
import pytest
from gripper_fixtures import GRIPPERS, TASK, write_robot, write_task

from hmap_core import plan_file
from hmap_core.contacts.grasp_torque import weight_torque_ratio
from hmap_core.contacts.hand import align_pads, hand_of
from hmap_core.exceptions import InputError
from hmap_core.kinematics.arm import FINGER_TOLERANCE, load_arm
from hmap_core.planner import plan
from hmap_core.planner.sweep import robot_sweeps
from hmap_core.scenes import load_robot_model, load_scene
from hmap_core.simulation.client import BulletClient
from hmap_core.simulation.collision_pairs import ignored_pairs
from hmap_core.simulation.execute import execute
from hmap_core.simulation.world import SimulatedWorld
from hmap_core.transforms import apply, from_rpy, inverse, multiply, pose
from hmap_core.types import ContactKind, ContactPoint, Plan, RobotModel, Scene, Segment, SegmentKind, Trajectory
from hmap_core.validation import arm as judged
from hmap_core.validation import check
from hmap_core.validation.document import read

TURNING = ("four_bar", "xarm6")
ROUNDED = 2e-5  # m: what tables, and hulls with fewer vertices, are off


@pytest.fixture(scope="module")
def scenes(tmp_path_factory) -> dict[str, Scene]:
    """The task with every robot."""
    folder = tmp_path_factory.mktemp("robots")
    paths = {kind: write_task(folder, kind) for kind in GRIPPERS}
    for name in ("xarm6", "panda"):
        paths[name] = folder / f"{name}_task.yaml"
        paths[name].write_text(TASK.format(model=name))
    return {kind: load_scene(str(path), seed=0) for kind, path in paths.items()}


@pytest.fixture(scope="module")
def models(scenes) -> dict[str, RobotModel]:
    return {kind: scene.robots["arm"].model for kind, scene in scenes.items()}


def openings(model: RobotModel) -> np.ndarray:
    return np.linspace(model.gripper.min_opening, model.gripper.open_opening, 7)


def standing(scene: Scene) -> Plan:
    """A plan in which nothing happens."""
    arm, time = scene.robots["arm"], np.array([0.0, 0.02])
    movable = {name: np.tile(body.pose, (2, 1)) for name, body in scene.bodies.items() if body.kind != "fixed"}
    opened = np.full(2, arm.model.gripper.open_opening)
    return Plan(
        scene,
        Trajectory(time, {"arm": np.tile(arm.q, (2, 1))}, {"arm": opened}, movable),
        (Segment(0.0, 0.02, "arm", arm.model.end_effector_link, None, SegmentKind.TRANSIT),),
        np.zeros((0, 7)),
        {},
    )


@pytest.mark.parametrize("kind", [*GRIPPERS, "xarm6"])
def test_the_gap_between_the_fingers_is_the_opening(models, kind):
    arm = load_arm(models[kind])
    for opening in openings(models[kind]):
        assert arm.finger_gap(opening) == pytest.approx(opening, abs=2 * FINGER_TOLERANCE + ROUNDED)


def test_a_gap_that_grows_otherwise_than_the_opening_is_refused(tmp_path):
    path = write_robot(tmp_path, "slide")
    path.write_text(path.read_text().replace("[-0.5, 0.5]", "[-0.4, 0.4]"))
    with pytest.raises(InputError, match="0.0800 m, the gap of finger_links grows by 0.0640 m in the URDF"):
        load_arm(load_robot_model(str(path)))


@pytest.mark.parametrize("kind", [*GRIPPERS, "xarm6", "panda"])
def test_joints_and_openings_belong_to_each_other(models, kind):
    gripper, step = models[kind].gripper, 1e-5
    for opening in openings(models[kind]):
        assert gripper.opening_at(gripper.joints(opening)) == pytest.approx(opening, abs=1e-9)
        if gripper.min_opening < opening < gripper.open_opening:
            slope = np.subtract(gripper.joints(opening + step), gripper.joints(opening - step)) / (2.0 * step)
            np.testing.assert_allclose(gripper.joints_per_opening(opening), slope, rtol=0.02)


def test_a_finger_may_open_towards_negative_values_and_start_off_zero(models):
    gripper = models["slide"].gripper
    np.testing.assert_allclose(gripper.joints(0.0), [-0.0027, 0.0027])
    np.testing.assert_allclose(gripper.joints(0.08), [-0.0427, 0.0427])
    assert gripper.tip_offset == pytest.approx(0.015)


def test_what_a_file_leaves_out_is_as_the_urdf_has_it(models):
    gripper = models["four_bar"].gripper
    assert (gripper.min_opening, gripper.open_opening) == (gripper.openings[0], gripper.openings[-1])
    assert gripper.max_opening == pytest.approx(gripper.open_opening - 0.004)
    assert gripper.tip_offset == pytest.approx(0.015, abs=1e-5)
    # the knuckles lean by 0.6 rad where they are open and by -0.1 where they are closed
    assert gripper.reach_at(gripper.open_opening) == pytest.approx(0.06 * (np.cos(0.6) - np.cos(0.1)), abs=1e-4)


def test_a_gripper_is_as_fast_as_its_joints(tmp_path):
    path = write_robot(tmp_path, "slide")
    urdf = tmp_path / "slide.urdf"
    urdf.write_text(urdf.read_text().replace('velocity="2"', 'velocity="0.02"'))
    assert load_robot_model(str(path)).gripper.speed == pytest.approx(0.04)


class Bullet:
    """A robot in PyBullet whose gripper has one joint that all others follow one to one."""

    def __init__(self, model: RobotModel):
        self.client, self.model = BulletClient(), model
        self.body = self.client.loadURDF(str(model.urdf), useFixedBase=True)
        infos = [self.client.getJointInfo(self.body, i) for i in range(self.client.getNumJoints(self.body))]
        self.link = {info[12].decode(): info[0] for info in infos}
        self.following = [info[0] for info in infos if info[2] == 0 and info[1].decode() not in model.joint_names]

    def place(self, opening: float) -> None:
        for joint in self.following:
            self.client.resetJointState(self.body, joint, self.model.gripper.joints(opening)[0])

    def pose(self, link: str) -> np.ndarray:
        state = self.client.getLinkState(self.body, self.link[link], computeForwardKinematics=True)
        return pose(state[4], state[5])


@pytest.mark.parametrize("kind", TURNING)
def test_linkages_turn_as_in_pybullet(scenes, models, kind):
    """The planner's hulls move with the link as PyBullet has it, and so do the judge's links; sweeps have them too."""
    arm, theirs = load_arm(models[kind]), Bullet(models[kind])
    data = read(plan_file.to_dict(standing(scenes[kind])))
    judge = judged.build(data.robots["arm"])
    (R, p), q = arm.frames(np.zeros(arm.n)), np.zeros((1, arm.n))
    hand = [hull for hull in arm.hulls if hull.motion is not None]
    assert len({hull.link for hull in hand}) == 6 and sum(hull.finger for hull in hand) == 2
    theirs.place(models[kind].gripper.min_opening)
    in_link = [
        apply(inverse(theirs.pose(h.link)), h.at(models[kind].gripper.min_opening) @ R[-1].T + p[-1]) for h in hand
    ]
    for opening in openings(models[kind]):
        theirs.place(opening)
        frames = judge.frames(judge.values(q, np.array([opening])))
        for hull, own in zip(hand, in_link, strict=True):
            T = theirs.pose(hull.link)
            np.testing.assert_allclose(hull.at(opening) @ R[-1].T + p[-1], apply(T, own), atol=ROUNDED)
            np.testing.assert_allclose(frames[hull.link][1][0], T[:3], atol=ROUNDED)
            np.testing.assert_allclose(frames[hull.link][0][0], apply(T, np.eye(3)).T - T[:3, None], atol=1e-4)
            centre, bound = hull.sphere_at(opening)
            assert np.linalg.norm(hull.at(opening) - centre, axis=1).max() + hull.radius <= bound + 1e-9
            assert (
                np.linalg.norm(hull.at(opening), axis=1).max() + hull.radius <= hull.extent(models[kind].gripper) + 1e-6
            )
    swept = robot_sweeps(scenes[kind].robots["arm"], q, np.array([0.03]))[-1]
    np.testing.assert_allclose(swept.shapes.vertices, np.concatenate([hull.at(0.03) for hull in hand]))


@pytest.mark.parametrize("kind", TURNING)
def test_a_grasp_puts_the_pads_where_it_was_sampled(models, kind):
    """Wherever the fingers are drawn back to at an opening, the hand goes as much farther."""
    arm, gripper = load_arm(models[kind]), models[kind].gripper
    T = from_rpy((0.1, 0.2, 0.3), (np.pi, 0.1, 0.4))
    closed = apply(T, [0.0, 0.0, arm.finger_vertices(gripper.min_opening)[:, 2].max()])
    for opening in (0.02, 0.06):
        grasp = ContactPoint(ContactKind.GRASP, T, T[:3], np.array([0.0, 1.0, 0.0]), opening, np.array([0.0, 0, 1]))
        push = replace(grasp, kind=ContactKind.PUSH)
        (moved, same) = align_pads([grasp, push], gripper)
        tip = apply(moved.T_obj_ee, [0.0, 0.0, arm.finger_vertices(opening)[:, 2].max()])
        np.testing.assert_allclose(tip, closed, atol=ROUNDED)
        np.testing.assert_array_equal(same.T_obj_ee, T)
    assert align_pads([grasp], replace(gripper, tips=()))[0] is grasp


def test_rotation_between_the_pads_is_measured_at_the_pads(scenes, models):
    """A brick held at its middle does not turn, wherever the hand's frame is for that."""
    gripper, body = models["four_bar"].gripper, scenes["four_bar"].bodies["brick"]
    T = from_rpy((0.0, 0.0, 0.0), (0.0, np.pi / 2, 0.0))
    grasp = ContactPoint(ContactKind.GRASP, T, T[:3], np.array([0.0, 1.0, 0.0]), 0.075, np.array([0.0, 0.0, 1.0]))
    up = np.array([0.0, 0.0, 1.0])
    assert weight_torque_ratio(body, align_pads([grasp], gripper), gripper, up)[0] == pytest.approx(0.0, abs=1e-9)
    assert weight_torque_ratio(body, [grasp], gripper, up)[0] > 0.05


def test_the_palm_is_where_the_hand_is_nearest_between_the_fingers(models, scenes):
    hands = {kind: hand_of(scene.robots["arm"]) for kind, scene in scenes.items()}
    assert hands["panda"].palm_clearance == pytest.approx(0.039)
    assert hands["slide"].palm_clearance == pytest.approx(0.115 - 0.08)
    # an open knuckle reaches farther between the fingers than the palm does
    assert 0.03 < hands["four_bar"].palm_clearance < 0.1447 - 0.0102 - 0.05
    assert hands["four_bar"].closed == models["four_bar"].gripper.min_opening


@pytest.mark.parametrize("kind", TURNING)
def test_pairs_within_a_gripper_need_no_check(models, kind):
    pairs = ignored_pairs(models[kind], 30, np.random.default_rng(0))
    hand = {h.link for h in load_arm(models[kind]).hulls if h.motion is not None}
    assert "gripper" in pairs.values()
    assert {frozenset(pair) for pair in pairs} >= {frozenset((a, b)) for a in hand for b in hand if a < b}
    assert all(set(pair) <= hand | {models[kind].end_effector_link} for pair, why in pairs.items() if why == "gripper")


@pytest.mark.parametrize("kind", [*GRIPPERS, "xarm6"])
def test_a_simulated_gripper_goes_to_an_opening_and_holds_what_is_between(scenes, kind):
    """It opens and closes to the millimetre, stops at a brick, and follows the brick's width with both fingers."""
    scene = scenes[kind]
    with SimulatedWorld(scene) as world:
        robot, gripper = world.robot("arm"), scene.robots["arm"].model.gripper
        for opening in (0.03, 0.07):
            for _ in range(240):
                robot.set_gripper(opening, gripper.force)
                world.step()
            assert robot.gripper_state()[0] == pytest.approx(opening, abs=1e-3)
        brick = scene.bodies["brick"]
        T = multiply(robot.end_effector_pose(), pose((0.0, 0.0, gripper.reach_at(brick.shapes[0].size[1]))))
        for step in range(240):
            if step < 120:  # until it is held
                world.move_body("brick", T)
            robot.set_gripper(gripper.min_opening, gripper.force)
            world.step()
        assert robot.gripper_state()[0] == pytest.approx(brick.shapes[0].size[1], abs=2e-3)
        assert np.linalg.norm(world.body_pose("brick")[:3] - T[:3]) < 5e-3
        touching = {c.link_b for c in world.contacts("brick") if c.b == "arm"} & set(gripper.finger_links)
        assert touching == set(gripper.finger_links)


@pytest.mark.parametrize(("kind", "seed"), [("four_bar", 0), ("four_bar", 1), ("slide", 0), ("xarm6", 2)])
def test_a_brick_is_put_over_a_wall(tmp_path, kind, seed):
    """Planned, valid, and executed under dynamics."""
    path = write_task(tmp_path, kind) if kind in GRIPPERS else tmp_path / "task.yaml"
    if kind not in GRIPPERS:
        path.write_text(TASK.format(model=kind))
    made = plan(load_scene(str(path), seed=seed), seed=seed)
    assert any(segment.kind == SegmentKind.GRASP for segment in made.segments)
    plan_file.save(made, tmp_path / "plan.json")
    again = plan_file.load(tmp_path / "plan.json")
    assert again.scene.robots["arm"].model.gripper.joints(0.05) == pytest.approx(
        made.scene.robots["arm"].model.gripper.joints(0.05), abs=1e-7
    )
    report = execute(again)
    assert report.solved, report.reason


@pytest.fixture(scope="module")
def document(scenes) -> dict:
    return plan_file.to_dict(plan(scenes["four_bar"], seed=0))


def test_the_judge_takes_openings_from_the_file_and_links_from_the_urdf(document):
    gripper = document["robots"]["arm"]["gripper"]
    assert check(document).valid
    for key, value in (("openings", [v + 0.004 for v in gripper["openings"]]), ("at_zero", [0.6])):
        wrong = document | {"robots": {"arm": document["robots"]["arm"] | {"gripper": gripper | {key: value}}}}
        kinds = {violation.kind for violation in check(wrong).violations}
        assert kinds & {"contact_missing", "penetration"}, kinds


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("openings", [0.01], "openings"),
        ("openings", [0.0, 0.02, 0.01], "openings"),
        ("per_joint", [1.0, 2.0], "per_joint"),
        ("at_zero", [1.0, 2.0], "at_zero"),
    ],
)
def test_a_plan_file_with_a_wrong_gripper_is_refused(document, key, value, says):
    gripper = document["robots"]["arm"]["gripper"] | {key: value}
    wrong = document | {"robots": {"arm": document["robots"]["arm"] | {"gripper": gripper}}}
    for reader in (plan_file.from_dict, check):
        with pytest.raises(InputError, match=says):
            reader(wrong)
