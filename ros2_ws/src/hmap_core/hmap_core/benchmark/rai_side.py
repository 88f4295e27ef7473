"""RAI's side: a motion instance as a KOMO problem of ``robotic``, with RAI's own model of the Panda.

KOMO: Toussaint, "Newton methods for k-order Markov constrained motion problems", arXiv:1407.0414, 2014. The settings
are those with which RAI verified the most instances; ``docs/benchmarks.md`` lists the alternatives.
"""

import os
from dataclasses import dataclass, field
from functools import lru_cache
from types import ModuleType
from typing import Any

import numpy as np

from hmap_core.benchmark.instances import Answer, Attachment, MotionInstance
from hmap_core.exceptions import InputError
from hmap_core.transforms import inverse
from hmap_core.types import Body, Robot, ShapeKind


@dataclass(frozen=True)
class Settings:
    """Scales of the objectives, and options of NLP_Solver that differ from its defaults.

    RAI reports a result as feasible if its scaled errors add up to less than 0.1.
    """

    target: float
    collision: float
    support: float = 10.0
    limit: float = 1.0
    options: dict = field(default_factory=dict)


# as RAI's KOMO_ManipulationHelper has them
HELPER_OPTIONS = {"damping": 0.1, "stopEvals": 200, "stopInners": 20, "lambdaMax": 100.0}
CONFIGURATION = Settings(target=100.0, collision=1.0, options=HELPER_OPTIONS)
KEYFRAMES = Settings(target=10.0, collision=1.0, options=HELPER_OPTIONS)
PATH = Settings(target=100.0, collision=10.0)
CONTROL_SCALE = 0.1  # of accelerations
HOMING_SCALE = 0.1  # of the distance from the start configuration
KEYFRAME_HOMING_SCALE, KEYFRAME_VELOCITY_SCALE = 0.01, 0.1  # as KOMO_ManipulationHelper.setup_sequence has them
KEYFRAME_RESTARTS = 8
KEYFRAME_NOISE = 0.5  # rad
ROUNDING = 0.005  # m; smallest radius of RAI's boxes: RAI limits the depth of an overlap to their radii
LOWERED = 5e-4  # m by which fixed bodies are lowered, so that bodies on them do not collide
FINGER = np.array([0.0, 0.008, 0.0438])  # m; RAI's finger boxes, moved up by 1.2 mm to end where the real ones end


def robotic() -> ModuleType:
    """Import RAI's Python module.

    Raises:
        InputError: it is not installed, or a system library is missing.
    """
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    try:
        import robotic
    except ImportError as error:
        raise InputError(
            f"RAI is needed to compare with: pip install 'hmap_core[bench]' (robotic 0.4.2), and the system's "
            f"liblapack3 ({error})"
        ) from error
    return robotic


@dataclass
class Prepared:
    """A Config with the robots, the bodies, and the frames of targets and attached objects."""

    config: Any


def prepare(instance: MotionInstance) -> Prepared:
    """Build the Config; not timed.

    Raises:
        InputError: ``robotic`` is missing, or a robot is not a Panda, the only model of RAI that is used.
    """
    ry = robotic()
    C = ry.Config()
    C.addFrame("world")
    for name, robot in instance.scene.robots.items():
        _add_panda(ry, C, name, robot, instance.opening[name])
    carried = {attachment.object for attachment in instance.attachments}
    for body in instance.scene.bodies.values():
        add_body(ry, C, body, max(instance.rounding, ROUNDING), body.name in carried)
    for k, target in enumerate(instance.targets):
        C.addFrame(f"target_{k}", "world").setRelativePose(wxyz(target.T_world_ee))
    for attachment in instance.attachments:
        frame = C.addFrame(f"held_{attachment.object}", f"{attachment.robot}_ee")
        frame.setRelativePose(wxyz(inverse(attachment.T_obj_ee)))
    C.setJointState(instance.start)
    return Prepared(C)


