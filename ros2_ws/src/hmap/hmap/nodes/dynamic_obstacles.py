"""The node ``dynamic_obstacles``: adds bodies near the object's path and moves them during the execution of a plan."""

import sys
import threading

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from hmap.conversions import plan_from_message, scene_from_message, state_from_message
from hmap.node import LATCHED, HmapNode, run
from hmap.requests import Caller
from hmap_core import transforms
from hmap_core.exceptions import HmapError, InputError
from hmap_core.komo.shapes import body_set
from hmap_core.planner.conflicts import object_clearances
from hmap_core.planner.surroundings import placed_bodies
from hmap_core.simulation.dynamic import ObstacleSource
from hmap_core.types import Body, Plan, Scene, SceneState
from hmap_core.waypoints import ObjectPathProblem
from hmap_core.waypoints.checker import check_ends
from hmap_core.waypoints.search import find_corners
from hmap_msgs.msg import Plan as PlanMessage
from hmap_msgs.msg import PlannerStatus
from hmap_msgs.srv import AddBody, GetScene, MoveBody
from hmap_msgs_py.bodies import body_to_message
from hmap_msgs_py.measurements import Latest, ReceiverClock
from hmap_msgs_py.poses import pose_to_message
from hmap_msgs_py.times import seconds_from_message

NAME = "obstacle_{number}"
ANSWER_LIMIT = 10.0  # s; time limit of calls to the world
PATH_LIMIT = 1.0  # s; time limit of the search for a path of the object
PLAN_AHEAD = 60.0  # s that a plan may be stamped ahead of the clock; plans come rarely, so that each of them counts
PATH_STEP = 0.02  # m between the poses of the path near which obstacles appear


