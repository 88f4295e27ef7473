"""The loop of H-MaP for both solvers: the object's path, waypoints on it, contacts that cover some of them, motions.

Each solver plans object paths, finds configurations and optimises motions itself; the loop is the same for both.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hmap_core.benchmark import hmap_side, rai_side
from hmap_core.benchmark.instances import Answer, Attachment, MotionInstance, Target
from hmap_core.benchmark.judge import judge
from hmap_core.benchmark.problems.common import TABLE
from hmap_core.benchmark.problems.puck import APPROACH, APPROACH_STEPS, DISC, OBSTACLE, LoopInstance
from hmap_core.benchmark.sampling import retracted
from hmap_core.exceptions import WaypointError
from hmap_core.transforms import interpolate, inverse, multiply
from hmap_core.types import Body
from hmap_core.validation import rigid
from hmap_core.waypoints import ObjectPathProblem, plan_waypoints

ROUNDS = 6  # number of object paths tried, each for the whole task
# m; minimum distances of the object path, round by round: the shortest path leaves no room for the hand
MIN_DISTANCES = (0.002, 0.05)
SPACING = 0.15  # m between two waypoints
STEPS = 10  # of each phase: one to reach the contact, and one for each waypoint that it covers
CONFIGURATION_RESTARTS = 4
MOTION_RESTARTS = 1
TRIES = 3  # motions with contacts that cover all waypoints, and with contacts that cover some of them
OPENING = 0.0  # m: a fingertip carries the disc
REGION = [0.2, -0.6, 0.9, 0.6]  # m; bounds of object paths: lower x and y, upper x and y
CONTINUITY_TOLERANCE = 1e-3  # m or rad; largest gap between successive motions


@dataclass(frozen=True)
class LoopSide:
    """The functions of a solver that the loop uses.

    Attributes:
        object_path: (instance, round) -> poses (M, 7) from start to goal, or None; another path in each round.
        prepare: as in a motion problem.
        solve: as in a motion problem.
        retarget: moves the targets of a prepared problem to those of another instance.
    """

    object_path: Callable[[LoopInstance, int], np.ndarray | None]
    prepare: Callable
    solve: Callable[..., Answer]
    retarget: Callable

    def configurations(self, instance: LoopInstance):
        """Prepare the search for configurations; not timed, because it is the same for all of them."""
        return self.prepare(_configuration(instance, instance.scene.bodies[DISC].pose, _robot(instance).q))

    def run(self, instance: LoopInstance, prepared) -> Answer:
        """Run the loop; the path of the result is a list of (motion instance, path)."""
        for attempt in range(ROUNDS):
            poses = self.object_path(instance, attempt)
            done = None if poses is None else self._motions_along(instance, prepared, spaced(poses))
            if done is not None:
                return Answer(True, done)
        return Answer(False)

    def _motions_along(
        self, instance: LoopInstance, prepared, waypoints: np.ndarray
    ) -> list[tuple[MotionInstance, np.ndarray]] | None:
        """The motions that carry the disc to the waypoints (K, 7), from the start; None if one is not reached."""
        done: list[tuple[MotionInstance, np.ndarray]] = []
        q, at = _robot(instance).q, 0
        while at + 1 < len(waypoints):
            step = self._next_motion(instance, prepared, waypoints[at:], q)
            if step is None:
                return None
            done.append(step)
            q, at = step[1][-1], at + len(step[0].steps_per_phase) - 1
        return done

    def _next_motion(self, instance: LoopInstance, prepared, waypoints: np.ndarray, q: np.ndarray):
        """The motion with the first contact that covers all waypoints, otherwise with one that covers the most."""
        others, tries = [], 0
        for k, contact in enumerate(instance.contacts):
            reach = self._reach(instance, prepared, multiply_each(waypoints, contact), q)
            if reach == len(waypoints) and tries < TRIES:
                tries += 1
                found = self._motion(instance, contact, waypoints, q)
                if found is not None:
                    return found
            elif 2 <= reach < len(waypoints):
                others.append((-reach, k))
        for reach, k in sorted(others)[:TRIES]:
            found = self._motion(instance, instance.contacts[k], waypoints[:-reach], q)
            if found is not None:
                return found
        return None

    def _motion(self, instance: LoopInstance, contact: np.ndarray, waypoints: np.ndarray, q: np.ndarray):
        motion = _motion(instance, contact, waypoints, q)
        answer = self.solve(motion, self.prepare(motion))
        return (motion, answer.path) if answer.claimed else None

    def _reach(self, instance: LoopInstance, prepared, targets: list[np.ndarray], q: np.ndarray) -> int:
        """Number of leading hand poses (7,) that have configurations; each search starts from the previous one."""
        for count, target in enumerate(targets):
            configuration = _configuration(instance, target, q)
            self.retarget(prepared, configuration)
            answer = self.solve(configuration, prepared)
            if not answer.claimed:
                return count
            q = answer.path[-1]
        return len(targets)


def _robot(instance: LoopInstance):
    return instance.scene.robots["panda"]


def multiply_each(poses: np.ndarray, contact: np.ndarray) -> list[np.ndarray]:
    """The hand poses T_world_ee for object poses and a contact T_obj_ee (7,)."""
    return [multiply(T, contact) for T in poses]


def spaced(poses: np.ndarray) -> np.ndarray:
    """Poses (K, 7) every SPACING along a path (M, 7), including its start and end."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1))])
    marks = np.linspace(0.0, lengths[-1], max(2, int(np.ceil(lengths[-1] / SPACING)) + 1))
    found = []
    for mark in marks:
        k = min(int(np.searchsorted(lengths, mark, side="right")) - 1, len(poses) - 2)
        share = (mark - lengths[k]) / max(lengths[k + 1] - lengths[k], 1e-12)
        found.append(interpolate(poses[k], poses[k + 1], np.clip(share, 0.0, 1.0)))
    return np.array(found)