def retarget(prepared: Prepared, instance: MotionInstance) -> None:
    """Move robots and targets of a Config to those of another instance with the same structure."""
    for k, target in enumerate(instance.targets):
        prepared.config.getFrame(f"target_{k}").setRelativePose(wxyz(target.T_world_ee))
    prepared.config.setJointState(instance.start)


def wxyz(pose: np.ndarray) -> list[float]:
    """A pose (7,) with the quaternion's w first, as RAI represents it."""
    return [*pose[:3], pose[6], *pose[3:6]]


def _add_panda(ry: ModuleType, C, name: str, robot: Robot, opening: float) -> None:
    """Add RAI's Panda with hmap's joint limits, base, opening and end-effector frame."""
    if robot.model.name != "panda":
        raise InputError(f"robot '{name}': model '{robot.model.name}' has no counterpart in RAI; allowed: panda")
    C.addConfigurationCopy(_panda(name)).setParent(C.getFrame("world"))
    C.getFrame(f"{name}_panda_base").setRelativePose(wxyz(robot.base_pose))
    for k, limits in enumerate(robot.model.position_limits.T):
        C.getFrame(f"{name}_panda_joint{k + 1}").setJoint(ry.JT.hingeZ, limits=list(limits))
    C.getFrame(f"{name}_panda_finger_joint1").setJointState(list(robot.model.require_gripper().joints(opening)[:1]))
    for finger, side in (("finger1", 1.0), ("finger2", -1.0)):
        C.getFrame(f"{name}_{finger}").setRelativePosition(FINGER * [1.0, side, 1.0])
    C.addFrame(f"{name}_ee", f"{name}_panda_hand_joint").setRelativePose(wxyz(robot.model.T_link_ee))


@lru_cache
def _panda(name: str):
    """RAI's Panda with frames named after the robot; read from its files once."""
    ry = robotic()
    C = ry.Config()
    C.addFile(ry.raiPath("panda/panda.g"), f"{name}_")
    return C


def add_body(ry: ModuleType, C, body: Body, rounding: float, carried: bool) -> None:
    """Add a body at its pose.

    Args:
        ry: RAI's module.
        C: the Config.
        body: boxes and cylinders only.
        rounding: radius of its edges, m.
        carried: whether it can become the child of another frame.

    Raises:
        InputError: the shape is not supported.
    """
    lowered = 0.0 if carried else LOWERED
    frame = C.addFrame(body.name, "world")
    frame.setRelativePose(wxyz(body.pose - np.array([0, 0, lowered, 0, 0, 0, 0])))
    if carried:  # a link of its own, which can get another parent
        frame.setJoint(ry.JT.rigid)
    for k, shape in enumerate(body.shapes):
        part = C.addFrame(f"{body.name}_{k}", body.name).setRelativePose(wxyz(shape.pose))
        if shape.kind == ShapeKind.BOX:
            part.setShape(ry.ST.ssBox, [*shape.size, rounding])
        elif shape.kind == ShapeKind.CYLINDER:
            part.setShape(ry.ST.ssCylinder, [shape.size[1], shape.size[0], rounding])
        else:
            raise InputError(f"body '{body.name}': a {shape.kind} is not compared; allowed: box, cylinder")
        part.setContact(1)


def solve(instance: MotionInstance, prepared: Prepared) -> Answer:
    """Build KOMO and solve it; timed."""
    ry = robotic()
    rng = np.random.default_rng(instance.seed)
    if not instance.path:
        q, ok = _configuration(ry, instance, prepared, rng)
        return Answer(ok, np.concatenate([instance.start[None], q]))
    path = None
    for _ in range(1 + instance.restarts):
        keyframes = _keyframes(ry, instance, prepared, rng)
        komo = _komo(ry, instance, prepared, instance.steps_per_phase[0], 2, PATH)
        komo.addControlObjective([], 2, CONTROL_SCALE)
        if keyframes is None:
            komo.initWithConstant(instance.start)
        else:
            komo.initWithPath(_interpolated(instance, keyframes))
        ok, q = _solve_nlp(ry, komo, PATH)
        path = np.concatenate([instance.start[None], q])
        if ok:
            return Answer(True, path)
    return Answer(False, path)


