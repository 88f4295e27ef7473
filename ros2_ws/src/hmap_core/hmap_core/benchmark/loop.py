"""The loop of H-MaP for both sides: the object's path, waypoints on it, contacts that serve for some of them, motions.

What plans the object's path, finds configurations and optimises motions is a side's own; the loop is the same for both.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hmap_core.benchmark import hmap_side, rai_side
from hmap_core.benchmark.instances import Answer, MotionInstance, Ride, Target
from hmap_core.benchmark.judge import judge
from hmap_core.benchmark.problems.common import TABLE
from hmap_core.benchmark.problems.puck import APPROACH, APPROACH_STEPS, DISC, OBSTACLE, LoopInstance
from hmap_core.benchmark.sampling import drawn_back
from hmap_core.exceptions import WaypointError
from hmap_core.transforms import interpolate, inverse, multiply
from hmap_core.types import Body
from hmap_core.validation import rigid
from hmap_core.waypoints import ObjectPathProblem, plan_waypoints

ROUNDS = 6  # object paths tried, each for the whole task
# m that an object path keeps from what stands around, round by round: the shortest way leaves the hand no room
MARGINS = (0.002, 0.05)
SPACING = 0.15  # m between two waypoints
STEPS = 10  # of each phase: reach, and one for each waypoint that the contact serves for
POSTURE_RESTARTS = 4
MOTION_RESTARTS = 1
TRIES = 3  # motions with contacts that serve to the end, and with such that serve for a part of the way
OPENING = 0.0  # m: a fingertip carries the disc
REGION = [0.2, -0.6, 0.9, 0.6]  # m, in which both sides look for object paths: lower x and y, upper x and y
JOINED = 1e-3  # m or rad: how well each motion has to begin where the last one ended


@dataclass(frozen=True)
class LoopSide:
    """What a side brings to the loop.

    Attributes:
        object_path: (instance, round) -> poses (M, 7) from start to goal, or None; another in each round.
        prepare, solve: as of a motion problem.
        retarget: moves targets of something prepared to those of another instance.
    """

    object_path: Callable[[LoopInstance, int], np.ndarray | None]
    prepare: Callable
    solve: Callable[..., Answer]
    retarget: Callable

    def configurations(self, instance: LoopInstance):
        """What finding configurations needs; outside of the clock, as it is the same for all of them."""
        return self.prepare(_configuration(instance, instance.scene.bodies[DISC].pose, _robot(instance).q))

    def run(self, instance: LoopInstance, prepared) -> Answer:
        """The loop; its path is a list of (motion instance, path)."""
        for attempt in range(ROUNDS):
            poses = self.object_path(instance, attempt)
            done = None if poses is None else self._along(instance, prepared, spaced(poses))
            if done is not None:
                return Answer(True, done)
        return Answer(False)

    def _along(
        self, instance: LoopInstance, prepared, places: np.ndarray
    ) -> list[tuple[MotionInstance, np.ndarray]] | None:
        """The motions that carry the disc to places (K, 7), the start first; None where some place is not reached."""
        done: list[tuple[MotionInstance, np.ndarray]] = []
        q, at = _robot(instance).q, 0
        while at + 1 < len(places):
            step = self._carried(instance, prepared, places[at:], q)
            if step is None:
                return None
            done.append(step)
            q, at = step[1][-1], at + len(step[0].steps_per_phase) - 1
        return done

    def _carried(self, instance: LoopInstance, prepared, places: np.ndarray, q: np.ndarray):
        """The motion with the first contact that serves to the end, else with those that serve farthest."""
        others, tries = [], 0
        for k, contact in enumerate(instance.contacts):
            reach = self._reach(instance, prepared, multiply_each(places, contact), q)
            if reach == len(places) and tries < TRIES:
                tries += 1
                found = self._motion(instance, contact, places, q)
                if found is not None:
                    return found
            elif 2 <= reach < len(places):
                others.append((-reach, k))
        for reach, k in sorted(others)[:TRIES]:
            found = self._motion(instance, instance.contacts[k], places[:-reach], q)
            if found is not None:
                return found
        return None

    def _motion(self, instance: LoopInstance, contact: np.ndarray, places: np.ndarray, q: np.ndarray):
        motion = _motion(instance, contact, places, q)
        answer = self.solve(motion, self.prepare(motion))
        return (motion, answer.path) if answer.claimed else None

    def _reach(self, instance: LoopInstance, prepared, targets: list[np.ndarray], q: np.ndarray) -> int:
        """How many of the first hand poses (7,) there are configurations for, each found from the one before."""
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
    return [multiply(T, contact) for T in poses]


def spaced(poses: np.ndarray) -> np.ndarray:
    """Poses (K, 7) every SPACING along a path (M, 7), its start and end among them."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1))])
    marks = np.linspace(0.0, lengths[-1], max(2, int(np.ceil(lengths[-1] / SPACING)) + 1))
    found = []
    for mark in marks:
        k = min(int(np.searchsorted(lengths, mark, side="right")) - 1, len(poses) - 2)
        share = (mark - lengths[k]) / max(lengths[k + 1] - lengths[k], 1e-12)
        found.append(interpolate(poses[k], poses[k + 1], np.clip(share, 0.0, 1.0)))
    return np.array(found)