class DynamicObstacles(HmapNode):
    """Subscribes to ``plan`` and ``planner_status``; adds and moves bodies through the services of ``world``."""

    def __init__(self):
        super().__init__("dynamic_obstacles")
        seed = self.parameter("seed", 0, "of the places", 0, 2**31 - 1)
        self._count = self.parameter("count", 1, "how many bodies appear, one after the other", 0, 1000)
        self._moves = self.parameter("moves", 6, "steps of 5 cm that each of them moves on", 0, 1000)
        period = self.parameter("period", 0.5, "s between two steps, of the ROS clock", 0.01, 3600.0)
        self._after = self.parameter("after_stretches", 3, "stretches of a plan that begin before the first", 1, 10000)
        smallest = self.parameter("smallest_radius", 0.02, "m", 0.005, 1.0)
        largest = self.parameter("largest_radius", 0.04, "m", 0.005, 1.0)
        text = "bodies appear only where the object still has a path to its goal"
        self._keep_path = self.parameter("keep_path", True, text)
        if smallest > largest:
            raise InputError(f"smallest_radius {smallest} m is above largest_radius {largest} m")
        self._radii = (smallest, largest)
        self._rng = np.random.default_rng(seed)
        self._remote = Caller(self, ANSWER_LIMIT).until(self.stopping.is_set)
        self._step_lock = threading.Lock()
        self._sensor_clock = ReceiverClock(self.now, PLAN_AHEAD)
        self._plans: Latest[Plan] = Latest("the plan", self._sensor_clock)
        self._begun = 0  # stretches that have started, of all plans
        self._body: Body | None = None
        self._appeared, self._moved = 0, 0
        self.subscribe(PlanMessage, "plan", self._take_plan, LATCHED)
        self.subscribe(PlannerStatus, "planner_status", self._take_status, 100)
        self.create_timer(period, self.guarded(self._step), callback_group=self.group)
        self.set_status("waiting for a plan")

    def _take_plan(self, message: PlanMessage) -> None:
        self._plans.add(seconds_from_message(message.header.stamp), plan_from_message(message))

    @property
    def _plan(self) -> Plan | None:
        """The newest plan."""
        self._sensor_clock.now()
        newest = self._plans.newest()
        return None if newest is None else newest[1]

    def _take_status(self, message: PlannerStatus) -> None:
        self._begun += message.phase == PlannerStatus.EXECUTION

    def _step(self) -> None:
        """Execute the next event, if it is due."""
        plan = self._plan
        if plan is None or self._begun < self._after or not self._step_lock.acquire(blocking=False):
            return
        try:
            if self._body is not None and self._moved < self._moves:
                self._move(plan, self._body)
            elif self._appeared < self._count:
                self._appear(plan)
        except HmapError as error:
            self.set_status(str(error), DiagnosticStatus.WARN)
        finally:
            self._step_lock.release()

    def _appear(self, plan: Plan) -> None:
        scene, state = self._world(plan)
        number = self._appeared + 1
        while NAME.format(number=number) in scene.bodies:
            number += 1
        body = self._obstacle_source(plan, scene, state).appear(state, NAME.format(number=number), self._radii)
        if body is None:
            self.set_status("no free place near the path", DiagnosticStatus.WARN)
            return
        self._call(AddBody, "add_body", AddBody.Request(body=body_to_message(body)))
        self._appeared, self._moved, self._body = self._appeared + 1, 0, body
        self._report(body, "appears")

    def _move(self, plan: Plan, moved: Body) -> None:
        scene, state = self._world(plan)
        self._moved += 1
        body = self._obstacle_source(plan, scene, state).move(state, moved) if moved.name in scene.bodies else None
        if body is not None:
            self._call(MoveBody, "move_body", MoveBody.Request(name=body.name, pose=pose_to_message(body.pose)))
            self._body = body
            self._report(body, "moves")

    def _report(self, body: Body, what: str) -> None:
        place = ", ".join(f"{value:.3f}" for value in body.pose[:3])
        text = f"{body.name} {what} at ({place}), radius {body.shapes[0].size[0]:.3f} m"
        self.get_logger().info(text)
        self.set_status(text)

    def _world(self, plan: Plan) -> tuple[Scene, SceneState]:
        response = self._call(GetScene, "get_scene", GetScene.Request())
        scene = scene_from_message(response.scene).with_goal(plan.scene.goal)
        return scene, state_from_message(scene, response.world)

    def _obstacle_source(self, plan: Plan, scene: Scene, state: SceneState) -> ObstacleSource:
        path = remaining_path(plan, state.poses[scene.goal.object])
        return ObstacleSource(scene, path, self._rng, lambda body: self._is_allowed(scene, state, path, body))

    def _is_allowed(self, scene: Scene, state: SceneState, path: np.ndarray, body: Body) -> bool:
        name = scene.goal.object
        keeps_clear = object_clearances(body_set(scene.bodies[name]), path, body).min() > PATH_STEP
        if keeps_clear or not self._keep_path:
            return True
        others = [other for other in placed_bodies(scene, state, name) if other.name != body.name]
        start, goal = state.poses[name], scene.goal.pose
        problem = ObjectPathProblem(scene.bodies[name], start, goal, (*others, body), scene.motion)
        try:
            check_ends(problem)
            return find_corners(problem, np.random.default_rng(0), PATH_LIMIT) is not None
        except InputError:
            return False

    def _call(self, kind: type, name: str, request):
        return self._remote.call(kind, name, request, ANSWER_LIMIT)


def remaining_path(plan: Plan, pose: np.ndarray) -> np.ndarray:
    """The part of the object's path that is still ahead.

    Args:
        plan: the plan.
        pose: T_world_obj (7,) of the plan's object.

    Returns:
        Poses (M, 7), PATH_STEP apart.
    """
    poses = plan.trajectory.objects[plan.scene.goal.object]
    far = [sum(transforms.distance(pose, T)) for T in poses]
    ahead = poses[int(np.argmin(far)) :]
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ahead[:, :3], axis=0), axis=1))])
    kept = np.searchsorted(way, np.arange(0.0, way[-1], PATH_STEP))
    return ahead[np.unique(np.append(kept, len(ahead) - 1))]


def main(args: list[str] | None = None) -> int:
    """Run the node; the exit code."""
    return run(DynamicObstacles, args)


if __name__ == "__main__":
    sys.exit(main())