def _komo(ry: ModuleType, instance: MotionInstance, prepared: Prepared, steps: int, order: int, settings: Settings):
    """The objectives that the path problem and the waypoint problem share."""
    phases = len(instance.steps_per_phase)
    komo = ry.KOMO(prepared.config, phases, steps, order, True)
    komo.addObjective([], ry.FS.accumulatedCollisions, [], ry.OT.eq, [settings.collision])
    komo.addObjective([], ry.FS.jointLimits, [], ry.OT.ineq, [settings.limit])
    for attachment in instance.attachments:
        komo.addRigidSwitch(attachment.first, [f"held_{attachment.object}", attachment.object], False)
        if attachment.support is not None:
            _add_support(ry, komo, instance, attachment, settings.support)
    for k, target in enumerate(instance.targets):
        if steps > 1 or target.before == 0:
            time = target.phase + 1.0 - target.before / steps
            frames = [f"{target.robot}_ee", f"target_{k}"]
            komo.addObjective([time], ry.FS.poseDiff, frames, ry.OT.eq, [settings.target])
    return komo


def _add_support(ry: ModuleType, komo, instance: MotionInstance, attachment: Attachment, scale: float) -> None:
    times = [float(attachment.first), float(len(instance.steps_per_phase))]
    height = instance.scene.bodies[attachment.object].pose[2]
    z = np.array([[0.0, 0.0, scale]])
    komo.addObjective(times, ry.FS.position, [attachment.object], ry.OT.eq, z, [0.0, 0.0, height])
    komo.addObjective(times, ry.FS.vectorZ, [attachment.object], ry.OT.eq, [scale], [0.0, 0.0, 1.0])


def _solve_nlp(ry: ModuleType, komo, settings: Settings) -> tuple[bool, np.ndarray]:
    solver = ry.NLP_Solver(komo.nlp(), verbose=0)
    solver.setOptions(verbose=0, **settings.options)
    return solver.solve().feasible, komo.getPath()


def _configuration(ry: ModuleType, instance: MotionInstance, prepared: Prepared, rng: np.random.Generator):
    """One configuration (1, n), from the start or else from random ones, and whether it is feasible."""
    komo = _komo(ry, instance, prepared, 1, 0, CONFIGURATION)
    komo.addControlObjective([], 0, HOMING_SCALE)
    low, high = np.concatenate([r.model.position_limits for r in instance.scene.robots.values()], axis=1)
    for start in (instance.start, *rng.uniform(low, high, (instance.restarts, len(low)))):
        komo.initWithConstant(start)
        ok, q = _solve_nlp(ry, komo, CONFIGURATION)
        if ok:
            break
    return q, ok


def _keyframes(
    ry: ModuleType, instance: MotionInstance, prepared: Prepared, rng: np.random.Generator
) -> np.ndarray | None:
    """Configurations (phases, n) of the phase ends from KOMO's waypoint problem, or None.

    The first try starts from the start configuration, the others from noise around it.
    """
    komo = _komo(ry, instance, prepared, 1, 1, KEYFRAMES)
    komo.addControlObjective([], 0, KEYFRAME_HOMING_SCALE)
    komo.addControlObjective([], 1, KEYFRAME_VELOCITY_SCALE)
    n = len(instance.start)
    for noise in (np.zeros(n), *rng.normal(0.0, KEYFRAME_NOISE, (KEYFRAME_RESTARTS, n))):
        komo.initWithConstant(instance.start + noise)
        ok, q = _solve_nlp(ry, komo, KEYFRAMES)
        if ok:
            return q
    return None


def _interpolated(instance: MotionInstance, keyframes: np.ndarray) -> np.ndarray:
    """A path (T, n), linear from the start through the keyframes (phases, n)."""
    rows, before = [], instance.start
    for steps, q in zip(instance.steps_per_phase, keyframes, strict=True):
        rows.append(before + np.arange(1, steps + 1)[:, None] / steps * (q - before))
        before = q
    return np.concatenate(rows)