def _moved(instance: LoopInstance, q: np.ndarray):
    """The robots of the scene with the arm at q."""
    return {"panda": replace(_robot(instance), q=q)}


def _configuration(instance: LoopInstance, T_world_ee: np.ndarray, q: np.ndarray) -> MotionInstance:
    """A configuration of the hand without the disc: the disc's own path is free, and the contact is one."""
    bodies = {name: body for name, body in instance.scene.bodies.items() if name != DISC}
    scene = replace(instance.scene, bodies=bodies, robots=_moved(instance, q))
    return MotionInstance(
        scene, {"panda": OPENING}, (1,), (Target("panda", 0, T_world_ee),), restarts=POSTURE_RESTARTS, path=False,
        seed=instance.seed,
    )  # fmt: skip


def _motion(instance: LoopInstance, contact: np.ndarray, places: np.ndarray, q: np.ndarray) -> MotionInstance:
    """Reach the contact with the disc at places[0], then carry it to all others (K, 7)."""
    disc = replace(instance.scene.bodies[DISC], pose=places[0])
    scene = replace(instance.scene, bodies=instance.scene.bodies | {DISC: disc}, robots=_moved(instance, q))
    back = Target("panda", 0, multiply(places[0], drawn_back(contact, APPROACH)), APPROACH_STEPS)
    targets = [Target("panda", phase, T) for phase, T in enumerate(multiply_each(places, contact))]
    ride = Ride("panda", DISC, 1, contact, support=TABLE)
    return MotionInstance(
        scene, {"panda": OPENING}, (STEPS,) * len(places), (back, *targets), (ride,), (("panda", DISC),),
        MOTION_RESTARTS, seed=instance.seed,
    )  # fmt: skip


def judge_loop(instance: LoopInstance, motions: list[tuple[MotionInstance, np.ndarray]]) -> list[str]:
    """What is wrong with the motions, one after the other, and with how they follow each other."""
    found = []
    q, pose = _robot(instance).q, instance.scene.bodies[DISC].pose
    for k, (motion, path) in enumerate(motions):
        if np.abs(path[0] - q).max() > JOINED or _apart(motion.scene.bodies[DISC].pose, pose):
            found.append(f"motion {k} does not begin where the one before ended")
        found += [f"motion {k}: {text}" for text in judge(motion, path)]
        q = path[-1]
        hand, contact = motion.targets[-1].T_world_ee, motion.rides[0].T_obj_ee
        pose = multiply(hand, inverse(contact))
    if _apart(pose, instance.scene.goal.pose):
        found.append("the disc does not end at its goal")
    return found


def _apart(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two poses (7,) differ by more than JOINED; a quaternion and its negative are one rotation."""
    off, turned = rigid.deviation(rigid.matrices(a[None, 3:]), a[None, :3], rigid.matrices(b[3:]), b[:3])
    return bool(off[0] > JOINED or turned[0] > JOINED)


def _margin(attempt: int) -> float:
    return MARGINS[attempt % len(MARGINS)]


def _hmap_path(instance: LoopInstance, attempt: int) -> np.ndarray | None:
    scene = instance.scene
    obstacles = tuple(body for name, body in scene.bodies.items() if name != DISC)
    disc = scene.bodies[DISC]
    bounds = np.column_stack([np.reshape(REGION, (2, 2)), np.repeat(disc.pose[2], 2)])
    problem = ObjectPathProblem(
        disc, disc.pose, scene.goal.pose, obstacles, motion="planar", min_distance=_margin(attempt), bounds=bounds
    )
    try:
        poses = plan_waypoints(problem, np.random.default_rng([instance.seed, attempt])).poses
    except WaypointError:
        return None
    return _of_middle(poses[:, :2], disc.pose)


def _of_middle(places: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Poses (M, 7) of a disc whose middle is at places (M, 2): it is the same however it is turned, so it is not."""
    poses = np.tile(start, (len(places), 1))
    poses[:, :2] = places
    return poses


def _rai_path(instance: LoopInstance, attempt: int) -> np.ndarray | None:
    ry = rai_side.robotic()
    scene = instance.scene
    C = ry.Config()
    C.addFrame("world")
    rai_side.add_body(ry, C, scene.bodies[OBSTACLE], rai_side.ROUNDING, False)
    rai_side.add_body(ry, C, _wider(scene.bodies[DISC], _margin(attempt)), rai_side.ROUNDING, False)
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
    return _of_middle(result.x, start)


def _wider(disc: Body, min_distance: float) -> Body:
    """A disc with a larger radius (m), for a search that keeps no minimum distance by itself."""
    radius, height = disc.shapes[0].size
    return replace(disc, shapes=(replace(disc.shapes[0], size=(radius + min_distance, height)),))


HMAP = LoopSide(_hmap_path, hmap_side.prepare, hmap_side.solve, lambda prepared, instance: None)
RAI = LoopSide(_rai_path, rai_side.prepare, rai_side.solve, rai_side.retarget)