def _moved(instance: LoopInstance, q: np.ndarray):
    """The scene's robots with the arm at q."""
    return {"panda": replace(_robot(instance), q=q)}


def _configuration(instance: LoopInstance, T_world_ee: np.ndarray, q: np.ndarray) -> MotionInstance:
    """The problem of one hand pose, without the disc: the disc's path is free, and the contact is intended."""
    bodies = {name: body for name, body in instance.scene.bodies.items() if name != DISC}
    scene = replace(instance.scene, bodies=bodies, robots=_moved(instance, q))
    return MotionInstance(
        scene, {"panda": OPENING}, (1,), (Target("panda", 0, T_world_ee),), restarts=CONFIGURATION_RESTARTS, path=False,
        seed=instance.seed,
    )  # fmt: skip


def _motion(instance: LoopInstance, contact: np.ndarray, waypoints: np.ndarray, q: np.ndarray) -> MotionInstance:
    """Reach the contact with the disc at waypoints[0], then carry it to all others (K, 7)."""
    disc = replace(instance.scene.bodies[DISC], pose=waypoints[0])
    scene = replace(instance.scene, bodies=instance.scene.bodies | {DISC: disc}, robots=_moved(instance, q))
    back = Target("panda", 0, multiply(waypoints[0], retracted(contact, APPROACH)), APPROACH_STEPS)
    targets = [Target("panda", phase, T) for phase, T in enumerate(multiply_each(waypoints, contact))]
    attachment = Attachment("panda", DISC, 1, contact, support=TABLE)
    return MotionInstance(
        scene, {"panda": OPENING}, (STEPS,) * len(waypoints), (back, *targets), (attachment,), (("panda", DISC),),
        MOTION_RESTARTS, seed=instance.seed,
    )  # fmt: skip


