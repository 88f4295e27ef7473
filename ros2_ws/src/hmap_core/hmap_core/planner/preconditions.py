"""Preconditions of planning: checked before any search, so that errors are reported at once and name the body."""

from dataclasses import replace

import numpy as np

from hmap_core.collision.convex import ConvexSet, set_distance
from hmap_core.contacts.grip_width import grip_problem
from hmap_core.exceptions import Code, ContactError, InputError, WaypointError
from hmap_core.kinematics.arm import load_arm
from hmap_core.komo.allowances import OVERLAP_ALLOWED
from hmap_core.komo.shapes import body_set
from hmap_core.komo.surroundings import robot_set
from hmap_core.planner.attainable_goal import TOUCHING, attainable_goal, stands_there
from hmap_core.planner.loads import changes_height, no_robot_moves, tilts
from hmap_core.planner.obstruction import carried_by, stacked_on
from hmap_core.planner.segments import standing_collision
from hmap_core.planner.tools import extent
from hmap_core.stability.stacks import OFF_CENTRE, stack_tips
from hmap_core.transforms import IDENTITY, apply, distance
from hmap_core.types import BodyKind, Goal, Scene, SceneState, TaskMode
from hmap_core.waypoints.checker import PENETRATION_ALLOWED

HANGING = 0.005  # m: in a physical task, a body that is farther than this from all others falls
AT_GOAL = 1e-6  # m and rad; an object that is nearer to its goal stays where it is
GROUPS = {BodyKind.FIXED: "fixed", BodyKind.MOVABLE: "movable", BodyKind.TOOL: "tools"}  # keys of a task file


def check_goal(scene: Scene, goal: Goal) -> None:
    """Raises InputError UNKNOWN_OBJECT unless the goal is about a body that may be moved."""
    body = scene.bodies.get(goal.object)
    if body is None or body.kind == BodyKind.FIXED:
        movable = ", ".join(n for n, b in scene.bodies.items() if b.kind != BodyKind.FIXED)
        raise InputError(f"goal object '{goal.object}' cannot be moved; allowed: {movable}", Code.UNKNOWN_OBJECT)


def check_robots(scene: Scene, state: SceneState, object: str) -> None:
    """Raises InputError where a robot stands in something.

    Args:
        scene: with what the robots hold as parts of their hands.
        object: that is to be handled.
    """
    for name in scene.robots:
        hit = standing_collision(scene, state, name, object)
        if hit is not None:
            raise InputError(
                f"robot '{name}' starts {hit[1] * 1e3:.2f} mm inside: {' and '.join(hit[0])} overlap; "
                f"at most {OVERLAP_ALLOWED * 1e3:g} mm is allowed",
                Code.START_IN_COLLISION,
            )


def check_bodies(scene: Scene, goal: Goal) -> None:
    """Checks the start poses of the bodies of a task, and the goal pose.

    Measured states are not checked, since sensors and simulation are not exact.

    Raises:
        InputError: START_IN_COLLISION, a movable body penetrates another body or a robot; INVALID_SCENE, a movable
            body has no support in a physical task; INVALID_POSE, the goal pose has no support.
    """
    state = scene.start_state()
    robots = _robot_sets(scene, state)
    for name, body in scene.bodies.items():
        if body.kind == BodyKind.FIXED:
            continue
        key = f"{GROUPS[body.kind]}.{name}.pose"
        near = _distances(scene, state, robots, name, body.pose)
        if near and near[0][0] < -PENETRATION_ALLOWED:
            depth, other = near[0]
            raise InputError(
                f"'{name}' penetrates {other} by {-1e3 * depth:.1f} mm at its start ({key}); "
                f"at most {1e3 * PENETRATION_ALLOWED:g} mm is allowed",
                Code.START_IN_COLLISION,
            )
        if scene.mode == TaskMode.PHYSICAL:
            _check_hanging(near, f"'{name}' has no support at its start ({key})", HANGING, Code.INVALID_SCENE)
    check_goal_support(scene, state, goal)


