"""Small scenes for skeletons, contacts in them, and what the judge's geometry says of a path."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from hmap_core.komo.skeleton_problem import SkeletonProblem
from hmap_core.plan_file import to_dict
from hmap_core.scenes import load_scene
from hmap_core.transforms import pose
from hmap_core.types import ContactKind, ContactPoint, Plan, Scene, Segment, SegmentKind, Trajectory
from hmap_core.validation import document
from hmap_core.validation.bounds import PartBoxes
from hmap_core.validation.pairs import PairBuilder
from hmap_core.validation.world import World

TABLE = "table: {shape: box, size: [3, 3, 0.1], pose: {xyz: [0, 0, -0.05]}}"
ONE_ARM = "arm: {model: panda, base: {xyz: [0, 0, 0], rpy_deg: [0, 0, 0]}}"
TWO_ARMS = """left: {model: panda, base: {xyz: [0, 0, 0], rpy_deg: [0, 0, 0]}}
  right: {model: panda, base: {xyz: [0.9, 0, 0], rpy_deg: [0, 0, 180]}}"""
TIP = 0.0072  # m from the Panda's end-effector frame to the ends of its fingers
FINENESS = 4  # the judge looks at this many places between two steps
PERIOD = 0.1  # s between two places, of no importance here


def scene(folder: Path, fixed=(), movable=(), robots=ONE_ARM, tools=()) -> Scene:
    """A table with boxes given as (name, size (3,), position (3,)), and robots as text of a task file."""
    lines = ["schema: 1", "description: A test.", "mode: kinematic", "fixed:", f"  {TABLE}"]
    lines += [f"  {_box(*entry)}}}" for entry in fixed]
    lines += ["movable:", *(f"  {_box(*entry)}, mass: 0.3}}" for entry in movable)]
    if tools:
        lines += ["tools:", *(f"  {_box(*entry)}, mass: 0.3}}" for entry in tools)]
    goal = movable[0]
    lines += ["robots:", f"  {robots}", f"goal: {{object: {goal[0]}, pose: {{xyz: {list(goal[2])}}}}}"]
    file = folder / "scene.yaml"
    file.write_text("\n".join(lines) + "\n")
    return load_scene(str(file))


def _box(name, size, position) -> str:
    return f"{name}: {{shape: box, size: {list(size)}, pose: {{xyz: {list(position)}}}"


def contact(kind: ContactKind, approach, closing, position, opening: float) -> ContactPoint:
    """A hand at a position (3,) in the object's frame; ``approach`` and ``closing`` are unit directions there."""
    z, y = np.asarray(approach, float), np.asarray(closing, float)
    turn = Rotation.from_matrix(np.c_[np.cross(y, z), y, z]).as_quat()
    z_ee = np.array([0.0, 0.0, 1.0])
    return ContactPoint(kind, pose(position, turn), np.asarray(position, float), -z, opening, z_ee)


def depth(problem: SkeletonProblem, path: np.ndarray, openings: dict[str, list[float]]) -> tuple[float, tuple]:
    """The deepest penetration (m) along a path by the judge's own geometry, and of whom.

    Args:
        path: (T, n); looked at between its steps too, straight in the joints.
        openings: robot -> gripper opening of each phase.
    """
    workspace = problem.workspace
    before = np.concatenate([workspace.start[None], path])
    s = np.arange(1, FINENESS + 1)[:, None] / FINENESS
    dense = np.concatenate([a + s * (b - a) for a, b in zip(before, path, strict=False)])
    fine = SkeletonProblem(problem.skeleton, workspace, [FINENESS * k for k in problem.steps_per_phase])
    state, N = workspace.state, len(dense)
    phases = fine.phase_of_step()
    joints, gripper = {}, {}
    for name, robot in workspace.scene.robots.items():
        at = workspace.model.offset.get(name)
        joints[name] = np.tile(state.q[name], (N, 1)) if at is None else dense[:, at : at + len(robot.q)]
        gripper[name] = np.array(openings.get(name, [state.gripper[name]] * len(fine.steps_per_phase)))[phases]
    moved = fine.object_poses(dense)
    objects = {n: np.tile(b.pose, (N, 1)) for n, b in workspace.scene.bodies.items() if b.kind != "fixed"} | moved
    time = np.arange(N) * PERIOD
    whole = Segment(0.0, time[-1], workspace.robots[0], "panda_hand", None, SegmentKind.TRANSIT)
    plan = Plan(workspace.scene, Trajectory(time, joints, gripper, objects), (whole,), np.zeros((0, 7)), {})
    world = World(document.read(to_dict(plan)))
    worst = 0.0, ()
    boxes, samples = PartBoxes(world), np.arange(world.samples)
    for pair in PairBuilder(world, set()).build():
        a, b = boxes.rows([pair])
        for k in np.flatnonzero(boxes.gaps(a, b, samples) < 0.0):
            d = pair.gauge.distance(world.tracks[pair.a].at(int(k)), world.tracks[pair.b].at(int(k)))
            worst = max(worst, (-d, (*pair.names, int(k))), key=lambda found: found[0])
    return worst
