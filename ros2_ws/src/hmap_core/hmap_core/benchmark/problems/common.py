"""What several problems share: the table, the Panda, and attempts until an instance is right."""

from collections.abc import Callable

import numpy as np

from hmap_core.benchmark.instances import MotionInstance, Ride, Target, box
from hmap_core.benchmark.sampling import drawn_back
from hmap_core.exceptions import Code, PlannerError
from hmap_core.scenes import load_robot_model
from hmap_core.transforms import multiply, pose
from hmap_core.types import Body, Robot, Scene

TABLE_SIZE = (2.4, 2.4, 0.1)  # m; its top is at z = 0
TABLE = "table"
MAX_ATTEMPTS = 200
RESTARTS = 2  # of path problems
SAFE = 0.005  # m that configurations which prove an instance feasible keep from everything


def table() -> Body:
    return box(TABLE, TABLE_SIZE, pose((0.0, 0.0, -TABLE_SIZE[2] / 2.0)))


def panda(name: str = "panda", base: np.ndarray | None = None) -> Robot:
    """A Panda at home."""
    model = load_robot_model("panda")
    return Robot(name, model, pose() if base is None else base, model.home)


def yaw_quaternion(yaw: float) -> np.ndarray:
    """Quaternion (4,) xyzw of a turn (rad) about z."""
    return np.array([0.0, 0.0, np.sin(yaw / 2.0), np.cos(yaw / 2.0)])


def carried(
    scene: Scene,
    opening: float,
    steps: tuple[int, ...],
    ride: Ride,
    goal: np.ndarray,
    approach: tuple[float, int],
    seed: int,
    touching: bool,
    lift: tuple[float, int] | None = None,
) -> MotionInstance:
    """Reach a contact, then carry the object of a ride to a goal (7,).

    Args:
        opening: of the gripper, m.
        approach: the hand comes from so far back along its z axis (m) in the last so many steps of the first phase.
        touching: whether the contact is a touch of the fingers.
        lift: the object is so high (m) over start and goal after, and before, so many steps of the second phase.
    """
    start = scene.bodies[ride.object].pose
    before = Target(ride.robot, 0, multiply(start, drawn_back(ride.T_obj_ee, approach[0])), approach[1])
    contact = Target(ride.robot, 0, multiply(start, ride.T_obj_ee))
    end = Target(ride.robot, 1, multiply(goal, ride.T_obj_ee))
    raised = ()
    if lift is not None:
        up = np.array([0.0, 0.0, lift[0], 0.0, 0.0, 0.0, 0.0])
        raised = (
            Target(ride.robot, 1, multiply(start + up, ride.T_obj_ee), steps[1] - lift[1]),
            Target(ride.robot, 1, multiply(goal + up, ride.T_obj_ee), lift[1]),
        )
    touches = ((ride.robot, ride.object),) if touching else ()
    return MotionInstance(
        scene, {ride.robot: opening}, steps, (before, contact, *raised, end), (ride,), touches, RESTARTS, seed=seed
    )


Attempt = Callable[[int, np.random.Generator], MotionInstance | None]


def sampled(attempt: Attempt, name: str, seed: int) -> MotionInstance:
    """The first instance that an attempt with generators of this problem and seed does not give up on.

    Raises:
        PlannerError: none in MAX_ATTEMPTS; a wrong problem, not a wrong seed.
    """
    for k in range(MAX_ATTEMPTS):
        instance = attempt(seed, np.random.default_rng([seed, k, *name.encode()]))
        if instance is not None:
            return instance
    raise PlannerError(f"problem '{name}', seed {seed}: no instance in {MAX_ATTEMPTS} attempts", Code.INTERNAL)
