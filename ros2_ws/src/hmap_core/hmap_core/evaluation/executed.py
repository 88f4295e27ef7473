"""What was executed of a plan, from measured joints and poses: lengths, smoothness, drift and clearance."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from hmap_core import plan_file, transforms
from hmap_core.kinematics.arm import load_arm
from hmap_core.types import Plan, SegmentKind

LAG = 0.3  # s by which poses may be older or newer than joints
NOISE = 5e-4  # rad; joints that move less between two samples stand
FIT_WINDOW = 0.3  # s of samples to which a cubic is fitted, whose third derivative is the jerk
FIT_LEAST = 5  # samples in it at least; a cubic has 4 coefficients
SHORTEST = 5  # samples of which something can be said


@dataclass(frozen=True)
class Measured:
    """What was measured while a plan was executed.

    Attributes:
        time: (M,) s, increasing.
        joints: robot -> (M, n) rad.
        gripper: robot -> (M,) openings, m.
        poses: body -> (M, 7); empty where no poses were recorded.
    """

    time: np.ndarray
    joints: Mapping[str, np.ndarray]
    gripper: Mapping[str, np.ndarray] = field(default_factory=dict)
    poses: Mapping[str, np.ndarray] = field(default_factory=dict)

    def between(self, begin: float, end: float) -> "Measured":
        """What was measured from one time (s) to another."""
        rows = (self.time >= begin) & (self.time <= end)

        def cut(tables: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
            return {name: table[rows] for name, table in tables.items()}

        return Measured(self.time[rows], cut(self.joints), cut(self.gripper), cut(self.poses))

    def moving(self) -> np.ndarray:
        """(M-1,) whether any joint moves to the next sample."""
        steps = [np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0) > NOISE for q in self.joints.values()]
        return np.any(steps, axis=0) if steps else np.zeros(max(0, len(self.time) - 1), bool)


def progress(plan: Plan, measured: Measured, anywhere: bool = False) -> np.ndarray:
    """The sample (M,) of the plan at which each measured sample is, never going back.

    The joints of all robots are compared by dynamic programming with a free end, as in dynamic time warping (Sakoe and
    Chiba, "Dynamic programming algorithm optimization for spoken word recognition", 1978): the sum of the distances is
    the smallest.

    Args:
        plan: that was executed.
        measured: joints.
        anywhere: whether it can begin in the middle of the plan.
    """
    robots = [name for name in plan.trajectory.joints if name in measured.joints]
    planned = np.concatenate([plan.trajectory.joints[name] for name in robots], axis=1)
    actual = np.concatenate([measured.joints[name] for name in robots], axis=1)
    count = len(planned)
    cost = np.zeros(count)
    if not anywhere:
        cost[1:] = np.inf
    from_ = np.zeros((len(actual), count), np.int32)
    for j, q in enumerate(actual):
        best = np.minimum.accumulate(cost)
        from_[j] = np.maximum.accumulate(np.where(cost == best, np.arange(count), 0))
        cost = best + np.linalg.norm(planned - q, axis=1)
    at = np.empty(len(actual), int)
    k = int(cost.argmin())
    for j in range(len(actual) - 1, -1, -1):
        at[j] = k
        k = from_[j, k]
    return at


def joint_length(measured: Measured) -> float:
    """Length of the joint paths of all robots, rad; without the noise of standing joints."""
    steps = [np.linalg.norm(np.diff(q, axis=0), axis=1) for q in measured.joints.values()]
    return float(sum(step[step > NOISE].sum() for step in steps))


def tip_length(plan: Plan, measured: Measured) -> float:
    """Length of the paths of all end-effectors, m."""
    total = 0.0
    for name, q in measured.joints.items():
        moves = np.abs(np.diff(q, axis=0)).max(axis=1, initial=0.0) > NOISE
        tips = load_arm(plan.scene.robots[name].model).end_effectors(q)[:, :3]
        total += float(np.linalg.norm(np.diff(tips, axis=0), axis=1)[moves].sum())
    return total


def jerk(measured: Measured) -> float | None:
    """Root mean square of the joints' jerk while they move, rad/s^3, of cubics fitted to FIT_WINDOW; None: none."""
    values = []
    moving = measured.moving()
    for q in measured.joints.values():
        for first in range(0, len(measured.time) - FIT_LEAST):
            last = int(np.searchsorted(measured.time, measured.time[first] + FIT_WINDOW, side="right"))
            if last - first < FIT_LEAST or not moving[first : last - 1].all():
                continue
            t = measured.time[first:last] - measured.time[first]
            values.append(6.0 * np.polyfit(t, q[first:last], 3)[0])
    return float(np.sqrt(np.mean(np.square(values)))) if values else None


@dataclass(frozen=True)
class Drift:
    """How far the execution was off its plan, at most.

    Attributes:
        joints: rad.
        object: m, of the goal's object; None without poses.
    """

    joints: float
    object: float | None


def drift(plan: Plan, measured: Measured, at: np.ndarray) -> Drift:
    """How far what was measured is off the plan at its samples ``at`` (M,)."""
    off = [np.abs(plan.trajectory.joints[name][at] - q).max(initial=0.0) for name, q in measured.joints.items()]
    name = plan.scene.goal.object
    planned = plan.trajectory.objects.get(name)
    away = None
    if name in measured.poses and planned is not None:
        away = max(_off_path(planned[:, :3], p, k, plan) for p, k in zip(measured.poses[name][:, :3], at, strict=True))
    return Drift(float(max(off, default=0.0)), away)


