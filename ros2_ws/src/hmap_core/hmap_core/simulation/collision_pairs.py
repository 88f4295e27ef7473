"""Pairs of links of a robot that need no collision check: ``python -m hmap_core.simulation.collision_pairs panda``.

Configurations are sampled within the joint limits, with random gripper openings. A pair is ignored if its links are
adjacent, overlap in every sample, or are never nearer than ``FAR``. Links without shape are omitted; links joined
through such a link are adjacent. Links that move with the gripper may contact other parts of the gripper, including the
hand; these pairs are ignored with the reason ``gripper``. MoveIt's Setup Assistant samples the same matrix.
"""

import argparse
import itertools
import sys
from collections.abc import Sequence

import numpy as np
import pybullet

from hmap_core.command_line import YES, keep_for_results, run_reported
from hmap_core.exceptions import InputError
from hmap_core.robot_description import load_robot_description
from hmap_core.scenes.robot_rules import simulated_urdf
from hmap_core.scenes.robots import load_robot_model
from hmap_core.types import RobotModel

FAR = 0.02  # m; a pair that is nearer than this in no sample never collides
SAMPLES = 10_000


def ignored_pairs(model: RobotModel, samples: int, rng: np.random.Generator) -> dict[tuple[str, str], str]:
    """Finds the pairs of links whose collisions can be ignored.

    Args:
        model: the robot.
        samples: number of configurations.
        rng: source of randomness.

    Returns:
        Pair of link names -> reason: ``adjacent``, ``always``, ``never`` or ``gripper``.
    """
    client = pybullet.connect(pybullet.DIRECT)
    try:
        return _Sampler(client, model).run(samples, rng)
    finally:
        pybullet.disconnect(client)


class _Sampler:
    def __init__(self, client: int, model: RobotModel):
        self._client = client
        self._model = model
        self._body = pybullet.loadURDF(str(simulated_urdf(model)), useFixedBase=True, physicsClientId=client)
        self._joints: dict[str, int] = {}
        self._links = {pybullet.getBodyInfo(self._body, client)[0].decode(): -1}
        self._parent: dict[int, int] = {}
        for j in range(pybullet.getNumJoints(self._body, client)):
            info = pybullet.getJointInfo(self._body, j, client)
            self._joints[info[1].decode()] = j
            self._links[info[12].decode()] = j
            self._parent[j] = info[16]
        self._tree = load_robot_description(model.urdf).require_valid().tree
        self._hand = [j for j in self._links.values() if self._carries(self._joints[model.joint_names[-1]], j)]

    def run(self, samples: int, rng: np.random.Generator) -> dict[tuple[str, str], str]:
        solid = [n for n, j in self._links.items() if pybullet.getCollisionShapeData(self._body, j, self._client)]
        pairs = {pair: self._structural_reason(*pair) for pair in itertools.combinations(solid, 2)}
        unknown = [pair for pair, reason in pairs.items() if reason is None]
        distances = np.empty((samples, len(unknown)))
        for row in distances:
            self._set_random_configuration(rng)
            row[:] = [self._distance(*pair) for pair in unknown]
        for pair, column in zip(unknown, distances.T, strict=True):
            own = "gripper" if all(self._links[link] in self._hand for link in pair) else None
            pairs[pair] = "always" if column.max() < 0.0 else "never" if column.min() >= FAR else own
        return {pair: reason for pair, reason in pairs.items() if reason is not None}

    def _structural_reason(self, a: str, b: str) -> str | None:
        fingers = self._model.gripper.finger_links if self._model.gripper else ()
        adjacent = self._links[a] in self._ancestors(b) or self._links[b] in self._ancestors(a)
        return "adjacent" if adjacent or (a in fingers and b in fingers) else None

    def _carries(self, joint: int, link: int) -> bool:
        """Whether a joint moves a link."""
        while link != -1 and link != joint:
            link = self._parent[link]
        return link == joint

    def _ancestors(self, link: str) -> list[int]:
        """The nearest ancestor that has a shape, preceded by the ancestors without shape."""
        ancestors, index = [], self._links[link]
        while index != -1:
            index = self._parent[index]
            ancestors.append(index)
            if pybullet.getCollisionShapeData(self._body, index, self._client):
                break
        return ancestors

    def _set_random_configuration(self, rng: np.random.Generator) -> None:
        values = dict(zip(self._model.joint_names, rng.uniform(*self._model.position_limits), strict=True))
        if self._model.gripper:
            gripper = self._model.gripper
            opening = rng.uniform(gripper.min_opening, gripper.open_opening)
            values |= dict(zip(gripper.joint_names, gripper.joints(opening), strict=True))
            for driver in gripper.joint_names:
                for name, (factor, offset) in self._tree.mimics(driver).items():
                    values[name] = factor * values[driver] + offset
        for name, value in values.items():
            pybullet.resetJointState(self._body, self._joints[name], value, physicsClientId=self._client)

    def _distance(self, a: str, b: str) -> float:
        """Distance in metres, at most FAR; negative in overlap."""
        points = pybullet.getClosestPoints(
            self._body, self._body, FAR, self._links[a], self._links[b], physicsClientId=self._client
        )
        return min((point[8] for point in points), default=FAR)


def main(argv: Sequence[str] | None = None) -> int:
    """Prints the ignored pairs as YAML for a robot file; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("robot", help="name of a robot model, or path of a robot file")
    parser.add_argument("--samples", type=int, default=SAMPLES)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args(argv)
    keep_for_results()
    return run_reported(lambda: _print_pairs(arguments.robot, arguments.samples, arguments.seed), "collision_pairs")


def _print_pairs(robot: str, samples: int, seed: int) -> int:
    if samples < 1 or seed < 0:
        raise InputError(f"--samples {samples} --seed {seed}: samples must be 1 or larger, the seed 0 or larger")
    pairs = ignored_pairs(load_robot_model(robot), samples, np.random.default_rng(seed))
    print("ignored_collisions:" if pairs else "ignored_collisions: []")
    for (a, b), reason in pairs.items():
        print(f"  - [{a}, {b}]  # {reason}")
    return YES


if __name__ == "__main__":
    sys.exit(main())
