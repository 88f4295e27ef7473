"""The simulated world: bodies, robots, contacts, state, cameras."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from simulation_fixtures import HOME, box, panda_model, scene, table

from hmap_core import transforms
from hmap_core.exceptions import Code, InputError
from hmap_core.simulation import bodies
from hmap_core.simulation.camera import intrinsics
from hmap_core.simulation.settings import GRAVITY, RENEWAL, RobotSettings
from hmap_core.simulation.world import SimulatedWorld
from hmap_core.types import Body, BodyKind, Camera, Robot, SceneState, Shape, ShapeKind

DENSE = 200_000  # random points for volumes and moments


def run(world: SimulatedWorld, seconds: float) -> None:
    for _ in range(round(seconds / world.dt)):
        world.step()


def tee(pose: np.ndarray, mass: float = 0.4) -> Body:
    """A bar and a turned cylinder: neither the centre of mass nor the principal axes are those of the body frame."""
    shapes = (
        Shape(ShapeKind.BOX, (0.2, 0.04, 0.04)),
        Shape(ShapeKind.CYLINDER, (0.03, 0.3), transforms.from_rpy((0.15, 0.05, 0.0), (0.7, 0.0, 0.0))),
    )
    return Body("tee", BodyKind.MOVABLE, shapes, pose, mass)


@pytest.mark.parametrize(
    "kind, size, inside",
    [
        (ShapeKind.BOX, (0.1, 0.2, 0.3), lambda p: (np.abs(p) < [0.05, 0.1, 0.15]).all(axis=1)),
        (ShapeKind.SPHERE, (0.1,), lambda p: np.linalg.norm(p, axis=1) < 0.1),
        (ShapeKind.CYLINDER, (0.1, 0.3), lambda p: (np.hypot(p[:, 0], p[:, 1]) < 0.1) & (np.abs(p[:, 2]) < 0.15)),
        (
            ShapeKind.CAPSULE,
            (0.1, 0.2),
            lambda p: np.linalg.norm(p - np.clip(p, [0, 0, -0.1], [0, 0, 0.1]), axis=1) < 0.1,
        ),
    ],
)
def test_mass_properties_match_points_spread_in_the_shape(kind, size, inside):
    points = np.random.default_rng(0).uniform(-0.25, 0.25, (DENSE, 3))
    points = points[inside(points)]
    expected = 2.0 * np.diag(np.mean(points**2) * 3 * np.eye(3) - points.T @ points / len(points))
    T_body_inertial, moments = bodies.mass_properties((Shape(kind, size),), 2.0)
    assert np.allclose(T_body_inertial, transforms.IDENTITY)
    assert moments == pytest.approx(expected, rel=0.02)


def test_mass_properties_of_a_compound_match_points_spread_in_it():
    shapes = (
        Shape(ShapeKind.BOX, (0.2, 0.04, 0.06)),
        Shape(ShapeKind.BOX, (0.04, 0.3, 0.06), transforms.from_rpy((0.2, 0.05, 0.01), (0.3, 0.2, 0.1))),
    )
    rng = np.random.default_rng(1)
    volumes = np.array([np.prod(s.size) for s in shapes])
    clouds = [
        transforms.apply(s.pose, rng.uniform(-0.5, 0.5, (int(DENSE * v / volumes.sum()), 3)) * s.size)
        for s, v in zip(shapes, volumes, strict=True)
    ]
    points = np.concatenate(clouds)
    centered = points - points.mean(axis=0)
    tensor = 3.0 * (np.mean((centered**2).sum(axis=1)) * np.eye(3) - centered.T @ centered / len(points))
    T_body_inertial, moments = bodies.mass_properties(shapes, 3.0)
    R = transforms.rotation_matrix(T_body_inertial)
    assert T_body_inertial[:3] == pytest.approx(points.mean(axis=0), abs=1e-3)
    assert R @ np.diag(moments) @ R.T == pytest.approx(tensor, abs=0.02 * tensor.max())


def test_a_mesh_weighs_as_its_hull(tmp_path: Path):
    trimesh.creation.box((0.1, 0.2, 0.3)).export(tmp_path / "block.obj")
    mesh = Shape(ShapeKind.MESH, (1.0, 1.0, 2.0), mesh=tmp_path / "block.obj")
    T_mesh, of_mesh = bodies.mass_properties((mesh,), 1.0)
    _, of_box = bodies.mass_properties((Shape(ShapeKind.BOX, (0.1, 0.2, 0.6)),), 1.0)
    assert sorted(of_mesh) == pytest.approx(sorted(of_box)) and T_mesh[:3] == pytest.approx(np.zeros(3), abs=1e-9)
    block = Body("block", BodyKind.MOVABLE, (mesh,), transforms.pose((0.5, 0.0, 0.3)), 1.0)
    with SimulatedWorld(scene(block, robots=False)) as world:
        run(world, 0.5)
        assert world.body_pose("block")[2] == pytest.approx(0.3, abs=0.003)


def test_compound_body_frame_survives_the_centre_of_mass_offset():
    pose = transforms.from_rpy((0.5, 0.1, 0.6), (0.1, 0.2, 0.3))
    with SimulatedWorld(scene(tee(pose), robots=False)) as world:
        assert np.allclose(transforms.distance(world.body_pose("tee"), pose), 0.0, atol=1e-6)
        other = transforms.from_rpy((0.2, -0.1, 0.7), (1.0, 0.2, 2.0))
        world.move_body("tee", other)
        assert np.allclose(transforms.distance(world.body_pose("tee"), other), 0.0, atol=1e-6)


def test_compound_shapes_are_where_the_body_frame_says():
    pose = transforms.from_rpy((0.5, 0.1, 0.6), (0.1, 0.2, 0.3))
    body = tee(pose)
    with SimulatedWorld(scene(body, robots=False)) as world:
        for shape, radius in zip(body.shapes, (0.02, 0.03), strict=True):
            T_world_shape = transforms.multiply(pose, shape.pose)
            from_above = T_world_shape[:3] + transforms.rotation_matrix(T_world_shape)[:, 1] * 0.1
            hit = world._client.rayTest(from_above.tolist(), T_world_shape[:3].tolist())[0]
            assert np.linalg.norm(np.array(hit[3]) - T_world_shape[:3]) == pytest.approx(radius, abs=1e-4)


def test_a_compound_falls_freely_without_turning():
    pose = transforms.pose((0.0, 0.0, 5.0))
    with SimulatedWorld(scene(tee(pose), robots=False)) as world:
        run(world, 0.2)
        fallen = pose[2] - world.body_pose("tee")[2]
        assert fallen == pytest.approx(0.5 * GRAVITY * 0.2**2, rel=0.05)
        assert world.body_velocity("tee") == pytest.approx([0, 0, -GRAVITY * 0.2, 0, 0, 0], abs=0.02)


def test_velocity_is_that_of_the_body_frame():
    with SimulatedWorld(scene(tee(transforms.pose((0.0, 0.0, 5.0))), robots=False)) as world:
        handle = world._bodies["tee"]
        world._client.resetBaseVelocity(handle.id, [0.1, 0.0, 0.0], [0.0, 0.0, 2.0])
        before = world.body_pose("tee")
        velocity = world.body_velocity("tee")
        world.step()
        moved = (world.body_pose("tee") - before)[:2] / world.dt
        assert moved == pytest.approx(velocity[:2], abs=0.01) and velocity[1] < -0.1


@pytest.mark.parametrize("friction, slides", [(0.9, False), (0.1, True)])
def test_friction_decides_whether_a_box_slides(friction, slides):
    slope = np.deg2rad(25.0)  # tan 0.47
    ramp = Body(
        "ramp",
        BodyKind.FIXED,
        (Shape(ShapeKind.BOX, (2.0, 1.0, 0.1)),),
        transforms.from_rpy((0, 0, 1.0), (0, slope, 0)),
        friction=1.0,
    )
    on_it = transforms.multiply(ramp.pose, transforms.pose((0.0, 0.0, 0.0801)))
    block = replace(box("block", (0.06, 0.06, 0.06), (0, 0, 0), friction=friction), pose=on_it)
    with SimulatedWorld(scene(ramp, block, robots=False)) as world:
        run(world, 0.5)
        moved = np.linalg.norm(world.body_pose("block")[:3] - on_it[:3])
        assert (moved > 0.1) == slides and (slides or moved < 0.002)


def test_resting_objects_stay_and_touch_their_support_with_their_weight():
    with SimulatedWorld(scene(box("block", (0.06, 0.08, 0.04), (0.5, 0.0, 0.02)), robots=False)) as world:
        run(world, 0.5)
        contacts = world.contacts("block")
        assert {(c.a, c.b) for c in contacts} == {("block", "table")}
        assert sum(c.force for c in contacts) == pytest.approx(0.3 * GRAVITY, rel=0.05)
        assert np.allclose(world.body_pose("block")[:3], [0.5, 0.0, 0.02], atol=1e-4)


LYING = transforms.pose((0.5, 0.0, 0.03), (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)))


@pytest.mark.parametrize(("kind", "size"), [(ShapeKind.CYLINDER, (0.03, 0.16)), (ShapeKind.CAPSULE, (0.03, 0.1))])
def test_what_is_round_lies_still(kind, size):
    bottle = Body("bottle", BodyKind.MOVABLE, (Shape(kind, size),), LYING, 0.3)
    with SimulatedWorld(scene(bottle, robots=False)) as world:
        run(world, 3.0)
        moved, turned = transforms.distance(LYING, world.body_pose("bottle"))
        assert moved < 5e-4 and turned < 0.02


def test_joints_go_where_they_are_told_and_are_matched_by_name():
    model = panda_model()
    order = (3, 0, 1, 2, 4, 5, 6)
    shuffled = replace(model, joint_names=tuple(model.joint_names[i] for i in order))
    s = scene()
    s.robots["left"] = Robot("left", shuffled, transforms.pose((0.1, 0.2, 0.0)), HOME[list(order)])
    with SimulatedWorld(s) as world:
        states = world.joint_states()["left"]
        assert states.names == (*shuffled.joint_names, "panda_finger_joint1", "panda_finger_joint2")
        assert np.allclose(states.positions, [*HOME[list(order)], 0.04, 0.04])
        # the forearm is stretched by joint 4: the hand moves away
        reach = world.robot("left").end_effector_pose()[0]
        target = HOME[list(order)] + [0.5, 0, 0, 0, 0, 0, 0]
        world.set_joint_targets("left", target, np.zeros(7))
        run(world, 1.0)
        assert np.allclose(world.joint_states()["left"].positions[:7], target, atol=1e-3)
        assert world.robot("left").end_effector_pose()[0] > reach + 0.04


def test_hand_is_where_the_urdf_has_it():
    with SimulatedWorld(scene()) as world:
        # forward kinematics of the published dimensions with all joints at zero but the fourth
        q = np.array([0.0, 0.0, 0.0, -np.pi / 2, 0.0, np.pi / 2, np.pi / 4])
        world.robot("left").place(q, 0.08)
        expected = [0.0825 - 0.0825 * 0 + 0.384 + 0.088, 0.0, 0.333 + 0.316 + 0.0825 - 0.107 - 0.105]
        assert world.robot("left").end_effector_pose()[:3] == pytest.approx(expected, abs=1e-5)


def test_fingers_close_symmetrically_and_hold_what_they_meet():
    block, stand = box("block", (0.06, 0.06, 0.06), (0.5, 0.0, 0.3)), box("stand", (0.1, 0.1, 0.02), (0.5, 0.0, 0.1))
    with SimulatedWorld(scene(block, replace(stand, kind=BodyKind.FIXED))) as world:
        ee = world.robot("left").end_effector_pose()
        world.move_body("block", transforms.pose(ee[:3] + [0.0, 0.004, 0.0]))  # off centre
        world.move_body("stand", transforms.pose(ee[:3] - [0.0, 0.0, 0.0401]))
        world.set_gripper("left", 0.0, 40.0)
        run(world, 0.5)
        world.remove_body("stand")
        run(world, 0.5)
        left, right = world.joint_states()["left"].positions[-2:]
        assert left == pytest.approx(right, abs=5e-4)
        assert world.robot("left").gripper_state()[0] == pytest.approx(0.06, abs=5e-4)
        assert world.body_pose("block")[2] == pytest.approx(ee[2], abs=2e-3)  # held up
        fingers = {c.link_b for c in world.contacts("block") if c.b == "left"}
        assert fingers == {"panda_leftfinger", "panda_rightfinger"}


@pytest.mark.parametrize("width", [0.02, 0.008])  # wider and narrower than the corners of the pads are apart
def test_what_is_held_is_pressed_along_the_closing_axis_however_the_hand_turns_and_stays_in_it(width):
    stick = box("stick", (width, 0.02, 0.12), (0.5, 0.0, 0.4), mass=0.15, friction=1.0)
    with SimulatedWorld(scene(stick)) as world:
        robot = world.robot("left")

        def T_ee_body():
            return transforms.multiply(transforms.inverse(robot.end_effector_pose()), world.body_pose("stick"))

        robot.place(HOME, 0.0201)
        world.move_body("stick", transforms.multiply(robot.end_effector_pose(), transforms.pose((0.0, 0.0, 0.04))))
        robot.set_gripper(0.0, 40.0)
        run(world, 0.5)
        before, duration, way = T_ee_body(), 3.0, np.array([1.2, 0.2, 0.0, 0.3, 0.0, 1.0, 1.5])
        for t in np.arange(0.0, duration, world.dt):
            phase, rate = np.pi * t / duration, np.pi / duration
            speed = 0.5 * rate * np.sin(phase)
            world.set_joint_targets("left", HOME + 0.5 * (1.0 - np.cos(phase)) * way, speed * way)
            world.step()
        closing = transforms.rotation_matrix(robot.end_effector_pose())[:, 1]
        pressing = [contact.normal @ closing for contact in world.contacts("stick") if contact.force > 0.0]
        distance, angle = transforms.distance(before, T_ee_body())
    assert np.abs(pressing).min() >= np.cos(RENEWAL + np.deg2rad(1.0))
    assert distance < 0.001 and angle < np.deg2rad(1.0)


def test_reset_goes_back_to_the_start_or_to_a_state():
    s = scene(box("block", (0.06, 0.06, 0.06), (0.5, 0.0, 0.5)))
    with SimulatedWorld(s) as world:
        world.add_body(box("extra", (0.1, 0.1, 0.1), (0.5, 0.5, 0.05)))
        run(world, 0.5)
        time = world.time
        world.reset()
        assert world.time == time and world.body_names() == ["table", "block"]
        assert np.allclose(world.body_pose("block"), s.bodies["block"].pose)
        there = transforms.pose((0.6, 0.1, 0.03))
        world.reset(SceneState(q={"left": HOME + 0.1}, gripper={"left": 0.05}, poses={"block": there}))
        state = world.state()
        assert np.allclose(state.q["left"], HOME + 0.1) and np.allclose(state.poses["block"], there)
        assert state.gripper["left"] == pytest.approx(0.05)
        other = scene(box("another", (0.06, 0.06, 0.06), (0.5, 0.0, 0.03)), robots=False)
        world.reset(other)
        assert world.body_names() == ["table", "another"] and world.joint_states() == {}


def test_the_same_scene_runs_the_same_twice_also_after_a_reset():
    s = scene(box("a", (0.06, 0.06, 0.06), (0.5, 0.0, 0.2)), box("b", (0.06, 0.06, 0.06), (0.51, 0.02, 0.1)))
    with SimulatedWorld(s) as one, SimulatedWorld(s) as two:
        run(one, 0.7)
        run(two, 0.7)
        expected = one.state().poses
        assert all(np.array_equal(two.state().poses[n], p) for n, p in expected.items())
        one.reset()
        run(one, 0.7)
        assert all(np.array_equal(one.state().poses[n], p) for n, p in expected.items())


def test_bodies_can_be_added_moved_and_removed():
    with SimulatedWorld(scene(robots=False)) as world:
        world.add_body(box("block", (0.06, 0.06, 0.06), (0.5, 0.0, 0.03)))
        world.move_body("block", transforms.pose((0.2, 0.0, 0.03)))
        run(world, 0.2)
        assert world.body("block").pose[0] == pytest.approx(0.2, abs=1e-3)
        world.remove_body("block")
        assert world.body_names() == ["table"]


@pytest.mark.parametrize(
    "call, code",
    [
        (lambda w: w.body_pose("nothing"), Code.UNKNOWN_OBJECT),
        (lambda w: w.body_velocity("nothing"), Code.UNKNOWN_OBJECT),
        (lambda w: w.move_body("nothing", transforms.IDENTITY), Code.UNKNOWN_OBJECT),
        (lambda w: w.remove_body("nothing"), Code.UNKNOWN_OBJECT),
        (lambda w: w.contacts("nothing"), Code.UNKNOWN_OBJECT),
        (lambda w: w.set_gripper("nobody", 0.0, 1.0), Code.UNKNOWN_ROBOT),
        (lambda w: w.set_gripper("left", np.nan, 1.0), Code.INVALID_INPUT),
        (lambda w: w.set_joint_targets("nobody", HOME, HOME), Code.UNKNOWN_ROBOT),
        (lambda w: w.move_body("block", [0, 0, 0, 0, 0, 0, 2.0]), Code.INVALID_POSE),
        (lambda w: w.move_body("block", [np.nan, 0, 0, 0, 0, 0, 1.0]), Code.INVALID_POSE),
        (lambda w: w.add_body(table()), Code.INVALID_SCENE),
        (lambda w: w.add_body(box("weightless", (0.1, 0.1, 0.1), (0, 0, 1), mass=0.0)), Code.INVALID_INPUT),
        (lambda w: w.reset(SceneState({}, {}, {"nothing": transforms.IDENTITY})), Code.UNKNOWN_OBJECT),
        (lambda w: w.reset(SceneState({"nobody": HOME}, {}, {})), Code.UNKNOWN_ROBOT),
        (lambda w: w.render("nowhere"), Code.INVALID_INPUT),
    ],
)
def test_wrong_names_and_values_are_named_and_leave_the_world_usable(call, code):
    with SimulatedWorld(scene(box("block", (0.06, 0.06, 0.06), (0.5, 0.0, 0.03)))) as world:
        with pytest.raises(InputError) as error:
            call(world)
        assert error.value.code is code
        world.step()
        assert np.isfinite(world.body_pose("block")).all()


def test_a_model_that_does_not_fit_its_urdf_is_refused():
    s = scene()
    for change, word in [
        ({"joint_names": ("panda_joint1", "elbow")}, "elbow"),
        ({"end_effector_link": "paw"}, "paw"),
        ({"simulation": {"stiffness": 1.0}}, "stiffness"),
        ({"simulation": {"position_gain": "high"}}, "high"),
        ({"urdf": Path("/nowhere.urdf")}, "nowhere"),
    ]:
        s.robots["left"] = Robot("left", replace(panda_model(), **change), transforms.pose(), HOME)
        with pytest.raises(InputError, match=word):
            SimulatedWorld(s)


def test_simulation_settings_of_the_model_are_used():
    assert RobotSettings.of("x", {"position_gain": 1, "joint_forces": [1, 2]}) == replace(
        RobotSettings(), position_gain=1.0, joint_forces=(1.0, 2.0)
    )


def test_camera_sees_bodies_where_they_are():
    block = box("block", (0.2, 0.1, 0.06), (0.6, -0.1, 0.03))
    ball = Body("ball", BodyKind.MOVABLE, (Shape(ShapeKind.SPHERE, (0.05,)),), transforms.pose((0.7, 0.2, 0.05)), 0.1)
    rod = Body(
        "rod",
        BodyKind.TOOL,
        (Shape(ShapeKind.CAPSULE, (0.03, 0.1)),),
        transforms.from_rpy((0.9, 0.0, 0.03), (np.pi / 2, 0, 0)),
        0.1,
    )
    camera = Camera("top", transforms.from_rpy((0.6, 0.0, 1.2), (np.pi, 0.1, 0.3)), 320, 240)
    with SimulatedWorld(scene(block, ball, rod, robots=False)) as world:
        image = world.render(camera)
    assert image.color.shape == (240, 320, 3) and image.color.dtype == np.uint8
    assert image.depth.dtype == np.float32 and image.mask.dtype == np.int32
    numbers = {name: number for number, name in image.names.items()}
    assert set(numbers) == {"table", "block", "ball", "rod"}
    points = unproject(image.depth, camera)
    assert np.abs(points[image.mask == numbers["table"]][:, 2]).max() < 1e-3
    seen = {name: points[image.mask == number] for name, number in numbers.items()}
    assert np.abs(np.linalg.norm(seen["ball"] - [0.7, 0.2, 0.05], axis=1) - 0.05).max() < 0.001
    on_axis = np.clip(seen["rod"], [0.9, -0.05, 0.03], [0.9, 0.05, 0.03])
    assert np.abs(np.linalg.norm(seen["rod"] - on_axis, axis=1) - 0.03).max() < 0.001
    assert (np.abs(seen["block"] - [0.6, -0.1, 0.03]) < [0.101, 0.051, 0.031]).all()


def test_camera_has_no_bias_of_a_fraction_of_a_pixel():
    camera = Camera("top", transforms.pose((0.6, 0.0, 1.2), (1.0, 0.0, 0.0, 0.0)), 160, 120)
    rng, offsets = np.random.default_rng(0), []
    with SimulatedWorld(scene(box("tile", (0.2, 0.1, 0.002), (0.6, 0.0, 0.001)), robots=False)) as world:
        for _ in range(16):
            center = transforms.pose((*rng.uniform([0.5, -0.1], [0.7, 0.1]), 0.001))
            world.move_body("tile", center)
            image = world.render(camera)
            tile = next(number for number, name in image.names.items() if name == "tile")
            offsets.append((unproject(image.depth, camera)[image.mask == tile].mean(axis=0) - center[:3])[:2])
    pixel = 1.2 / intrinsics(camera)[0, 0]
    assert np.abs(np.mean(offsets, axis=0)).max() < 0.2 * pixel


def unproject(depth: np.ndarray, camera: Camera) -> np.ndarray:
    K = intrinsics(camera)
    v, u = np.indices(depth.shape)
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(depth.shape)], axis=-1)
    return transforms.apply(camera.pose, rays * depth[..., None])


def test_nothing_in_view_has_no_depth():
    with SimulatedWorld(scene(robots=False)) as world:
        image = world.render(Camera("up", transforms.pose((0.0, 0.0, 1.0)), 32, 24))
        assert np.isnan(image.depth).all() and not image.mask.any()


def test_worlds_side_by_side_do_not_disturb_each_other():
    s = scene(box("block", (0.06, 0.06, 0.06), (0.5, 0.0, 0.5)), robots=False)
    with SimulatedWorld(s) as one:
        two = SimulatedWorld(s)
        run(one, 0.1)
        assert two.body_pose("block")[2] == pytest.approx(0.5)
        two.close()
        run(one, 0.5)
        assert one.body_pose("block")[2] == pytest.approx(0.03, abs=1e-3)
        two.close()  # harmless
