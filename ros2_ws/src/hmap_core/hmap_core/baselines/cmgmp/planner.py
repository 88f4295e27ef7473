"""CMGMP as a method: the object's way by contact modes, with the hands of the robots as fingers."""

import numpy as np

from hmap_core.baselines import job
from hmap_core.baselines.birrt.contacts import Contacts
from hmap_core.baselines.birrt.realise import Realisation
from hmap_core.baselines.birrt.search import joined
from hmap_core.baselines.cmgmp.hands import KEPT, RobotHands, TouchingSpace, legs_of
from hmap_core.baselines.cmgmp.polyhedra import polyhedra
from hmap_core.baselines.cmgmp.problem import ObjectProblem
from hmap_core.baselines.cmgmp.search import Search
from hmap_core.collision.convex import convex_set
from hmap_core.contacts.grasp_torque import GRAVITY
from hmap_core.exceptions import MotionError
from hmap_core.komo.shapes import body_set
from hmap_core.planner.context import SearchContext
from hmap_core.planner.goals import unturned
from hmap_core.planner.interfaces import ProgressCallback
from hmap_core.planner.object_path import bases
from hmap_core.planner.outcome import Solution
from hmap_core.planner.protocols import Cancel
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.stability.mass import centre_of_mass
from hmap_core.transforms import IDENTITY
from hmap_core.types import Goal, Plan, Scene, SceneState

DEFAULT_TIME_LIMIT = 180.0  # s, as in the paper
TURN_LENGTH = 0.1  # m that count as much as 1 rad in the distance of two poses
SHARE = 0.5  # of the goal's tolerance within which the goal counts as reached
LONGEST, WIDEST = 0.3, 0.6  # m and rad of one extension
LEAST_MASS = 0.01  # kg of an object without mass
SAMPLES = 300  # extensions of a tree before another one is grown
TO_GOAL = 0.3  # share of the extensions towards the goal: the way to it is seldom straight
FRESH = 0.03  # share of the relocations for which contacts are sampled anew
FROM_ONE_POSE = 4  # extensions towards the goal from nodes that differ in their contacts only
REPORTED = 10  # extensions between two reports


class CmgmpPlanner:
    """Implements :class:`hmap_core.planner.protocols.ManipulationPlanner`.

    Cheng, Huang, Hou and Mason, Contact mode guided motion planning for quasidynamic dexterous manipulation in 3D,
    ICRA 2022.
    """

    def plan(
        self,
        scene: Scene,
        state: SceneState | None = None,
        seed: int = 0,
        time_limit: float = DEFAULT_TIME_LIMIT,
        progress: ProgressCallback | None = None,
        cancel: Cancel | None = None,
    ) -> Plan:
        """Plan a task; the arguments are those of the protocol. Raises HmapError."""
        return job.solve(_solution, scene, state, seed, time_limit, progress, cancel)


def _solution(context: SearchContext, goal: Goal) -> Solution:
    """Grow one tree after the other until the way of one can be carried out. Raises PlannerError."""
    goal = unturned(goal, context.start.poses[goal.object])
    space = TouchingSpace(context.scene, context.start, goal)
    problem = object_problem(context.scene, context.start, goal, space)
    contacts = Contacts(context, goal.object, space, KEPT, FRESH)
    contacts.add_tools()
    told = _Progress(context, goal.object)
    while True:
        search = Search(problem, RobotHands(contacts), context.child_rng(), FROM_ONE_POSE)
        branch = search.solve(SAMPLES, told, TO_GOAL)
        if branch is None or not search.rests_alone(branch[-1]):
            continue
        legs = legs_of(branch)
        for way in (joined(legs), legs):
            try:
                return Realisation(context, goal.object).solution(way)
            except MotionError as error:
                context.record.failed(error)


class _Progress:
    """Counts extensions, reports them, and ends the search when the time is up."""

    def __init__(self, context: SearchContext, object: str):
        self._context, self._object, self._count = context, object, 0

    def __call__(self, number: int) -> None:
        context = self._context
        text = f"'{self._object}': {self._count} extensions in all contact modes"
        context.record.reason = text if context.record.error is None else f"{text}; {context.record.error.reason}"
        if self._count % REPORTED == 0:
            context.report("motion", attempt=self._count, text=text)
        context.time_left()
        self._count += 1


def object_problem(scene: Scene, state: SceneState, goal: Goal, space: TouchingSpace) -> ObjectProblem:
    """The problem of an object among all bodies of a scene and the bases of the robots."""
    body = scene.bodies[goal.object]
    ends = (space.start, space.goal)
    around = (*placed_bodies(scene, state, goal.object), *bases(scene, goal.object, ends))
    return ObjectProblem(
        name=scene.task,
        parts=polyhedra(body_set(body), IDENTITY),
        obstacles=[part for other in around for part in polyhedra(body_set(other), other.pose)],
        start=space.start,
        goal=space.goal,
        friction=body.friction,
        finger_friction=body.friction,
        weight=GRAVITY * max(body.mass, LEAST_MASS),
        lower=space.bounds[0],
        upper=space.bounds[1],
        centre=centre_of_mass(convex_set(body.shapes)),
        turns=np.array([0.0, 0.0, 1.0]) if space.planar else None,
        turn_weight=TURN_LENGTH,
        longest=LONGEST,
        widest=WIDEST,
        reached=SHARE * min(goal.position_tolerance, TURN_LENGTH * goal.rotation_tolerance),
        planar=space.planar,
    )
