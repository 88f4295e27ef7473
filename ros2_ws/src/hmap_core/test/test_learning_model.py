"""The learned proposer: its weights, its features, and what it does with bad input."""

import json
import warnings
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest

from hmap_core.contacts.camera import Cloud
from hmap_core.exceptions import InputError
from hmap_core.learning import features, hold_features, weights
from hmap_core.learning.clearance import Boxes, box_distances, probe_distances
from hmap_core.learning.features import contact_features
from hmap_core.learning.hold_features import hold_features as features_of_hold
from hmap_core.learning.metrics import average_precision, conformal_checks, first_hits, platt
from hmap_core.learning.network import SHIPPED, Network, load_model
from hmap_core.learning.proposer import LearnedContacts, sound
from hmap_core.learning.situation import PathSituation
from hmap_core.planner import plugins
from hmap_core.planner.protocols import ContactProposer, ContactQuery, ManipulatorRanker
from hmap_core.planner.sampled_contacts import SampledContacts
from hmap_core.scenes import SceneBuilder
from hmap_core.transforms import apply, from_rpy, multiply, rotation_matrices

BLOCK_PATH = np.array([[0.45 + 0.01 * k, 0.1, 0.03, 0, 0, 0, 1.0] for k in range(12)])


def block_scene(model="panda", base=None):
    """A block on a table beside a wall."""
    scene = SceneBuilder("block")
    scene.add_box("table", [2, 2, 0.1], pose=[0, 0, -0.05])
    scene.add_box("wall", [0.02, 0.3, 0.1], pose=[0.4, 0.1, 0.05])
    scene.add_box("block", [0.05, 0.05, 0.06], pose=[0.45, 0.1, 0.03], movable=True, mass=0.2)
    scene.add_robot("arm", model, base_pose=[0, 0, 0])
    scene.set_goal("block", pose=[0.56, 0.1, 0.03])
    return scene.build()


def query_of(scene, poses=BLOCK_PATH, cloud=None):
    return ContactQuery(scene, scene.start_state(), "block", poses, "arm", np.random.default_rng(0), cloud)


def contacts_of(query):
    return [c for batch in islice(SampledContacts().propose(query), 1) for c in batch.contacts]


def moved(scene, T):
    """The whole scene moved and turned about the vertical."""
    bodies = {name: replace(body, pose=multiply(T, body.pose)) for name, body in scene.bodies.items()}
    robots = {name: replace(robot, base_pose=multiply(T, robot.base_pose)) for name, robot in scene.robots.items()}
    return replace(scene, bodies=bodies, robots=robots)


def test_features_do_not_change_where_the_whole_scene_is_moved_or_turned():
    scene, T = block_scene(), from_rpy((0.3, -1.2, 0.0), (0.0, 0.0, 2.1))
    contacts = contacts_of(query_of(scene))
    found = []
    for world, poses in ((scene, BLOCK_PATH), (moved(scene, T), np.array([multiply(T, pose) for pose in BLOCK_PATH]))):
        situation = PathSituation.of(world, world.start_state(), "block", poses, "arm")
        found.append((contact_features(situation, contacts), features_of_hold(situation)))
    np.testing.assert_allclose(found[0][0], found[1][0], atol=2e-4)
    np.testing.assert_allclose(found[0][1], found[1][1], atol=2e-4)
    assert found[0][0].shape == (len(contacts), features.WIDTH) and found[0][1].shape == (hold_features.WIDTH,)
    assert len(features.NAMES) == features.WIDTH


def test_probes_of_hands_are_where_the_object_carries_them():
    rng = np.random.default_rng(4)
    K, Q, T = 70, 6, 3  # more hands than are compared at once

    def poses(count):
        drawn = rng.normal(size=(count, 7)) * [0.1, 0.1, 0.1, 1, 1, 1, 1]
        drawn[:, 3:] /= np.linalg.norm(drawn[:, 3:], axis=1)[:, None]
        return drawn

    hands, stops, probes, ways = poses(K), poses(T), 0.1 * rng.normal(size=(Q, 3)), 0.1 * rng.normal(size=(K, 3))
    openings, widening = rng.uniform(0.0, 0.08, K), rng.normal(size=(Q, 3))
    back, half = np.array([1.0, 0.0, 0.5]), np.array([[0.05, 0.02, 0.1], [0.01, 0.08, 0.03]])
    boxes = poses(2)
    R_boxes, p_boxes = rotation_matrices(boxes), np.ascontiguousarray(boxes[:, :3])
    found = np.empty((K, T * Q))
    probe_distances(
        rotation_matrices(hands), np.ascontiguousarray(hands[:, :3]), openings, probes, widening, ways,
        rotation_matrices(stops), np.ascontiguousarray(stops[:, :3]), back, R_boxes, p_boxes, half, 0.2, 10.0, found, 0,
    )  # fmt: skip
    for t in range(T):
        for k in range(K):
            at = apply(stops[t], apply(hands[k], probes + openings[k] * widening) - back[t] * ways[k])
            expected = 10.0 * box_distances(at, R_boxes, p_boxes, half, 0.2)
            np.testing.assert_allclose(found[k, t * Q : (t + 1) * Q], expected, atol=1e-12)
    assert (found < 0.0).any() and (found == 2.0).any()


