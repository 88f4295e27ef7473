"""RAI's KOMO as whole methods on the tasks of hmap: the outside peers of the baselines ``komo`` and ``lgp_star``.

The skeletons, the contacts and the restarts are those of the baselines; RAI solves the problem of each move, up to
where the object is. The hand then draws back straight, which is no problem of RAI's.
"""

from dataclasses import replace

import numpy as np

from hmap_core.baselines.given_moves import Move, given_moves
from hmap_core.baselines.move_contacts import contacts_of_move
from hmap_core.baselines.restarts import Job, move_by_move, new_job
from hmap_core.baselines.transfers import NOT_ON_THE_WAY
from hmap_core.benchmark.instances import Attachment, MotionInstance, Target
from hmap_core.benchmark.rai_side import prepare, robotic, solve
from hmap_core.contacts.feasibility import draw_back, ik_problem
from hmap_core.exceptions import Code, InputError, MotionError
from hmap_core.komo.segment import APPROACH_STEPS, Phase, retreated
from hmap_core.planner.assembly import scene_at
from hmap_core.planner.interfaces import ProgressCallback, RobotContact, SubTrajectory
from hmap_core.planner.protocols import Cancel
from hmap_core.planner.segments.contact_segment import ContactSegment
from hmap_core.transforms import multiply
from hmap_core.types import ContactPoint, Plan, Scene, SceneState

STEPS = 20  # of each phase; RAI's phases are all alike
RESTARTS = 2  # of RAI's solver with the same contact
CONTACTS = 6  # of a move that are tried before all begins anew


class RaiLgpStar:
    """Implements :class:`hmap_core.planner.protocols.ManipulationPlanner`: one KOMO of RAI for each given move.

    Args:
        skeletons: path of a file of skeletons; empty: those of the published tasks.

    Raises:
        InputError: RAI is not installed.
    """

    name = "rai_lgp_star"

    def __init__(self, skeletons: str = ""):
        robotic()
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
            InputError: UNKNOWN_TASK; no skeleton is given for the task, or RAI's side cannot state it.
            PlannerError: TIME_LIMIT, no restart was feasible; CANCELED.
        """
        job = new_job(self.name, scene, state, seed, time_limit, progress, cancel)
        moves = self._moves(job.scene)
        return job.plan(lambda: move_by_move(job, moves, _one_move))

    def _moves(self, scene: Scene) -> list[Move]:
        return given_moves(scene, self._skeletons)


class RaiKomo(RaiLgpStar):
    """The same without poses on the way, for tasks of one move: then it is one problem over the whole task."""

    name = "rai_komo"

    def _moves(self, scene: Scene) -> list[Move]:
        moves = super()._moves(scene)
        if len(moves) > 1:
            raise InputError(
                f"rai_komo: task '{scene.task}' has {len(moves)} moves; allowed: 1, as RAI's side keeps an object "
                "attached until the end",
                Code.UNKNOWN_TASK,
            )
        return [replace(moves[0], through=NOT_ON_THE_WAY)]


def _one_move(job: Job, state: SceneState, move: Move) -> list[SubTrajectory] | None:
    """The motions of a move from a state; None where none of several contacts leads to any."""
    poses = np.array([state.poses[move.object], *move.through, move.T_end])
    for contact in contacts_of_move(job.scene, state, move.robot, move.object, poses, job.rng)[:CONTACTS]:
        job.check_time()
        instance = motion_instance(job.scene, state, move, contact, poses, int(job.rng.integers(2**31)))
        answer = solve(instance, prepare(instance))
        if answer.claimed:
            try:
                return _motions(job.scene, state, move, contact, answer.path)
            except MotionError:
                continue
    return None


def motion_instance(
    scene: Scene, state: SceneState, move: Move, contact: ContactPoint, object_poses: np.ndarray, seed: int
) -> MotionInstance:
    """The move as a problem of RAI, with the moving robot alone.

    Args:
        scene, state: the world, and where everything is.
        move: the move.
        contact: of its robot.
        object_poses: (M, 7) of the object: the present one, those on the way, the last one.
        seed: of RAI's random numbers.
    """
    robot, last = move.robot, len(object_poses)
    alone = replace(scene_at(scene, state), robots={robot: replace(scene.robots[robot], q=state.q[robot])})
    coming = [
        Target(robot, 0, multiply(object_poses[0], retreated(contact, k / APPROACH_STEPS)), before=k)
        for k in range(APPROACH_STEPS, 0, -1)
    ]
    touching = [Target(robot, k, multiply(T, contact.T_obj_ee)) for k, T in enumerate(object_poses)]
    return MotionInstance(
        alone,
        {robot: contact.opening},
        (STEPS,) * last,
        (*coming, *touching),
        (Attachment(robot, move.object, 1, contact.T_obj_ee, move.slides_on, contact),),
        ((robot, move.object),),
        RESTARTS,
        seed=seed,
    )


def _motions(
    scene: Scene, state: SceneState, move: Move, contact: ContactPoint, path: np.ndarray
) -> list[SubTrajectory]:
    """The motions along RAI's path (T + 1, n), and the retreat.

    Raises:
        MotionError: the hand cannot draw back, or the path is beyond the joint limits.
    """
    ends = np.array([state.poses[move.object], move.T_end])
    held = RobotContact(move.robot, contact, 1, path[[STEPS, -1]])
    segment = ContactSegment(scene, state, move.object, held, ends)
    retreat = ik_problem(segment.manipulation, segment.collisions, Phase.RETREAT)
    after = draw_back(segment.manipulation, retreat, contact, move.T_end, path[-1])
    if not len(after):
        raise MotionError(f"robot '{move.robot}' cannot leave the contact on '{move.object}'")
    leaving = np.concatenate([path[-1:], after])
    found = segment.trajectories(path[: STEPS + 1], path[STEPS:], leaving)
    return [motion for motion in found if len(motion.trajectory.time) > 1]
