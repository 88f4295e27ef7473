"""Two Pandas that face each other reach poses in their shared workspace."""

import numpy as np

from hmap_core.benchmark.instances import MotionInstance, Target, scene_of
from hmap_core.benchmark.problems.common import RESTARTS, SAFE, TABLE, panda, sampled, table, yaw_quaternion
from hmap_core.benchmark.sampling import end_effector, random_configuration
from hmap_core.benchmark.world import clearance
from hmap_core.transforms import pose
from hmap_core.types import Goal

APART = 0.95  # m between the bases
SHARED = ((0.25, -0.3, 0.1), (0.7, 0.3, 0.7))  # m; region of the end-effectors' goals
OPENING = 0.04  # m
STEPS = ((20,), (20, 20))
DRAWS = 400  # configurations drawn for each arm and phase


def two_arm(seed: int) -> MotionInstance:
    """One phase for even seeds, two for odd ones."""
    return sampled(_sample_instance, "two_arm", seed)


def _sample_instance(seed: int, rng: np.random.Generator) -> MotionInstance | None:
    robots = [panda("left"), panda("right", pose((APART, 0.0, 0.0), yaw_quaternion(np.pi)))]
    opening = {robot.name: OPENING for robot in robots}
    scene = scene_of("two_arm", seed, [table()], robots, Goal(TABLE, pose()))
    steps = STEPS[seed % len(STEPS)]
    targets = []
    for phase in range(len(steps)):
        found = [(robot.name, _in_shared_space(robot, rng)) for robot in robots]
        configuration = {name: q for name, q in found if q is not None}
        if len(configuration) < len(robots) or clearance(scene, opening, configuration, SAFE) < SAFE:
            return None
        targets += [Target(r.name, phase, end_effector(r, configuration[r.name])) for r in robots]
    return MotionInstance(scene, opening, steps, tuple(targets), restarts=RESTARTS, seed=seed)


def _in_shared_space(robot, rng: np.random.Generator) -> np.ndarray | None:
    low, high = SHARED
    for _ in range(DRAWS):
        q = random_configuration(robot, rng)
        if np.all(low < end_effector(robot, q)[:3]) and np.all(end_effector(robot, q)[:3] < high):
            return q
    return None