def test_distances_are_negative_inside_and_limited_outside():
    scene = block_scene()
    boxes = Boxes.around([(scene.bodies["wall"], scene.bodies["wall"].pose)])
    points = np.array([[0.4, 0.1, 0.05], [0.43, 0.1, 0.05], [0.41 + 0.03, 0.25 + 0.04, 0.05], [2.0, 0.0, 0.0]])
    np.testing.assert_allclose(boxes.distances(points, 0.1), [-0.01, 0.02, 0.05, 0.1], atol=1e-12)


def test_the_shipped_weights_are_small_and_of_this_program():
    assert SHIPPED.stat().st_size <= 2 * 2**20
    model = load_model()
    assert model.robots and set(model.calibration) == {"contact", "hold"}


def test_numpy_and_torch_agree():
    torch = pytest.importorskip("torch")
    rng = np.random.default_rng(0)
    tensors, _ = weights.load(SHIPPED)
    for name, width in (("contact", features.WIDTH), ("hold", hold_features.WIDTH)):
        network = Network.of(tensors, name)
        rows = (network.mean + rng.normal(size=(64, width)) / network.scale).astype(np.float32)
        x = torch.from_numpy(np.clip((rows - network.mean) * network.scale, -8, 8))
        for k, (matrix, bias) in enumerate(network.layers):
            x = x @ torch.from_numpy(matrix) + torch.from_numpy(bias)
            x = torch.relu(x) if k < len(network.layers) - 1 else x
        ours = network(rows)
        assert np.abs(ours - x.numpy()).max() <= 1e-5 * max(1.0, np.abs(ours).max())


def test_the_proposer_is_found_by_name_and_proposes_with_tools_only():
    proposer = plugins.create(plugins.CONTACT_PROPOSERS, "learned")
    assert isinstance(proposer, ContactProposer) and isinstance(proposer, ManipulatorRanker)
    assert not isinstance(SampledContacts(), ManipulatorRanker)
    scene = block_scene()
    assert list(proposer.propose(query_of(scene))) == []
    expected = proposer.hand_serves(scene, scene.start_state(), "block", BLOCK_PATH, ("arm",))
    assert expected.shape == (1,) and 0.0 <= expected[0] <= 1.0


def test_a_robot_that_was_never_seen_is_said_and_sampled():
    scene = block_scene("gen3_2f85")
    with pytest.warns(RuntimeWarning, match="has not seen the robot 'gen3_2f85'"):
        expected = LearnedContacts().hand_serves(scene, scene.start_state(), "block", BLOCK_PATH, ("arm",))
    assert expected.tolist() == [1.0]


@pytest.mark.parametrize("bad", [0, 5])
def test_clouds_without_finite_points_are_not_used(bad):
    nan = Cloud(np.full((bad, 3), np.nan), np.full((bad, 3), np.nan), np.ones(bad, bool))
    with pytest.warns(RuntimeWarning, match="no finite point"):
        assert sound(nan) is None


def test_points_that_are_not_finite_are_left_out():
    points = np.array([[0.0, 0.0, 0.0], [np.nan, 0.0, 0.0]])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        kept = sound(Cloud(points, np.array([[0, 0, 1.0], [0, 0, 1.0]]), np.ones(2, bool)))
    assert kept is not None and len(kept) == 1


def test_damaged_weights_are_refused(tmp_path):
    whole = SHIPPED.read_bytes()
    length = int.from_bytes(whole[:8], "little")
    header = json.loads(whole[8 : 8 + length])
    about = json.loads(header["__metadata__"]["hmap"])

    def with_about(**changes):
        header["__metadata__"]["hmap"] = json.dumps(about | changes)
        text = json.dumps(header).encode()
        return len(text).to_bytes(8, "little") + text + whole[8 + length :]

    cases = {
        "empty": (b"", "truncated"),
        "short": (whole[: len(whole) // 2], "SHA-256"),
        "no header": (b"\xff" * 64, "truncated"),
        "changed": (whole[:-4] + b"\x00\x00\x80\x3f", "SHA-256"),
        "other format": (with_about(format="other"), "its format is 'other'"),
        "other version": (with_about(version=9), "its version is 9"),
    }
    for name, (content, text) in cases.items():
        path = tmp_path / f"{name}.safetensors"
        path.write_bytes(content)
        with pytest.raises(InputError, match=text):
            plugins.create(plugins.CONTACT_PROPOSERS, f"learned:{path}")
    with pytest.raises(InputError, match="cannot be read"):
        LearnedContacts(str(tmp_path / "nothing.safetensors"))


def test_weights_of_other_features_are_refused(tmp_path):
    tensors, about = weights.load(SHIPPED)
    tensors = tensors | {"contact.mean": np.zeros(3, np.float32)}
    weights.save(tmp_path / "w.safetensors", tensors, about)
    with pytest.raises(InputError, match="is for 3 features"):
        LearnedContacts(str(tmp_path / "w.safetensors"))


def test_metrics_by_hand():
    target, score = np.array([1, 0, 1, 0]), np.array([0.9, 0.8, 0.7, 0.1])
    assert average_precision(target, score) == pytest.approx((1 + 2 / 3) / 2)
    assert first_hits(np.array([1, 1, 2, 2]), np.array([0, 1, 0, 0]), score) == {1: 2}
    assert conformal_checks(np.arange(1, 20)) == 19 and conformal_checks(np.arange(5)) is None
    p = np.repeat([0.2, 0.8], 1000)
    slope, offset = platt((np.arange(2000) % 1000 < np.repeat([400, 600], 1000)).astype(float), p)
    q = 1 / (1 + np.exp(-(slope * np.log(p / (1 - p)) + offset)))
    np.testing.assert_allclose(q[[0, -1]], [0.4, 0.6], atol=0.01)
