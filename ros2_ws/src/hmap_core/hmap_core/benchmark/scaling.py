"""How the time of a KOMO problem grows with its steps, with the obstacles in the scene, and with the number of joints.

Arms stand in a row. Each moves from its home configuration to a random pose in front of it, among floating boxes. One
number is varied at a time, and the others keep their standard values. The seeds are the same for all values.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from hmap_core.benchmark import hmap_side
from hmap_core.benchmark.instances import MotionInstance, Target, box, scene_of
from hmap_core.benchmark.problems.common import SAFE, TABLE, sampled, table, yaw_quaternion
from hmap_core.benchmark.sampling import end_effector, random_configuration
from hmap_core.benchmark.world import clearance, motion_world, nearest, pairs
from hmap_core.scenes import load_robot_model
from hmap_core.transforms import pose
from hmap_core.types import Body, Goal, Robot

STEPS = (10, 20, 40, 80, 160)
OBSTACLES = (0, 5, 10, 20, 40)
ARMS = (("iiwa",), ("panda",), ("panda", "iiwa"), ("panda", "panda"), ("panda", "panda", "panda"))
# values while another number is varied
STANDARD_STEPS, STANDARD_OBSTACLES, STANDARD_ARMS = 20, 10, ("panda",)
INSTANCES = 15
BASE_SPACING = 1.2  # m between two bases
REACH = ((0.25, -0.4, 0.15), (0.7, 0.4, 0.8))  # m; region of an arm's end-effector goal, from its base
BOX_REGION = ((0.2, -0.6, 0.1), (0.9, 0.6, 1.0))  # m; region of the boxes, from an arm's base
BOX_SIZE = ((0.04, 0.04, 0.04), (0.12, 0.12, 0.2))  # m
OPENING = 0.04  # m, of grippers
DRAWS = 400  # configurations drawn before the sample is rejected
BOXES = 80  # drawn; those too near to the arms are dropped
WARM_UP_SEED = 10**6
HEADROOM = 1.15  # of the plot's axes


def instance(seed: int, steps: int, obstacles: int, arms: tuple[str, ...]) -> MotionInstance:
    """One motion: with fewer obstacles it has only the first ones; the number of steps changes nothing else."""
    full = _full_instance(seed, arms)
    bodies = dict(list(full.scene.bodies.items())[: 1 + obstacles])  # the table is the first
    return replace(full, scene=replace(full.scene, bodies=bodies), steps_per_phase=(steps,))


@cache
def _full_instance(seed: int, arms: tuple[str, ...]) -> MotionInstance:
    """The motion among all obstacles, in one step."""
    return sampled(lambda seed, rng: _sample_instance(seed, rng, arms), "scaling", seed)


def _sample_instance(seed: int, rng: np.random.Generator, arms: tuple[str, ...]) -> MotionInstance | None:
    robots = [_arm(k, name) for k, name in enumerate(arms)]
    opening = {r.name: 0.0 if r.model.gripper is None else OPENING for r in robots}
    home = {r.name: r.q for r in robots}
    found = [(r.name, _reaching(r, rng)) for r in robots]
    goals = {name: q for name, q in found if q is not None}
    if len(goals) < len(robots):
        return None
    on_table = scene_of("scaling", seed, [table()], robots, Goal(TABLE, pose()))
    if min(clearance(on_table, opening, q, SAFE) for q in (home, goals)) < SAFE:
        return None
    boxes = [_box(k, robots[rng.integers(len(robots))], rng) for k in range(BOXES)]
    boxes = _far_from_robots(boxes, robots, opening, (home, goals))[: max(OBSTACLES)]
    if len(boxes) < max(OBSTACLES):
        return None
    scene = scene_of("scaling", seed, [table(), *boxes], robots, Goal(TABLE, pose()))
    targets = tuple(Target(r.name, 0, end_effector(r, goals[r.name])) for r in robots)
    return MotionInstance(scene, opening, (1,), targets, seed=seed)


def _arm(k: int, name: str) -> Robot:
    model = load_robot_model(name)
    return Robot(f"{name}_{k}", model, pose((0.0, BASE_SPACING * k, 0.0)), model.home)


def _reaching(robot: Robot, rng: np.random.Generator) -> np.ndarray | None:
    """A configuration (n,) with the end-effector in front of the robot, or None."""
    low, high = REACH
    for _ in range(DRAWS):
        q = random_configuration(robot, rng)
        place = end_effector(robot, q)[:3] - robot.base_pose[:3]
        if np.all(low < place) and np.all(place < high):
            return q
    return None


def _box(k: int, robot: Robot, rng: np.random.Generator) -> Body:
    place = robot.base_pose[:3] + rng.uniform(*BOX_REGION)
    return box(f"box_{k}", rng.uniform(*BOX_SIZE), pose(place, yaw_quaternion(rng.uniform(-np.pi, np.pi))))


def _far_from_robots(bodies: list[Body], robots, opening, configurations) -> list[Body]:
    """The bodies that the robots in each of the configurations keep SAFE away from."""
    scene = scene_of("scaling", 0, bodies, robots, Goal(bodies[0].name, bodies[0].pose))
    near = set()
    for q in configurations:
        world = motion_world(scene, opening, {name: np.atleast_2d(value) for name, value in q.items()})
        near |= {name for pair in pairs(world) if nearest(world, [pair], SAFE) < SAFE for name in pair.names}
    return [body for body in bodies if body.name not in near]


def run(instances: int = INSTANCES, progress: Callable[[str], None] = lambda text: None) -> dict:
    """Solve all instances.

    Args:
        instances: number of seeds.
        progress: called with a text for each seed.

    Returns:
        For "steps", "obstacles" and "joints": ``values``, ``labels``, ``median_ms`` of CPU time and ``claimed``, the
        number of instances with a result reported as feasible, one each per value; and ``instances``, their number.
    """
    standard = {"steps": STANDARD_STEPS, "obstacles": STANDARD_OBSTACLES, "arms": STANDARD_ARMS}
    axes: dict[str, tuple[str, tuple]] = {
        "steps": ("steps", STEPS),
        "obstacles": ("obstacles", OBSTACLES),
        "joints": ("arms", ARMS),
    }
    settings = {(axis, v): {**standard, key: v} for axis, (key, values) in axes.items() for v in values}
    results: dict = {name: [] for name in settings}
    for seed in (WARM_UP_SEED, *range(instances)):
        progress(f"seed {seed}" if seed != WARM_UP_SEED else "warming up")
        for (
            name,
            setting,
        ) in settings.items():  # all settings in turn, so that other load on the machine affects them alike
            results[name].append(_measure(seed, setting))
    data: dict = {"instances": instances}
    for axis, (key, values) in axes.items():
        rows = [np.array(results[axis, v][1:]) for v in values]
        data[axis] = {
            "values": [_joints(v) for v in values] if key == "arms" else list(values),
            "labels": [" + ".join(v) if key == "arms" else str(v) for v in values],
            "median_ms": [float(np.median(row[:, 0])) for row in rows],
            "claimed": [int(row[:, 1].sum()) for row in rows],
        }
    return data


def _joints(arms: tuple[str, ...]) -> int:
    return sum(len(load_robot_model(name).home) for name in arms)


def _measure(seed: int, setting: dict) -> tuple[float, bool]:
    """CPU time in ms of one instance, and whether its result is reported as feasible."""
    problem = instance(seed, **setting)
    prepared = hmap_side.prepare(problem)
    before = time.process_time()
    answer = hmap_side.solve(problem, prepared)
    return (time.process_time() - before) * 1e3, answer.claimed


def linear_fit(data: dict) -> tuple[float, float]:
    """Least-squares line through the times by steps: ms per step, ms at zero steps."""
    slope, offset = np.polyfit(data["steps"]["values"], data["steps"]["median_ms"], 1)
    return float(slope), float(offset)


def draw(data: dict, file: Path) -> None:
    """Plot the result of :func:`run`: one panel for each varied number."""
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(1, 3, figsize=(12.0, 3.6), layout="constrained")
    for panel, axis in zip(panels, ("steps", "obstacles", "joints"), strict=True):
        part = data[axis]
        panel.plot(part["values"], part["median_ms"], "o", color="tab:blue")
        panel.set(xlabel=axis, ylabel="processor time, ms (median)")
        panel.set_xlim(left=0)
        panel.set_ylim(0.0, HEADROOM * max(part["median_ms"]))
        panel.grid(alpha=0.3)
    slope, offset = linear_fit(data)
    ends = np.array([0, max(data["steps"]["values"])])
    panels[0].plot(ends, offset + slope * ends, color="tab:gray", label=f"{offset:.2g} + {slope:.2g} ms per step")
    panels[0].legend()
    joints = data["joints"]
    for x, y, label in zip(joints["values"], joints["median_ms"], joints["labels"], strict=True):
        panels[2].annotate(label, (x, y), xytext=(-5, 5), textcoords="offset points", fontsize=7, ha="right")
    figure.savefig(file, dpi=150)
    pyplot.close(figure)
