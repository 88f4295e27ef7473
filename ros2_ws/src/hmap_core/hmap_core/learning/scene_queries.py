"""The contact queries of a scene, as Algorithm 3 meets them: hands and held tools, at several poses of a path."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hmap_core.exceptions import HmapError
from hmap_core.planner.goals import unturned
from hmap_core.planner.interfaces import ToolGrasp
from hmap_core.planner.object_path import BidirectionalSearch
from hmap_core.planner.obstruction import without
from hmap_core.planner.protocols import ContactQuery, ObjectPathQuery
from hmap_core.planner.sampled_contacts import SampledContacts
from hmap_core.planner.strategies.pushed_paths import pushable_path
from hmap_core.planner.tool_grasps import ToolGraspSearch
from hmap_core.planner.tools import attach_tool, tools_of, within_reach
from hmap_core.types import Scene

PATH_CHECKS = 1500  # motions checked for the path of the object
PATH_TIME = 60.0  # s; the checks end the search before
STARTS = 3  # poses of the path at which contacts are asked for
HOLDS = 4  # on one tool of one robot
LEAST_POSES = 4  # of a path


@dataclass(frozen=True)
class SceneQuery:
    """One query of a scene.

    Attributes:
        query: the contact query; in its scene a held tool is attached to the robot.
        start: index of the path's pose at which the object stands.
        grasp: on the tool that touches; None: the bare hand.
        on_tool: whether the object of the query is a tool that is to be picked.
    """

    query: ContactQuery
    start: int
    grasp: ToolGrasp | None = None
    on_tool: bool = False


def object_path(scene: Scene, seed: int) -> np.ndarray | None:
    """The path (M, 7) of the goal's object without what may be removed; None where there is none.

    As the planner asks for contacts on it at first: made of pushes where no hand grips the object.
    """
    free = without(scene, set(scene.removable)) if scene.removable else scene
    state = free.start_state()
    goal = unturned(scene.goal, state.poses[scene.goal.object])
    query = ObjectPathQuery(free, state, goal, seed, PATH_TIME, PATH_CHECKS)
    try:
        poses = BidirectionalSearch().plan_path(query).poses
    except HmapError:
        return None
    poses = pushable_path(free, state, scene.goal, poses)
    return poses if len(poses) >= LEAST_POSES else None


def scene_queries(scene: Scene, rng: np.random.Generator) -> Iterator[SceneQuery]:
    """The queries of a scene in a fixed order; none where the object has no path."""
    poses = object_path(scene, int(rng.integers(2**31)))
    if poses is None:
        return
    object, last = scene.goal.object, len(poses) - 1
    starts = sorted({0, *rng.integers(0, max(last - 2, 1), STARTS - 1).tolist()})
    search = ToolGraspSearch(SampledContacts())
    for start in starts:
        state = scene.start_state()
        state.poses[object] = poses[start]
        ahead = poses[start:]
        for robot in scene.robots:
            yield SceneQuery(ContactQuery(scene, state, object, ahead, robot, rng), start)
            for tool in tools_of(scene, object):
                if not within_reach(scene, state, robot, tool, object):
                    continue
                on_tool = ContactQuery(scene, state, tool, state.poses[tool][None], robot, rng)
                if start == 0:
                    yield SceneQuery(on_tool, 0, on_tool=True)
                holds = search.holds(scene, state, tool, robot, rng)
                for k in rng.permutation(len(holds))[:HOLDS]:
                    grasp = ToolGrasp(tool, holds[k], state.poses[tool])
                    held = ContactQuery(attach_tool(scene, grasp), state, object, ahead, robot, rng)
                    yield SceneQuery(held, start, grasp)
