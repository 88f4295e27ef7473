"""hpp-manipulation as a whole method on the tasks of hmap: an outside peer of the baseline ``birrt``.

The contacts are those of hmap's sampler; HPP decides which of them it uses when, where objects are released on the way,
and how everything moves. It runs in an environment of its own: see :mod:`hmap_core.benchmark.hpp_side`.
"""

import json
import os
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hmap_core.baselines.given_moves import Move, given_moves
from hmap_core.baselines.move_contacts import contacts_of_move
from hmap_core.baselines.restarts import Job, new_job
from hmap_core.exceptions import Code, InputError, MotionError
from hmap_core.komo.segment import retreat_distance
from hmap_core.planner.interfaces import ProgressCallback, RobotContact, SubTrajectory
from hmap_core.planner.protocols import Cancel
from hmap_core.planner.segments.attached import end_effector_poses
from hmap_core.planner.segments.contact_segment import ContactSegment
from hmap_core.planner.segments.motion_sequence import MotionSequence
from hmap_core.transforms import distance, euler_angles, inverse, multiply, rotation_matrix
from hmap_core.types import Body, ContactPoint, Plan, Scene, SceneState, ShapeKind

PYTHON = "HMAP_HPP_PYTHON"  # the variable that names the Python of HPP's environment
SIDE = Path(__file__).with_name("hpp_side.py")
CONTACTS = 4  # of each object, at most: each is a state of the constraint graph
TRY = 60.0  # s of one try, after which other contacts are drawn
LATE = 10.0  # s that a try may take longer, for its start
POLL = 0.2  # s between two looks whether the job has to end
SMALLER = 1e-3  # m by which moved objects are smaller on each side in HPP's world, so that hands may touch them
LOWERED = 5e-4  # m by which fixed bodies are lower there, so that objects may stand on them
WIDER = 2e-3  # m by which fixed bodies are wider there: what SMALLER takes away, and the least distance of the judge
REACH = 0.9  # m round the base of the robot where objects may be
LEVEL = 1e-3  # m and rad by which start and goal may differ in height and tilt
MOVED = 1e-5  # m and rad from which on an object moves
SAME_OPENING = 1e-3  # m