def check_goal_support(scene: Scene, state: SceneState, goal: Goal) -> None:
    """Checks that the object of a physical task has a support at its goal.

    Raises:
        InputError: INVALID_POSE; it has none, within the goal's tolerance neither, or what carries it would tip.
    """
    if scene.mode == TaskMode.PHYSICAL:
        there, _ = attainable_goal(scene, state, goal)
        near = _distances(scene, state, _robot_sets(scene, state), goal.object, there.pose)
        what = f"'{goal.object}' would have no support at its goal (goal.pose)"
        _check_hanging(near, what, TOUCHING, Code.INVALID_POSE)
        if not stands_there(scene, state, goal.object, there.pose):
            raise InputError(
                f"'{goal.object}' would not stay at its goal (goal.pose) by itself: it stands on no face there with "
                f"its centre of mass over {near[0][1]}, and nothing keeps it from tipping, sliding or rolling. "
                "Move the goal, turn it, or add a body that keeps it there",
                Code.INVALID_POSE,
            )
        _check_stack(scene, state, Goal(goal.object, there.pose))


def _check_stack(scene: Scene, state: SceneState, goal: Goal) -> None:
    """Raises InputError INVALID_POSE where an object would make a stack tip, with its removable bodies or without."""
    bodies = {name: replace(body, pose=state.poses[name]) for name, body in scene.bodies.items()}
    left = {name: body for name, body in bodies.items() if name == goal.object or name not in scene.removable}
    tips = stack_tips(left, goal.object, goal.pose)
    if tips and stack_tips(bodies, goal.object, goal.pose):
        names = " and ".join(f"'{name}'" for name in tips[1:])
        raise InputError(
            f"'{goal.object}' at its goal (goal.pose) would make what it stands on tip: {names}; forces do not balance "
            f"with {1e3 * OFF_CENTRE:g} mm to spare. Move the goal towards the middle of its support",
            Code.INVALID_POSE,
        )


def _robot_sets(scene: Scene, state: SceneState) -> dict[str, ConvexSet]:
    """The links of all robots in the world."""
    return {name: robot_set(robot, state.q[name], state.gripper[name]) for name, robot in scene.robots.items()}


def _check_hanging(near: list[tuple[float, str]], what: str, allowed: float, code: Code) -> None:
    if not near or near[0][0] > allowed:
        nearest = f"{near[0][1]} is the nearest, {1e3 * near[0][0]:.0f} mm away" if near else "nothing is around"
        raise InputError(f"{what}: {nearest}; at most {1e3 * allowed:g} mm is allowed in a physical task", code)


def _distances(
    scene: Scene, state: SceneState, robots: dict[str, ConvexSet], name: str, T: np.ndarray
) -> list[tuple[float, str]]:
    """How far (m) a body at T (7,) is from each other body and robot, and their names for people, the nearest first.

    ``robots`` are their links in the world.
    """
    own = body_set(scene.bodies[name])
    bodies = [(body_set(b), state.poses[other], f"'{other}'") for other, b in scene.bodies.items() if other != name]
    around = bodies + [(links, IDENTITY, f"robot '{robot}'") for robot, links in robots.items()]
    return sorted((set_distance(own, T, other, place), what) for other, place, what in around)


def check_weight(scene: Scene, state: SceneState, goal: Goal) -> None:
    """Checks that one robot, or two together, can move an object by its weight: grip force and payload.

    Raises:
        ContactError: NO_CONTACT; none can, with the forces.
    """
    problem = no_robot_moves(scene, goal.object, state.poses[goal.object], goal)
    if problem:
        raise ContactError(problem, Code.NO_CONTACT)


