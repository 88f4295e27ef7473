"""Parts that several problems share: the table, the Panda, the transfer motion, and rejection sampling of instances."""

from collections.abc import Callable

import numpy as np

from hmap_core.benchmark.instances import Attachment, MotionInstance, Target, box
from hmap_core.benchmark.sampling import retracted
from hmap_core.exceptions import Code, PlannerError
from hmap_core.scenes import load_robot_model
from hmap_core.transforms import multiply, pose
from hmap_core.types import Body, Robot, Scene

TABLE_SIZE = (2.4, 2.4, 0.1)  # m; its top is at z = 0
TABLE = "table"
MAX_ATTEMPTS = 200
RESTARTS = 2  # of path problems
SAFE = 0.005  # m; minimum distance of the configurations that prove an instance feasible


def table() -> Body:
    """The table, a fixed box."""
    return box(TABLE, TABLE_SIZE, pose((0.0, 0.0, -TABLE_SIZE[2] / 2.0)))


def panda(name: str = "panda", base: np.ndarray | None = None) -> Robot:
    """A Panda at its home configuration."""
    model = load_robot_model("panda")
    return Robot(name, model, pose() if base is None else base, model.home)


def yaw_quaternion(yaw: float) -> np.ndarray:
    """Quaternion (4,) xyzw of a rotation (rad) about z."""
    return np.array([0.0, 0.0, np.sin(yaw / 2.0), np.cos(yaw / 2.0)])


def transfer_motion(
    scene: Scene,
    opening: float,
    steps: tuple[int, ...],
    attachment: Attachment,
    goal: np.ndarray,
    approach: tuple[float, int],
    seed: int,
    touching: bool,
    lift: tuple[float, int] | None = None,
) -> MotionInstance:
    """Reach a contact, then carry the attached object to a goal.

    Args:
        scene: the robot and the bodies.
        opening: of the gripper, m.
        steps: of both phases.
        attachment: robot, object and contact.
        goal: T_world_obj (7,).
        approach: length (m) of the straight approach along the hand's z axis, and its number of steps at the end of
            the first phase.
        seed: of the instance.
        touching: whether the contact is a touch of the fingers.
        lift: height (m) of the lift above start and goal, and the number of steps for lifting and for lowering.
    """
    start = scene.bodies[attachment.object].pose
    before = Target(attachment.robot, 0, multiply(start, retracted(attachment.T_obj_ee, approach[0])), approach[1])
    contact = Target(attachment.robot, 0, multiply(start, attachment.T_obj_ee))
    end = Target(attachment.robot, 1, multiply(goal, attachment.T_obj_ee))
    raised: tuple[Target, ...] = ()
    if lift is not None:
        up = np.array([0.0, 0.0, lift[0], 0.0, 0.0, 0.0, 0.0])
        raised = (
            Target(attachment.robot, 1, multiply(start + up, attachment.T_obj_ee), steps[1] - lift[1]),
            Target(attachment.robot, 1, multiply(goal + up, attachment.T_obj_ee), lift[1]),
        )
    touches = ((attachment.robot, attachment.object),) if touching else ()
    return MotionInstance(
        scene,
        {attachment.robot: opening},
        steps,
        (before, contact, *raised, end),
        (attachment,),
        touches,
        RESTARTS,
        seed=seed,
    )


InstanceSampler = Callable[[int, np.random.Generator], MotionInstance | None]


def sampled(sampler: InstanceSampler, name: str, seed: int) -> MotionInstance:
    """The first instance that the sampler does not reject.

    Args:
        sampler: makes an instance, or rejects it with None.
        name: of the problem; seeds the random numbers.
        seed: of the instance; seeds the random numbers, too.

    Raises:
        PlannerError: MAX_ATTEMPTS samples were rejected; the problem is wrong, not the seed.
    """
    for k in range(MAX_ATTEMPTS):
        instance = sampler(seed, np.random.default_rng([seed, k, *name.encode()]))
        if instance is not None:
            return instance
    raise PlannerError(f"problem '{name}', seed {seed}: no instance in {MAX_ATTEMPTS} attempts", Code.INTERNAL)