class HppManipulation:
    """Implements :class:`hmap_core.planner.protocols.ManipulationPlanner` by HPP's ManipulationPlanner.

    Args:
        skeletons: path of a file of skeletons, of which the robot and the objects are taken; empty: those of the
            published tasks.

    Raises:
        InputError: HPP is not installed.
    """

    def __init__(self, skeletons: str = ""):
        self._python = hpp_python()
        self._skeletons = skeletons

    def plan(
        self,
        scene: Scene,
        state: SceneState | None = None,
        seed: int = 0,
        time_limit: float = 60.0,
        progress: ProgressCallback | None = None,
        cancel: Cancel | None = None,
    ) -> Plan:
        """Plan a task; arguments as of :class:`hmap_core.planner.protocols.ManipulationPlanner`.

        Raises:
            InputError: UNKNOWN_TASK; no skeleton is given for the task, or this side cannot state it.
            PlannerError: TIME_LIMIT, no try was successful; CANCELED.
        """
        job = new_job("hpp_manipulation", scene, state, seed, time_limit, progress, cancel)
        moves = given_moves(job.scene, self._skeletons)
        check_stated(job.scene, job.start, moves)
        return job.plan(lambda: self._one_try(job, moves))

    def _one_try(self, job: Job, moves: Sequence[Move]) -> list[SubTrajectory] | None:
        """The motions of a path of HPP with contacts drawn anew; None where an object has none.

        Raises:
            MotionError: HPP finds no path.
        """
        contacts = drawn_contacts(job, moves)
        if not contacts:
            return None
        limit = min(TRY, job.deadline - time.monotonic())
        answer = self._answer(job, problem(job, moves, contacts, limit))
        if not answer["solved"]:
            raise MotionError(f"HPP: {answer['reason']}")
        return motions(job, moves[0].robot, contacts, answer["parts"])

    def _answer(self, job: Job, task: dict[str, Any]) -> dict[str, Any]:
        """What HPP's process answers; it is ended where the job has to end.

        Raises:
            MotionError: it ended without an answer.
        """
        prefix = next(Path(self._python).parents[1].glob("lib/python*/site-packages/cmeel.prefix"), Path())
        paths = {"LD_LIBRARY_PATH": str(prefix / "lib"), "ROS_PACKAGE_PATH": str(prefix / "share")}
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | paths | {"OMP_NUM_THREADS": "1"}
        text: str | None = json.dumps(task)
        late = time.monotonic() + task["time_limit"] + LATE
        with subprocess.Popen(
            [self._python, str(SIDE)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
        ) as process:
            try:
                while True:
                    try:
                        out, errors = process.communicate(text, timeout=POLL)
                        break
                    except subprocess.TimeoutExpired:
                        text = None
                        job.check_time()
                        if time.monotonic() > late:
                            raise MotionError("HPP does not end in time") from None
            finally:
                process.kill()
        if not out:
            lines = errors.strip().splitlines() or [f"exit code {process.returncode}"]
            raise MotionError(f"HPP ended without an answer: {lines[-1]}")
        return json.loads(out)


def hpp_python() -> str:
    """The Python of HPP's environment.

    Raises:
        InputError: there is none, or it has no HPP.
    """
    python = os.environ.get(PYTHON, "")
    if not python or not any(Path(python).parents[1].glob("lib/python*/site-packages/hpp_python-*.dist-info")):
        raise InputError(
            f"HPP is needed to compare with: `make bench-peers` installs it; or set {PYTHON} to the Python of an "
            f"environment with hpp-python 9.0.2 (now '{python}')"
        )
    return python


def check_stated(scene: Scene, state: SceneState, moves: Sequence[Move]) -> None:
    """Whether this side can state a task.

    Raises:
        InputError: UNKNOWN_TASK; several robots, another robot than a Panda, or objects that do not keep to the height
            of their support.
    """

    def refuse(reason: str) -> InputError:
        return InputError(f"hpp_manipulation: task '{scene.task}' {reason}", Code.UNKNOWN_TASK)

    robots = sorted({move.robot for move in moves})
    if len(robots) > 1:
        raise refuse(f"is moved by {len(robots)} robots; allowed: 1, as this side has one gripper")
    if scene.robots[robots[0]].model.name != "panda":
        raise refuse(f"is moved by '{robots[0]}', which is no Panda, the only arm that HPP's wheels bring")
    for move in moves:
        change = multiply(inverse(state.poses[move.object]), move.T_end)
        tilt = float(np.arccos(np.clip(rotation_matrix(change)[2, 2], -1.0, 1.0)))
        if move.slides_on is None or abs(state.poses[move.object][2] - move.T_end[2]) > LEVEL or tilt > LEVEL:
            raise refuse(
                f"lifts or turns over '{move.object}'; allowed: objects that stay on their support, whose placements "
                "this side states as one height"
            )


def drawn_contacts(job: Job, moves: Sequence[Move]) -> dict[str, list[ContactPoint]]:
    """For each object contacts that the arm reaches before and after its moves, with the same opening of the gripper.

    Empty where an object has none.
    """
    found: dict[str, list[ContactPoint]] = {}
    opening: float | None = None
    last = {move.object: move for move in moves}
    for name, move in last.items():
        job.check_time()
        ends = np.array([job.start.poses[name], move.T_end])
        drawn = contacts_of_move(job.scene, job.start, move.robot, name, ends, job.rng)
        if not drawn:  # one for the start, another one for the end
            drawn = [
                contact
                for T in ends
                for contact in contacts_of_move(job.scene, job.start, move.robot, name, T[None], job.rng)[:2]
            ]
        opening = drawn[0].opening if drawn and opening is None else opening
        alike = [contact for contact in drawn if opening is not None and abs(contact.opening - opening) < SAME_OPENING]
        if not alike:
            return {}
        found[name] = alike[:CONTACTS]
    return found


def problem(
    job: Job, moves: Sequence[Move], contacts: dict[str, list[ContactPoint]], time_limit: float
) -> dict[str, Any]:
    """The task as :mod:`hmap_core.benchmark.hpp_side` reads it."""
    scene, state = job.scene, job.start
    robot = scene.robots[moves[0].robot]
    last = {move.object: move.T_end for move in moves}
    fixed = {name: body for name, body in scene.bodies.items() if name not in last}
    base = robot.base_pose
    return {
        "seed": int(job.rng.integers(2**31)),
        "time_limit": time_limit,
        "base": base.tolist(),
        "q": state.q[moves[0].robot].tolist(),
        "limits": robot.model.position_limits.T.tolist(),
        "T_hand_ee": robot.model.T_link_ee.tolist(),
        "opening": next(iter(contacts.values()))[0].opening,
        "lower": (base[:3] - REACH).tolist(),
        "upper": (base[:3] + REACH).tolist(),
        "fixed": {
            name: {"urdf": urdf(body, WIDER), "pose": (state.poses[name] - [0, 0, LOWERED, 0, 0, 0, 0]).tolist()}
            for name, body in fixed.items()
        },
        "objects": {
            name: {
                "urdf": urdf(scene.bodies[name], -SMALLER),
                "start": state.poses[name].tolist(),
                "goal": last[name].tolist(),
                "contacts": [_contact(contact) for contact in contacts[name]],
            }
            for name in last
        },
    }


def _contact(contact: ContactPoint) -> dict[str, Any]:
    approach = contact.approach / np.linalg.norm(contact.approach)
    return {
        "T_obj_ee": contact.T_obj_ee.tolist(),
        "approach": approach.tolist(),
        "distance": float(retreat_distance(contact)),
    }


def urdf(body: Body, wider: float) -> str:
    """A body as URDF: one link of boxes and cylinders.

    Args:
        body: the body.
        wider: m that are added on each side, negative to make it smaller; upwards only where it is negative.

    Raises:
        InputError: UNKNOWN_TASK; a shape is another one.
    """
    parts = []
    for shape in body.shapes:
        up = 2.0 * min(wider, 0.0)
        if shape.kind is ShapeKind.BOX:
            x, y, z = shape.size
            geometry = f'<box size="{x + 2 * wider:g} {y + 2 * wider:g} {z + up:g}"/>'
        elif shape.kind is ShapeKind.CYLINDER:
            radius, height = shape.size
            geometry = f'<cylinder radius="{radius + wider:g}" length="{height + up:g}"/>'
        else:
            raise InputError(
                f"hpp_manipulation: body '{body.name}' is a {shape.kind}; allowed: box, cylinder", Code.UNKNOWN_TASK
            )
        xyz, rpy = (" ".join(f"{v:.9g}" for v in own) for own in (shape.pose[:3], euler_angles(shape.pose)))
        origin = f'<origin xyz="{xyz}" rpy="{rpy}"/>'
        parts.append(f"<collision>{origin}<geometry>{geometry}</geometry></collision>")
    inertia = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    return f'<robot name="{body.name}"><link name="body">{inertia}{"".join(parts)}</link></robot>'


def motions(
    job: Job, robot: str, contacts: dict[str, list[ContactPoint]], parts: Sequence[dict[str, Any]]
) -> list[SubTrajectory]:
    """The motions of a plan along the parts of HPP's path: those that move an object, and what lies between them.

    Raises:
        MotionError: a point of the path is beyond the joint limits.
    """
    sequence, found = MotionSequence(job.start), list[SubTrajectory]()
    legs = _legs(parts)
    for k, (name, q, poses) in enumerate(legs):
        if not name:
            continue
        coming = legs[k - 1][1] if k and not legs[k - 1][0] else q[[0, 0]]
        after = legs[k + 1][1] if k + 1 < len(legs) and not legs[k + 1][0] else q[[-1, -1]]
        contact = _nearest(job.scene, robot, q[0], poses[0], contacts[name])
        held = RobotContact(robot, contact, 1, q[[0, -1]])
        segment = ContactSegment(job.scene, sequence.state, name, held, poses[[0, -1]])
        for motion in segment.trajectories(coming, q, after):
            if len(motion.trajectory.time) > 1:
                sequence.add(motion)
                found.append(motion)
    return found


def _legs(parts: Sequence[dict[str, Any]]) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """The parts, neighbours that move the same object as one: its name, or none; (m, n) and (m, 7) along it."""
    legs: list[tuple[str, np.ndarray, np.ndarray]] = []
    for part in parts:
        q, placed = np.array(part["q"]), {name: np.array(poses) for name, poses in part["poses"].items()}
        if np.abs(q - q[0]).max() < MOVED:
            continue
        name = next((own for own, poses in placed.items() if max(distance(poses[0], poses[-1])) > MOVED), "")
        poses = placed[name] if name else np.zeros((len(q), 7))
        if legs and legs[-1][0] == name:
            _, before, along = legs[-1]
            legs[-1] = name, np.concatenate([before, q[1:]]), np.concatenate([along, poses[1:]])
        else:
            legs.append((name, q, poses))
    return legs


def _nearest(scene: Scene, robot: str, q: np.ndarray, T: np.ndarray, contacts: Sequence[ContactPoint]) -> ContactPoint:
    """The contact in which the robot is at q (n,) with the object at T (7,)."""
    T_obj_ee = multiply(inverse(T), end_effector_poses(scene, robot, q[None])[0])
    return min(contacts, key=lambda contact: sum(distance(contact.T_obj_ee, T_obj_ee)))