def _off_path(path: np.ndarray, p: np.ndarray, k: int, plan: Plan) -> float:
    """How far (m) a place is off a path (K, 3) near its sample k; poses and joints are not of quite the same time."""
    return float(np.linalg.norm(path[_nearest(path, p, k, plan)] - p))


def _nearest(path: np.ndarray, p: np.ndarray, k: int, plan: Plan) -> int:
    """The sample of a path (K, 3), at most LAG from its sample k, that is nearest to a place."""
    first, last = np.searchsorted(plan.trajectory.time, plan.trajectory.time[k] + np.array([-LAG, LAG]))
    return int(first) + int(np.linalg.norm(path[first:last] - p, axis=1).argmin())


def goal_error(plan: Plan, measured: Measured) -> tuple[float, float] | None:
    """How far (m, deg) the object is from its goal at the end; None without poses."""
    goal = plan.scene.goal
    if goal.object not in measured.poses or not len(measured.time):
        return None
    distance, angle = transforms.distance(goal.pose, measured.poses[goal.object][-1])
    return float(distance), float(np.rad2deg(angle))


def contacts_begun(plan: Plan, at: np.ndarray) -> int:
    """How many contacts were begun up to the last sample of the plan that was reached."""
    reached = plan.trajectory.time[int(at[-1])]
    ordered = sorted((s for s in plan.segments if s.kind is not SegmentKind.TRANSIT), key=lambda s: s.start)
    begun = [s for s in ordered if s.start < reached]
    last: dict[str, tuple] = {}
    count = 0
    for segment in begun:
        before = last.get(segment.robot)
        key = (segment.manipulator, segment.object, segment.kind)
        count += before is None or before[0] != key or segment.start > before[1] + 1e-6
        last[segment.robot] = key, segment.end
    return count


def clearance(plan: Plan, measured: Measured, at: np.ndarray) -> float | None:
    """The smallest distance between what must not touch, by the judge, on the measured joints and poses, m.

    The measured samples stand where the plan has them, so that the judge knows which contacts are meant. Two of them
    can be a second apart, and a straight line between them would cut corners. The motion there is that of the plan,
    with what was off it interpolated.
    """
    from hmap_core.validation import executed_clearance  # slow to import

    end = max(int(at[-1]), 1)
    kept = plan.trajectory.time[: end + 1]
    segments = [replace(s, end=min(s.end, float(kept[-1]))) for s in plan.segments if s.start < kept[-1]]
    cut = replace(plan, trajectory=_cut(plan, end), segments=tuple(segments))
    executed = replace(cut, trajectory=_executed(cut, measured, at))
    return executed_clearance(plan_file.to_dict(cut), plan_file.to_dict(executed))


def _executed(plan: Plan, measured: Measured, at: np.ndarray):
    """The trajectory of a plan with what was off it, from its samples ``at`` (M,) of the measured ones."""
    trajectory = plan.trajectory
    first_of_reversed = np.unique(at[::-1], return_index=True)
    samples, rows = first_of_reversed[0], len(at) - 1 - first_of_reversed[1]  # of several in one sample, the last
    steps = np.arange(len(trajectory.time))

    def spread(off: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(steps, samples, column) for column in off.T], axis=1)

    joints, gripper, objects = dict(trajectory.joints), dict(trajectory.gripper), dict(trajectory.objects)
    for name, q in measured.joints.items():
        joints[name] = joints[name] + spread(q[rows] - joints[name][samples])
    for name, w in measured.gripper.items():
        if name in gripper:
            gripper[name] = gripper[name] + spread((w[rows] - gripper[name][samples])[:, None])[:, 0]
    for name, T in measured.poses.items():
        if name in objects:
            objects[name] = _executed_poses(plan, objects[name], T[rows], samples, spread)
    return replace(trajectory, joints=joints, gripper=gripper, objects=objects)


def _executed_poses(
    plan: Plan,
    planned: np.ndarray,
    poses: np.ndarray,
    samples: np.ndarray,
    spread: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """Poses (K, 7) of an object: the planned ones with what was off them; being late is not being off."""
    near = [_nearest(planned[:, :3], p[:3], k, plan) for p, k in zip(poses, samples, strict=True)]
    shift = spread(poses[:, :3] - planned[near, :3])
    turned = Rotation.from_quat(poses[:, 3:]) * Rotation.from_quat(planned[near, 3:]).inv()
    turn = Rotation.from_rotvec(spread(turned.as_rotvec())) * Rotation.from_quat(planned[:, 3:])
    return np.concatenate([planned[:, :3] + shift, turn.as_quat()], axis=1)


def _cut(plan: Plan, end: int):
    """The trajectory of a plan up to a sample."""
    full, rows = plan.trajectory, slice(0, end + 1)

    def first(tables: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        return {name: table[rows] for name, table in tables.items()}

    return replace(
        full, time=full.time[rows], joints=first(full.joints), gripper=first(full.gripper), objects=first(full.objects)
    )