def check_grip(scene: Scene, state: SceneState, goal: Goal) -> None:
    """Checks that some gripper can hold an object that has to be brought to another height, by its width alone.

    What is turned over as well is not checked, since it might be tilted over an edge.

    Raises:
        ContactError: NO_CONTACT; no gripper can, with the widths.
    """
    start = state.poses[goal.object]
    if not changes_height(start, goal) or tilts(start, goal):
        return
    problem = grip_problem(scene, goal.object, scene.robots)
    if problem:
        rise = 1e3 * (goal.pose[2] - start[2])
        raise ContactError(f"'{goal.object}' has to be lifted to its goal, {rise:+.0f} mm; {problem}", Code.NO_CONTACT)


def check_loads(scene: Scene, state: SceneState, goal: Goal, attached: str | None = None) -> None:
    """Checks that whatever stands on an object that has to move may be moved away.

    Args:
        scene: the task.
        state: where everything is.
        goal: of the object.
        attached: name of the tool that a robot holds, which stands on nothing.

    Raises:
        WaypointError: NO_OBJECT_PATH; a body that may not be moved would fall.
    """
    if max(distance(state.poses[goal.object], goal.pose)) < AT_GOAL:
        return
    bearers = [goal.object]
    for load in stacked_on(scene, state, goal.object):
        if load not in scene.removable and load != attached:
            below = next(name for name in reversed(bearers) if load in carried_by(scene, state, name))
            raise WaypointError(
                f"'{below}' carries '{load}', which would fall and may not be moved: list it under `removable` in the "
                "task, or start with it elsewhere",
                Code.NO_OBJECT_PATH,
            )
        bearers.append(load)


def check_reach(scene: Scene, state: SceneState, goal: Goal) -> None:
    """Checks that arms are long enough for an object at its start and its goal, and to pass it on in between.

    By their span and that of the tools alone: whether a hand can come to it otherwise is not asked.

    Raises:
        ContactError: OUT_OF_REACH; all arms are too short for one end, or no chain of arms joins both.
    """
    tools = [extent(scene, n) for n, b in scene.bodies.items() if b.kind == BodyKind.TOOL and n != goal.object]
    own, longest = extent(scene, goal.object), max(tools, default=0.0)
    with_tools = " with the longest tool" if tools else ""
    shoulder, reach = {}, {}
    for name, robot in scene.robots.items():
        arm = load_arm(robot.model)
        shoulder[name] = apply(robot.base_pose, arm.p_joint[0])
        reach[name] = arm.length + 2.0 * longest
    near: list[set[str]] = []
    for what, T in (("start", state.poses[goal.object]), ("goal", goal.pose)):
        far = {name: float(np.linalg.norm(T[:3] - shoulder[name])) for name in scene.robots}
        near.append({name for name in far if far[name] - own <= reach[name]})
        if not near[-1]:
            place = ", ".join(f"{v:.3f}" for v in T[:3])
            arms = ", ".join(f"'{name}' is {far[name]:.2f} m away and reaches {reach[name]:.2f} m" for name in far)
            raise ContactError(
                f"the {what} of '{goal.object}' at ({place}) is out of reach of {', '.join(far)}{with_tools}: {arms}",
                Code.OUT_OF_REACH,
            )

    def meet(a: str, b: str) -> bool:
        return float(np.linalg.norm(shoulder[a] - shoulder[b])) <= reach[a] + reach[b] + 2.0 * own

    joined = set(near[0])  # robots to which the object can be passed on
    while more := {b for b in reach.keys() - joined if any(meet(a, b) for a in joined)}:
        joined |= more
    if not joined & near[1]:
        a, b = min(
            ((a, b) for a in joined for b in near[1]),
            key=lambda pair: np.linalg.norm(shoulder[pair[0]] - shoulder[pair[1]]),
        )
        apart = float(np.linalg.norm(shoulder[a] - shoulder[b]))
        raise ContactError(
            f"'{goal.object}' cannot be passed on to a robot that reaches its goal: '{a}' and '{b}' are {apart:.2f} m "
            f"apart and reach {reach[a]:.2f} m and {reach[b]:.2f} m{with_tools}, and '{goal.object}' is "
            f"{2.0 * own:.2f} m long; move the robots nearer to each other, or add one between them",
            Code.OUT_OF_REACH,
        )
