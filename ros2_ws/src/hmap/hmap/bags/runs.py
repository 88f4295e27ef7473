"""The runs in a bag: each goal with its statuses, plans, and what was measured meanwhile."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hmap.bags.reader import Bag, Message
from hmap.conversions import plan_from_message, scene_from_message
from hmap_core.evaluation.executed import Measured
from hmap_core.evaluation.recorded import LATE, RecordedRun, Status
from hmap_core.exceptions import HmapError, InputError
from hmap_core.types import Plan, Scene
from hmap_msgs_py.checks import ConversionError

STATUS, PLAN, SCENE, STATE, JOINTS, DIAGNOSTICS = (
    "planner_status",
    "plan",
    "scene",
    "world_state",
    "joint_states",
    "diagnostics",
)
NEEDED = {
    STATUS: "success, phases, planning and execution times, replans and faults",
    PLAN: "contacts, drift, clearance and the goal",
    SCENE: "the task and seed of goals without a plan",
    STATE: "drift and goal error of objects; joints are then read from joint_states",
    JOINTS: "joints, where there is no world_state",
}
IDLE, ENDED = "idle", ("done", "failed")
POSE = "geometry_msgs/msg/PoseStamped"
WARN = 1  # level of diagnostics
JOINT_PERIOD = 0.02  # s between two joint states that are used, at least: what moves slowly differs from noise
FINGERS = re.compile("finger|gripper|knuckle")


def namespace_of(topics: Sequence[str]) -> str:
    """The namespace of the graph in a bag: that of ``planner_status``, else of another topic that is needed."""
    for name in (STATUS, PLAN, SCENE, STATE, JOINTS):
        found = sorted((topic for topic in topics if topic.endswith(f"/{name}")), key=len)
        if found:
            return found[0].removesuffix(name)
    return "/"


def missing_topics(bag: Bag) -> list[str]:
    """What a bag lacks for an evaluation, with what cannot be said without it."""
    space = namespace_of(list(bag.topics))
    lacks = [name for name in NEEDED if not bag.counts.get(space + name)]
    if STATE not in lacks and JOINTS in lacks:
        lacks.remove(JOINTS)
    return [f"{space}{name} (without it: no {NEEDED[name]})" for name in lacks]


def runs_in(bag: Bag) -> list[RecordedRun]:
    """The goals in a bag, in order.

    Raises:
        InputError: there is none, and nothing that says how one went.
    """
    messages = bag.messages()
    space = namespace_of(list(bag.topics))
    missing = missing_topics(bag)
    by_topic: dict[str, list[Message]] = {}
    for message in messages:
        by_topic.setdefault(message.topic.removeprefix(space), []).append(message)
    goals = _goals(by_topic.get(STATUS, []))
    if not goals:
        needed = "; ".join(missing) or "a goal"
        raise InputError(f"{bag.path}: there is no run in this bag; it lacks {needed}")
    problems: list[str] = []
    plans = _plans(by_topic.get(PLAN, []), problems)
    scenes = _scenes(by_topic.get(SCENE, []), problems)
    last = plans[-1][1].scene if plans else (scenes[-1][1] if scenes else None)
    joints = _joints(by_topic.get(JOINTS, []), last, [] if by_topic.get(STATE) else problems)
    measured = _measured(by_topic, bag, last, joints, problems)
    found = []
    for number, goal in enumerate(goals, 1):
        # a recorder that is started in the middle of a goal gets its plan, which is latched, at once
        begin = goal[0].time if number > 1 or goal[0].elapsed <= LATE else -np.inf
        end = goals[number][0].time if number < len(goals) else np.inf
        own = [(time, plan) for time, plan in plans if begin - 1e-9 <= time < end]
        scene = next((scene for time, scene in reversed(scenes) if time <= goal[-1].time), None)
        scene = own[0][1].scene if own else scene
        faults = _faults(goal, by_topic.get(DIAGNOSTICS, []))
        lacks = (*missing, *bag.problems, *problems)
        task, seed = (scene.task, scene.seed) if scene is not None else ("", None)
        run = RecordedRun(str(bag.path), number, task, seed, tuple(goal), tuple(own), measured, joints, faults, lacks)
        found.append(run)
    return found


def _seconds(stamp: Any) -> float:
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)


def _goals(messages: Sequence[Message]) -> list[list[Status]]:
    """The statuses of each goal: a goal begins where the time since its acceptance begins anew."""
    goals: list[list[Status]] = []
    ended = True
    for message in messages:
        data = message.data
        status = Status(_seconds(data.header.stamp), data.phase, float(data.elapsed), data.text)
        if status.phase == IDLE:
            ended = True
            continue
        if ended or status.elapsed < goals[-1][-1].elapsed - 1e-6:
            goals.append([])
        goals[-1].append(status)
        ended = status.phase in ENDED
    return goals


def _plans(messages: Sequence[Message], problems: list[str]) -> list[tuple[float, Plan]]:
    found: list[tuple[float, Plan]] = []
    for message in messages:
        try:
            found.append((_seconds(message.data.header.stamp), plan_from_message(message.data)))
        except (HmapError, ConversionError) as error:
            problems.append(f"a plan cannot be read: {error}")
    return found


def _scenes(messages: Sequence[Message], problems: list[str]) -> list[tuple[float, Scene]]:
    found: list[tuple[float, Scene]] = []
    for message in messages:
        try:
            found.append((message.time, scene_from_message(message.data)))
        except (HmapError, ConversionError) as error:
            problems.append(f"a scene cannot be read: {error}")
    return found


def _faults(goal: Sequence[Status], diagnostics: Sequence[Message]) -> tuple[str, ...]:
    """What was wrong during a goal: why it failed or was planned anew, and what nodes warned of, each once."""
    texts = [f"{s.phase}: {s.text}" for s in goal if s.phase in ("failed", "replanning", "stopping") and s.text]
    for message in diagnostics:
        if not goal[0].time <= _seconds(message.data.header.stamp) <= goal[-1].time:
            continue
        for status in message.data.status:
            problems = [entry.value for entry in status.values if entry.key == "problems"]
            texts += [f"{status.name}: {text}" for text in problems]
            if ord(status.level) if isinstance(status.level, bytes) else int(status.level) > WARN:
                texts.append(f"{status.name}: {status.message}")
    return tuple(dict.fromkeys(texts))


# what was measured


def _measured(
    by_topic: Mapping[str, Sequence[Message]],
    bag: Bag,
    scene: Scene | None,
    joints: Measured | None,
    problems: list[str],
) -> Measured | None:
    """From ``world_state``, else from ``joint_states`` and what poses there are."""
    if by_topic.get(STATE):
        return _from_states(by_topic[STATE], problems)
    if scene is None or joints is None:
        return None
    poses = {}
    for topic, messages in by_topic.items():
        kind = bag.topics.get(messages[0].topic)
        body = next((name for name in scene.bodies if name in topic.split("/")), None)
        if kind == POSE and body is not None:
            at = np.array([_seconds(m.data.header.stamp) for m in messages])
            rows = np.array([_pose(m.data.pose) for m in messages])
            kept = np.isfinite(rows).all(axis=1)
            if kept.any():
                nearest = np.searchsorted(at[kept], joints.time, side="right").clip(1) - 1
                poses[body] = rows[kept][nearest]
    if not poses:
        problems.append("no poses of bodies: no drift, no goal error")
    return Measured(joints.time, joints.joints, joints.gripper, poses)


def _from_states(messages: Sequence[Message], problems: list[str]) -> Measured:
    """Joints, openings and poses; only robots and bodies that are in every state of the last kind."""
    ordered = _increasing([(_seconds(m.data.header.stamp), m.data) for m in messages])
    last = ordered[-1][1]
    robots = [robot.name for robot in last.robots]
    bodies = [body.name for body in last.bodies]
    time: list[float] = []
    joints: dict[str, list] = {name: [] for name in robots}
    gripper: dict[str, list] = {name: [] for name in robots}
    poses: dict[str, list] = {name: [] for name in bodies}
    bad = 0
    for at, data in ordered:
        arms, things = {r.name: r for r in data.robots}, {b.name: b for b in data.bodies}
        if arms.keys() != set(robots) or not things.keys() >= set(bodies):
            continue  # of another task, or before a body came
        if not all(np.isfinite(r.position).all() for r in arms.values()):
            bad += 1
            continue
        time.append(at)
        for name in robots:
            joints[name].append(np.asarray(arms[name].position, float))
            gripper[name].append(float(arms[name].gripper_opening))
        for name in bodies:
            poses[name].append(_pose(things[name].pose))
    if bad:
        problems.append(f"{bad} world states with joints that are not finite were left out")
    tables = ({n: np.array(rows) for n, rows in table.items()} for table in (joints, gripper, poses))
    return Measured(np.array(time), *tables)


def _joints(messages: Sequence[Message], scene: Scene | None, problems: list[str]) -> Measured | None:
    """The joints of ``joint_states`` by name, JOINT_PERIOD apart at least; without openings and poses."""
    if scene is None or not messages:
        return None
    names = {name for message in messages for name in message.data.name}
    wanted = {}
    for robot, placed in scene.robots.items():
        found = wire_names(robot, placed.model.joint_names, names, len(scene.robots) == 1)
        if found is None:
            problems.append(f"joint_states has none of the joints of '{robot}': {', '.join(sorted(names)[:8])}")
            return None
        wanted[robot] = found
    now: dict[str, float] = {}
    time: list[float] = []
    rows: dict[str, list] = {robot: [] for robot in wanted}
    for at, data in _increasing([(_seconds(m.data.header.stamp), m.data) for m in messages]):
        now.update({n: p for n, p in zip(data.name, data.position, strict=False) if np.isfinite(p)})
        late = not time or at >= time[-1] + JOINT_PERIOD - 1e-6
        if late and all(name in now for found in wanted.values() for name in found):
            time.append(at)
            for robot, found in wanted.items():
                rows[robot].append([now[name] for name in found])
    return Measured(np.array(time), {robot: np.array(q) for robot, q in rows.items()})


def wire_names(robot: str, joints: Sequence[str], names: set[str], alone: bool) -> list[str] | None:
    """The names of a robot's joints in ``joint_states``, whatever the driver calls them; None: they are not there.

    Args:
        robot: its name.
        joints: names in its description, base to tip.
        names: that were recorded.
        alone: whether it is the only robot; then equal numbers at the end are enough.
    """
    for pattern in ("{robot}_{joint}", "{joint}", "{robot}/{joint}"):
        found = [pattern.format(robot=robot, joint=joint) for joint in joints]
        if names.issuperset(found):
            return found
    if not alone:
        return None
    arm = {name for name in names if not FINGERS.search(name)}
    by_number = {match[0]: name for name in arm if (match := re.search(r"\d+$", name))}
    if len(by_number) != len(arm):
        return None
    numbers = [str(k) for k in range(1, len(joints) + 1)]
    return [by_number[k] for k in numbers] if by_number.keys() >= set(numbers) else None


def _increasing(stamped: list[tuple[float, Any]]) -> list[tuple[float, Any]]:
    """In the order of stamps; of equal ones the first."""
    kept: list[tuple[float, Any]] = []
    for at, data in sorted(stamped, key=lambda entry: entry[0]):
        if not kept or at > kept[-1][0]:
            kept.append((at, data))
    return kept


def _pose(pose: Any) -> np.ndarray:
    p, q = pose.position, pose.orientation
    return np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w], float)