def judge_loop(instance: LoopInstance, motions: list[tuple[MotionInstance, np.ndarray]]) -> list[str]:
    """Judge a sequence of motions.

    Returns:
        The errors of the motions, and of the transitions between them, in words.
    """
    found = []
    q, pose = _robot(instance).q, instance.scene.bodies[DISC].pose
    for k, (motion, path) in enumerate(motions):
        if np.abs(path[0] - q).max() > CONTINUITY_TOLERANCE or _apart(motion.scene.bodies[DISC].pose, pose):
            found.append(f"motion {k} does not begin where the one before ended")
        found += [f"motion {k}: {text}" for text in judge(motion, path)]
        q = path[-1]
        hand, contact = motion.targets[-1].T_world_ee, motion.attachments[0].T_obj_ee
        pose = multiply(hand, inverse(contact))
    if _apart(pose, instance.scene.goal.pose):
        found.append("the disc does not end at its goal")
    return found


def _apart(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two poses (7,) differ by more than CONTINUITY_TOLERANCE, as rotations and not as quaternions."""
    off, turned = rigid.deviation(rigid.matrices(a[None, 3:]), a[None, :3], rigid.matrices(b[3:]), b[:3])
    return bool(off[0] > CONTINUITY_TOLERANCE or turned[0] > CONTINUITY_TOLERANCE)


def _min_distance(attempt: int) -> float:
    return MIN_DISTANCES[attempt % len(MIN_DISTANCES)]


def _hmap_path(instance: LoopInstance, attempt: int) -> np.ndarray | None:
    scene = instance.scene
    obstacles = tuple(body for name, body in scene.bodies.items() if name != DISC)
    disc = scene.bodies[DISC]
    bounds = np.column_stack([np.reshape(REGION, (2, 2)), np.repeat(disc.pose[2], 2)])
    problem = ObjectPathProblem(
        disc, disc.pose, scene.goal.pose, obstacles, motion="planar", min_distance=_min_distance(attempt), bounds=bounds
    )
    try:
        poses = plan_waypoints(problem, np.random.default_rng([instance.seed, attempt])).poses
    except WaypointError:
        return None
    return _disc_poses(poses[:, :2], disc.pose)


def _disc_poses(waypoints: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Poses (M, 7) of a disc with its centre at points (M, 2); it does not rotate, because it is symmetric."""
    poses = np.tile(start, (len(waypoints), 1))
    poses[:, :2] = waypoints
    return poses


def _rai_path(instance: LoopInstance, attempt: int) -> np.ndarray | None:
    ry = rai_side.robotic()
    scene = instance.scene
    C = ry.Config()
    C.addFrame("world")
    rai_side.add_body(ry, C, scene.bodies[OBSTACLE], rai_side.ROUNDING, False)
    rai_side.add_body(ry, C, _wider(scene.bodies[DISC], _min_distance(attempt)), rai_side.ROUNDING, False)
    start, goal = scene.bodies[DISC].pose, scene.goal.pose
    disc = C.getFrame(DISC).setRelativePose([0.0, 0.0, start[2], 1.0, 0.0, 0.0, 0.0])
    C.addFrame("mover", "world").setJoint(ry.JT.transXY, limits=REGION)
    disc.setParent(C.getFrame("mover"))
    finder = ry.RRT_PathFinder()
    finder.setOptions(verbose=0)
    finder.setProblem(C)
    ry.rnd_seed(ROUNDS * instance.seed + attempt)
    finder.setStartGoal(start[:2], goal[:2])
    result = finder.solve(0)
    if not result.feasible:
        return None
    return _disc_poses(result.x, start)


def _wider(disc: Body, min_distance: float) -> Body:
    """A disc with a larger radius (m), for a search without a minimum distance."""
    radius, height = disc.shapes[0].size
    return replace(disc, shapes=(replace(disc.shapes[0], size=(radius + min_distance, height)),))


HMAP = LoopSide(_hmap_path, hmap_side.prepare, hmap_side.solve, lambda prepared, instance: None)
RAI = LoopSide(_rai_path, rai_side.prepare, rai_side.solve, rai_side.retarget)
